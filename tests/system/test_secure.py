"""TLS and access control: admission, permissions, and the whole loop under both.

Zenoh denies without an answer. So each test sends an allowed query after the message on the same
session. Once the query is answered, the message has been passed on or denied.
"""

import json
import secrets
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import zenoh
from harness import ROOT, SCENARIOS, assert_one_line, endpoint_of, here, tools
from mecazen import keys
from mecazen.bus.session import open_session, session_config
from mecazen.config import BusConfig
from mecazen.graph import GRAPH, services
from mecazen.messages import Empty, OdometryRequest
from mecazen.schema import Folder
from mecazen.wire import Stamp
from mecazen_tools import certificates
from mecazen_tools.processes import private_router

SECURE = ROOT / "configs" / "zenoh" / "secure.json5"


def ros(name: str, kind: str) -> str:
    """A key of a ROS topic or service."""
    return f"0/{name}/{kind}_/RIHS01_0"


TWIST, ODOMETRY = "geometry_msgs::msg::dds_::Twist", "nav_msgs::msg::dds_::Odometry"
ROS_RESET = ros("sim/reset", "std_srvs::srv::dds_::Trigger")
ROS_GET, ROS_SET = (
    ros(f"follower/{name}_parameters", f"rcl_interfaces::srv::dds_::{name.title()}Parameters")
    for name in ("get", "set")
)

