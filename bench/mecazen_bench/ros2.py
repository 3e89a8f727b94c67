"""What ROS 2 costs: a message in CDR, beside rosbags and JSON."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

from mecazen import messages as m
from mecazen.wire import decode, encode
from mecazen_ros import cdr
from rosbags.typesys import Stores, get_typestore

from mecazen_bench.figures import Figure, Group, Row

REPEATS = 200
CALLS = 20
"""At once, between two looks at the clock."""
BEAMS = 720
JOINTS = 40


def run(repeats: int = REPEATS) -> list[Group]:
    """Write and read messages of four kinds in three ways, interleaved."""
    rows = [row for message in _messages() for row in _rows(message, repeats)]
    how = f"fastest of {repeats} blocks of {CALLS} calls, interleaved; rosbags with NumPy's arrays"
    return [Group("Messages in CDR", how, tuple(rows))]


def _messages() -> tuple[m.Message, ...]:
    header = m.Header(m.Time(12, 340_000_000), "odom")
    covariance = tuple(number / 7 for number in range(36))
    joints = tuple(number / 7 for number in range(JOINTS))
    names = tuple(f"wheel_{number}_joint" for number in range(JOINTS))
    return (
        m.Twist(m.Vector3(0.3, 0.1), m.Vector3(z=0.5)),
        m.Odometry(
            header,
            "base_link",
            m.PoseWithCovariance(covariance=covariance),
            m.TwistWithCovariance(covariance=covariance),
        ),
        m.JointState(header, names, joints, joints, joints),
        m.LaserScan(header, ranges=tuple(number / 4 for number in range(BEAMS))),
    )


def _rows(message: m.Message, repeats: int) -> list[Row]:
    kind, name = type(message), message.ROS_TYPE
    payload = cdr.encode(message)
    text = encode(message, "json")
    store = get_typestore(Stores.ROS2_JAZZY)
    theirs = store.deserialize_cdr(payload, name)
    ways: dict[str, tuple[Callable[[], object], Callable[[], object], int]] = {
        "CDR": (partial(cdr.encode, message), partial(cdr.decode, payload, kind), len(payload)),
        "rosbags": (
            partial(store.serialize_cdr, theirs, name),
            partial(store.deserialize_cdr, payload, name),
            len(payload),
        ),
        "JSON": (partial(encode, message, "json"), partial(decode, text, kind), len(text)),
    }
    calls = [call for write, read, _ in ways.values() for call in (write, read)]
    spent = iter(_fastest_us(calls, repeats))
    return [
        Row(
            f"{kind.__name__}, {way}",
            {
                "write µs": Figure.of(next(spent), "less"),
                "read µs": Figure.of(next(spent), "less"),
                "bytes": Figure.of(size, "less"),
            },
        )
        for way, (_, _, size) in ways.items()
    ]


def _fastest_us(calls: list[Callable[[], object]], repeats: int) -> list[float]:
    best = [float("inf")] * len(calls)
    for _ in range(repeats):
        for index, call in enumerate(calls):
            begin = time.perf_counter()
            for _ in range(CALLS):
                call()
            best[index] = min(best[index], time.perf_counter() - begin)
    return [1e6 * seconds / CALLS for seconds in best]
