"""Messages survive CDR bit for bit, others read it, and types are those of ROS 2 Jazzy."""

import math
import random
import struct
import tracemalloc
from contextlib import suppress

import msgspec
import pytest
from drawn import KINDS, bits, drawn, plain
from harness import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st
from mecazen import messages as m
from mecazen.wire import RefusedError
from mecazen_ros import cdr
from mecazen_ros.services import OF_NODE
from mecazen_ros.types import definition, package_files, type_hash
from ros import grammar

with pytest.MonkeyPatch.context() as patch:
    patch.setenv("ROS_DISTRO", "jazzy")  # else it takes itself for Humble
    from ros2_pyterfaces import core
    from ros2_pyterfaces.core.rcl_interfaces import srv

PACKAGE = ROOT / "ros2" / "mecazen_msgs"


@given(data=st.data())
@settings(max_examples=100)
def test_messages_are_the_same_after_cdr_and_to_another_reader(data):
    kind = data.draw(st.sampled_from(KINDS))
    message = data.draw(drawn(kind))
    payload = cdr.encode(message)
    assert plain(cdr.decode(payload, kind)) == plain(message)
    assert bits(grammar.message(payload, kind.ROS_TYPE, definition(kind))) == plain(message)


@given(data=st.data())
@settings(max_examples=20)
def test_truncated_or_damaged_bytes_are_refused_or_a_message(data):
    kind = data.draw(st.sampled_from(KINDS))
    payload = cdr.encode(data.draw(drawn(kind)))
    for length in range(len(payload)):
        with pytest.raises(RefusedError):
            cdr.decode(payload[:length], kind)
    rng = random.Random(data.draw(st.integers(0)))
    for _ in range(50):
        begin = rng.randrange(len(payload))
        odd = rng.choice([b"\xff" * 4, b"\x00" * 8, b"\xf0\x7f", rng.randbytes(3)])
        damaged = payload[:begin] + odd + payload[begin + rng.choice([0, len(odd)]) :]
        with suppress(RefusedError):
            read = cdr.decode(damaged, kind)
            assert msgspec.convert(msgspec.to_builtins(read, builtin_types=(bytes,)), kind) == read


def test_a_length_beyond_the_payload_takes_no_memory():
    payload = cdr.HEADER + bytes(12) + b"\x01" + bytes(28) + b"\xff" * 4 + b"\x01" * 100
    tracemalloc.start()
    try:
        with pytest.raises(RefusedError):
            cdr.decode(payload, m.Image)
        assert tracemalloc.get_traced_memory()[1] < 1 << 20  # generating the function included
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("payload", "kind"),
    [
        (b"\x00\x03\x00\x00" + bytes(24), m.Vector3),  # another encoding
        (cdr.HEADER + struct.pack("<3d", 1.0, math.nan, 2.0), m.Vector3),
        (cdr.encode(m.DiagnosticStatus(level=4)), m.DiagnosticStatus),
    ],
)
def test_values_beyond_their_bounds_are_refused(payload, kind):
    with pytest.raises(RefusedError, match=kind.ROS_TYPE):
        cdr.decode(payload, kind)


@pytest.mark.parametrize("message", [m.Time(2**31), m.CameraInfo(k=(1.0,)), m.String("\ud800")])
def test_values_that_do_not_fit_are_not_written(message):
    with pytest.raises(RefusedError, match=f"no {message.ROS_TYPE} in CDR"):
        cdr.encode(message)


def test_hashes_are_those_of_ros():
    # as in the logs of ROS 2 Jazzy: the first half
    twist, trigger = type_hash("geometry_msgs/msg/Twist"), type_hash("std_srvs/srv/Trigger")
    assert twist.startswith("RIHS01_9c45bf16fe0983d80e3cfe750d683584")
    assert trigger.startswith("RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317")
    for service in OF_NODE:  # as in ros2_pyterfaces
        short = service.kind.rpartition("/")[2]
        assert type_hash(service.kind) == core.hash_rihs01(getattr(srv, short))


def test_the_package_has_a_file_for_each_message_of_a_topic():
    files = dict(package_files(PACKAGE))
    assert files.keys() == {*PACKAGE.glob("msg/*.msg")}
    assert files[PACKAGE / "msg" / "NamedPose.msg"] == (
        "# Name and true pose of a robot.\n\nstring name\ngeometry_msgs/Pose pose\n"
    )