PUTS = (
    *(topic.key for topic in keys.TOPICS if "*" not in topic.key),
    *(f"diagnostics/{name}" for name in certificates.NAMES),
    "ground_truth/other",
    "of/ones/own",
    *(ros(name, TWIST) for name in ("cmd_vel", "guard/cmd_vel", "follower/cmd_vel")),
    *(ros(name, ODOMETRY) for name in ("odom", "ground_truth/odom", "target/odom")),
)
# what they take from ROS, controller, guard and target hand on to all others
MAY_PUT: dict[str, set[str]] = {
    "physics": {
        "clock",
        "sim/parameters",
        "joint_states",
        "ground_truth/odom",
        "imu",
        "battery_state",
        ros("ground_truth/odom", ODOMETRY),
    },
    "hardware": {
        *("clock", "sim/parameters", "joint_states", "imu", "battery_state", "emergency_stop")
    },
    "controller": {"joint_command", "odom", ros("odom", ODOMETRY), "cmd_vel"},
    "target": {
        "target/odom",
        "target/skeleton",
        "target/observation",
        ros("target/odom", ODOMETRY),
        "target/cmd_vel",
    },
    "crowd": {"people"},
    "sensors": {"scan", "skeleton/observation", "camera/depth", "camera/camera_info"},
    "follower": {
        "cmd_vel",
        "follower/state",
        "target/observation",
        "legs/observation",
        ros("follower/cmd_vel", TWIST),
    },
    "guard": {"guard/cmd_vel", "guard/state", ros("guard/cmd_vel", TWIST), "cmd_vel"},
    "viewer": set(),
    "recorder": set(),
    "collector": set(),
    "operator": {"cmd_vel", "target/cmd_vel", "emergency_stop", ros("cmd_vel", TWIST)},
}
ANSWERS = (
    *(call.key for row in services(GRAPH)["physics"] for call in row.calls),
    f"{keys.ROBOT_DESCRIPTION.key}/**",
    ROS_RESET,
    ROS_GET,
    ROS_SET,
)
"""Keys of the queries that physics answers."""
QUESTIONS = (
    "sim/scenario",
    "sim/get_parameters",
    ROS_GET,
    "robot_description",
    "robot_description/meshes/wheel.stl",
)
GUARD_S = 20.0
"""Only ends a test that would hang."""
ELSEWHERE = {"set_odometry", keys.STOP_MOTORS.key, keys.RELEASE_MOTORS.key}
"""Orders that physics does not answer."""
ORDERS = (
    *(call.key for call in keys.CALLS if call.key not in {*QUESTIONS, "sim/state"}),
    ROS_RESET,
    ROS_SET,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("authority") / "keys"
    certificates.create(made)
    return Folder(made)


class Net(NamedTuple):
    """A router, and peers that show certificates."""

    open: Callable[..., Any]
    endpoint: str
    namespace: str | None


@pytest.fixture(params=[None, "fleet/robot2"])
def net(request, folder):
    endpoint = endpoint_of(private_router("tls"))
    with ExitStack() as stack:

        def open_one(name, mode="client", connect=endpoint, **more):
            config = BusConfig(
                connect=(connect,),
                namespace=request.param,
                zenoh_config=SECURE,
                keys=folder,
                **more,
            )
            return stack.enter_context(open_session(config, mode, name))

        open_one("router", "router")
        yield Net(open_one, endpoint, request.param)


def in_order(function: Callable[[Any], None]) -> Any:
    """Return a handler that runs where samples and queries come in, one after the other."""
    return zenoh.handlers.Callback(function, indirect=False)


class Host:
    """A peer that hears everything, and answers what it may answer."""

    def __init__(self, net: Net, name: str, *answers: str) -> None:
        self.endpoint = endpoint_of(private_router("tls"))
        self.session = net.open(name, "peer", listen=(self.endpoint,))
        self.heard: list[str] = []
        self.asked: list[str] = []
        self.alive: list[str] = []
        self.session.declare_subscriber("**", in_order(self._hear))
        for expression in answers:
            self.session.declare_queryable(expression, in_order(self._answer))
        self.session.liveliness().declare_subscriber(
            "**", in_order(lambda token: self.alive.append(str(token.key_expr)))
        )

    def _hear(self, sample: zenoh.Sample) -> None:
        self.heard.append(str(sample.key_expr))

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            self.asked.append(str(query.key_expr))
            query.reply(query.key_expr, b"{}")


@pytest.fixture
def physics(net):
    return Host(net, "physics", *ANSWERS)


def settle(session: Any) -> None:
    """Return when what the session has said before has come through, or not."""
    # no answer comes before the session knows the queryable
    end = time.monotonic() + GUARD_S
    while not any(reply.ok for reply in session.get("sim/state", timeout=5.0)):
        assert time.monotonic() < end, "nobody answers"


@pytest.fixture
def intruder(net, physics):
    """Open a client with a given certificate: at the peer if in a namespace, else at the router."""
    door = physics.endpoint if net.namespace else net.endpoint

    def come(name):
        session = net.open(name, connect=door)
        settle(session)
        physics.asked.clear()
        return session

    return come


def ask(session: Any, key: str) -> None:
    """Query without waiting for answers: to one that is denied, none ever comes."""
    session.get(key, handler=zenoh.handlers.FifoChannel(1))


def test_each_certificate_may_put_delete_and_ask_what_is_its_own(physics, intruder):
    for name, allowed in MAY_PUT.items():
        session = intruder(name)
        for key in PUTS:
            session.put(key, b"{}")
        settle(session)
        own = {f"diagnostics/{name}"} - {"diagnostics/operator"}
        assert sorted(physics.heard) == sorted(allowed | own), name
        physics.heard.clear()
        for expression in ("**", "*", "diagnostics/*"):  # which hold more than is its own
            session.put(expression, b"{}")
        for key in PUTS:
            session.delete(key)
        physics.asked.clear()
        for key in (*ORDERS, *QUESTIONS, "sim/*", "**", "of/ones/own"):
            ask(session, key)
        settle(session)
        assert not physics.heard, name
        orders = {*ORDERS} - ELSEWHERE if name == "operator" else set()
        assert set(physics.asked) - {"sim/state"} == {*QUESTIONS, *orders}, name


def test_only_an_operator_sets_the_odometry(net):
    controller = Host(net, "controller", "set_odometry")
    follower = net.open("follower", connect=controller.endpoint)
    ask(follower, "set_odometry")
    follower.put("diagnostics/follower", b"{}")
    operator = net.open("operator", connect=controller.endpoint)
    while not controller.heard:
        assert list(operator.get("set_odometry", timeout=5.0))
        controller.asked.clear()
    assert list(operator.get("set_odometry", timeout=5.0))
    assert controller.asked == ["set_odometry"]


def test_nobody_answers_or_is_alive_in_anothers_name(net, physics, intruder):
    for name in MAY_PUT:
        session = intruder(name)
        for one in certificates.NAMES:
            for end in ("", "/ready", "/more", "/ready/more"):
                session.liveliness().declare_token(f"mecazen/{one}{end}")
        session.declare_queryable("set_odometry", lambda query: query.reply("set_odometry", b""))
        settle(session)
        own = set() if name == "operator" else {f"mecazen/{name}", f"mecazen/{name}/ready"}
        assert set(physics.alive) == own, name
        session.close()
        physics.alive.clear()


def _config(folder: Path, **changes: Any) -> dict[str, Any]:
    files = {
        "root_ca_certificate": folder / "ca.crt",
        "connect_certificate": folder / "operator.crt",
        "connect_private_key": folder / "operator.key",
    }
    return {name: str(path) for name, path in files.items()} | {"enable_mtls": True} | changes


def _connect(endpoint: str, tls: dict[str, Any]) -> zenoh.Session:
    config = session_config(BusConfig(connect=(endpoint,)), "client")
    config.insert_json5("transport/link/tls", json.dumps(tls))
    return zenoh.open(config)


def test_without_a_certificate_of_this_authority_nobody_gets_in(net, physics, folder, tmp_path):
    other = tmp_path / "other"
    certificates.create(other)
    right = _config(folder)
    no_certificate = {"root_ca_certificate": right["root_ca_certificate"], "enable_mtls": False}
    foreign = right | {
        "connect_certificate": str(other / "operator.crt"),
        "connect_private_key": str(other / "operator.key"),
    }
    for endpoint in (net.endpoint, physics.endpoint):
        with pytest.raises(zenoh.ZError, match="Unable to connect"):
            _connect(endpoint.replace("tls/", "tcp/"), {})
        for tls in ({}, no_certificate, foreign, _config(other)):
            with pytest.raises(zenoh.ZError, match="Unable to connect"):
                _connect(endpoint, tls)
        with _connect(endpoint, right) as session:
            assert not session.is_closed()


def secure(folder: Folder) -> tuple[str, ...]:
    return (f"bus.zenoh_config={SECURE}", f"bus.keys={folder}")


def intrude(running: Any, name: str) -> Any:
    """Open a session with a given certificate to a running scenario."""
    return open_session(running.scenario.bus, "client", name)


def test_forged_stamps_on_the_keys_of_physics_silence_nobody(stack, folder):
    # if they were let in, each service would wait for their future tick
    running = stack(SCENARIOS / "back.toml", *secure(folder))
    newest = {}
    for topic in (keys.ODOM, keys.TARGET_ODOM, keys.FOLLOWER_STATE):
        running.bus.subscribe(topic, lambda _, stamp, key=topic.key: newest.update({key: stamp}))
    running.start()
    running.wait(lambda: len(newest) == 3)
    run = newest["odom"].run
    with intrude(running, "viewer") as viewer:
        for key in ("clock", "joint_states", "ground_truth/odom", "odom", "target/observation"):
            for forged in (Stamp(2**60, run, 0), Stamp(0, secrets.randbits(32), 0)):
                viewer.put(key, b"{}", attachment=forged.pack())
        settle(viewer)
    before = dict(newest)
    running.wait(lambda: all(newest[key].time_ns > before[key].time_ns + 10**9 for key in newest))
    assert {stamp.run for stamp in newest.values()} == {run}


def test_an_operators_tools_work_and_others_are_not_answered(stack, folder):
    running = stack(SCENARIOS / "teleop.toml", *secure(folder))
    running.start()
    assert running.call(keys.SIM_PAUSE, Empty()).paused
    assert running.call(keys.SET_ODOMETRY, OdometryRequest()).header.frame_id == "odom"
    assert "services" in running.call(keys.SIM_SCENARIO, Empty()).data
    with intrude(running, "viewer") as viewer:
        ask(viewer, "sim/resume")
        settle(viewer)
    assert running.call(keys.SIM_STATE, Empty()).paused
    done = here(*tools(running.scenario.bus), "--tls", folder, "sim", "resume")
    assert json.loads(done.stdout)["paused"] is False, done.stderr
    done = here(*tools(running.scenario.bus), "sim", "pause")
    assert_one_line(done, 1, f"nothing answers at {running.endpoint}")


def test_expired_certificates_are_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(certificates, "VALID_DAYS", -0.5)  # they begin a day ago
    folder = tmp_path / "keys"
    certificates.create(folder)
    done = here("up", "back", f"--set=bus.keys={folder}")
    assert_one_line(done, 1, f"{folder}/ca.crt: expired on ", "`mecazen keys create` makes new")


@pytest.mark.parametrize("name", ["router", "viewer"])
def test_a_tool_believes_only_who_shows_the_routers_certificate(folder, name):
    config = BusConfig(connect=(endpoint_of(private_router("tls")),), keys=folder)
    with open_session(config, "router", name) as router:
        router.declare_queryable("sim/state", lambda query: query.reply(query.key_expr, b"{}"))
        alive = router.liveliness().declare_token("mecazen/physics")
        with open_session(config, "client") as tool:
            states = list(tool.get("sim/state", timeout=5.0))
            tokens = list(tool.liveliness().get("mecazen/*", timeout=5.0))
        alive.undeclare()
    is_believed = name == "router"
    assert [bool(states), bool(tokens)] == [is_believed, is_believed]
