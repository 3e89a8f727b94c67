"""TLS and access control: admission, permissions, and the whole loop under both.

Zenoh denies without an answer. So each test sends an allowed query after the message on the same
session. Once the query is answered, the message has been passed on or denied.
"""

import json
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import zenoh
from harness import ROOT, SCENARIOS, assert_one_line, here, tools
from mecazen import keys
from mecazen.bus.ports import free_port
from mecazen.bus.session import open_session, session_config
from mecazen.config import BusConfig
from mecazen.graph import GRAPH, services
from mecazen.messages import Empty, OdometryRequest
from mecazen.schema import Folder
from mecazen_tools import certificates

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

MAY_PUT = {
    "physics": "clock sim/parameters joint_states ground_truth/odom imu battery_state",
    "hardware": "clock sim/parameters joint_states imu battery_state emergency_stop",
    "controller": "joint_command odom cmd_vel",
    "target": "target/odom target/skeleton target/observation target/cmd_vel",
    "crowd": "people",
    "sensors": "scan skeleton/observation camera/depth camera/camera_info",
    "follower": "cmd_vel follower/state target/observation legs/observation",
    "guard": "guard/cmd_vel guard/state cmd_vel",
    "viewer": "",
    "recorder": "",
    "collector": "",
    "operator": "cmd_vel target/cmd_vel emergency_stop",
}
"""Keys by certificate; controller, guard and target hand on the commands of ROS."""
MAY_PUT_ROS = {
    "physics": {ros("ground_truth/odom", ODOMETRY)},
    "controller": {ros("odom", ODOMETRY)},
    "target": {ros("target/odom", ODOMETRY)},
    "follower": {ros("follower/cmd_vel", TWIST)},
    "guard": {ros("guard/cmd_vel", TWIST)},
    "operator": {ros("cmd_vel", TWIST)},
}
PUTS = (
    *(topic.key for topic in keys.TOPICS if "*" not in topic.key),
    *(f"diagnostics/{name}" for name in certificates.NAMES),
    "ground_truth/other",
    "of/ones/own",
    *set().union(*MAY_PUT_ROS.values()),
)
ANSWERS = (
    *(call.key for row in services(GRAPH)["physics"] for call in row.calls),
    f"{keys.ROBOT_DESCRIPTION.key}/**",
    ROS_RESET,
    ROS_GET,
    ROS_SET,
)
"""Keys of the queries that physics answers."""
QUESTIONS = (
    *("sim/scenario", "sim/get_parameters", ROS_GET),
    *("robot_description", "robot_description/meshes/wheel.stl"),
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


def free_endpoint() -> str:
    return f"tls/127.0.0.1:{free_port()}"


class Net:
    """A router, and peers that show certificates."""

    def __init__(self, stack: ExitStack, folder: Path, namespace: str | None) -> None:
        self.endpoint = free_endpoint()
        self.namespace = namespace
        self._stack, self._keys = stack, folder
        self.open("router", "router")

    def open(self, name: str, mode: str = "client", connect: str = "", **more: Any) -> Any:
        where = {"connect": (connect or self.endpoint,), "namespace": self.namespace, **more}
        config = BusConfig(zenoh_config=SECURE, keys=self._keys, **where)
        return self._stack.enter_context(open_session(config, mode, name))


@pytest.fixture(params=[None, "fleet/robot2"])
def net(request, folder):
    with ExitStack() as stack:
        yield Net(stack, folder, request.param)


def in_order(function: Callable[[Any], None]) -> Any:
    """Return a handler that runs where samples and queries come in, one after the other."""
    return zenoh.handlers.Callback(function, indirect=False)


class Host:
    """A peer that hears everything, and answers what it may answer."""

    def __init__(self, net: Net, name: str, *answers: str) -> None:
        self.endpoint = free_endpoint()
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
        health = {f"diagnostics/{name}"} - {"diagnostics/operator"}
        expected = health | set(allowed.split()) | MAY_PUT_ROS.get(name, set())
        assert sorted(physics.heard) == sorted(expected), name
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
        tokens = set() if name == "operator" else {f"mecazen/{name}", f"mecazen/{name}/ready"}
        assert set(physics.alive) == tokens, name
        session.close()
        physics.alive.clear()


def connect(endpoint: str, **tls: Any) -> zenoh.Session:
    config = session_config(BusConfig(connect=(endpoint,)), "client")
    config.insert_json5("transport/link/tls", json.dumps(tls))
    return zenoh.open(config)


def test_without_a_certificate_of_this_authority_nobody_gets_in(net, physics, folder, tmp_path):
    certificates.create(tmp_path / "other")
    authority, foreign = (
        {"root_ca_certificate": str(path / "ca.crt")} for path in (folder, tmp_path / "other")
    )
    ours, theirs = (
        {
            "enable_mtls": True,
            "connect_certificate": str(path / "operator.crt"),
            "connect_private_key": str(path / "operator.key"),
        }
        for path in (folder, tmp_path / "other")
    )
    for endpoint in (net.endpoint, physics.endpoint):
        for address, tls in (
            (endpoint.replace("tls/", "tcp/"), {}),
            (endpoint, {}),
            (endpoint, {**authority, "enable_mtls": False}),
            (endpoint, {**authority, **theirs}),
            (endpoint, {**foreign, **theirs}),
        ):
            with pytest.raises(zenoh.ZError, match="Unable to connect"):
                connect(address, **tls)
        with connect(endpoint, **authority, **ours) as session:
            assert not session.is_closed()


def test_an_operators_tools_work_and_others_are_not_answered(stack, access_control):
    running = stack(SCENARIOS / "teleop.toml", *access_control)
    bus = running.scenario.bus
    running.start()
    assert running.call(keys.SIM_PAUSE, Empty()).paused
    assert running.call(keys.SET_ODOMETRY, OdometryRequest()).header.frame_id == "odom"
    assert "services" in running.call(keys.SIM_SCENARIO, Empty()).data
    with open_session(bus, "client", "viewer") as viewer:
        ask(viewer, "sim/resume")
        settle(viewer)
    assert running.call(keys.SIM_STATE, Empty()).paused
    done = here(*tools(bus), "--tls", bus.keys, "sim", "resume")
    assert json.loads(done.stdout)["paused"] is False, done.stderr
    done = here(*tools(bus), "sim", "pause")
    assert_one_line(done, 1, f"nothing answers at {running.endpoint}")


def test_expired_certificates_are_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(certificates, "VALID_DAYS", -0.5)  # they begin a day ago
    folder = tmp_path / "keys"
    certificates.create(folder)
    done = here("up", "back", f"--set=bus.keys={folder}")
    assert_one_line(done, 1, f"{folder}/ca.crt: expired on ", "`mecazen keys create` makes new")


@pytest.mark.parametrize(("name", "is_believed"), [("router", True), ("viewer", False)])
def test_a_tool_believes_only_who_shows_the_routers_certificate(folder, name, is_believed):
    config = BusConfig(connect=(free_endpoint(),), keys=folder)
    with open_session(config, "router", name) as router:
        router.declare_queryable("sim/state", lambda query: query.reply(query.key_expr, b"{}"))
        alive = router.liveliness().declare_token("mecazen/physics")
        with open_session(config, "client") as tool:
            states = list(tool.get("sim/state", timeout=5.0))
            tokens = list(tool.liveliness().get("mecazen/*", timeout=5.0))
        alive.undeclare()
    assert [bool(states), bool(tokens)] == [is_believed, is_believed]
