"""Wrong inputs of a user: each gets one line, with the error and the allowed values.

The command line runs in this process, as starting one for each would take a minute.
"""

import pytest
from harness import ROOT, here

NOBODY = ("--connect", "tcp/127.0.0.1:1")


def setting(text, *words, scenario="back"):
    return ("simulate", scenario, "--set", text), words


BAD = [
    # commands, arguments and options
    (("bla",), ("No such command", "bla")),
    (("simulate",), ("SCENARIO",)),
    (("simulate", "back", "--sett", "a=1"), ("--sett", "--set")),
    (("simulate", "./nowhere.toml"), ("nowhere.toml", "no such")),
    (("simulate", "back", "--seed", "-1"), ("--seed", "equal to 0")),
    (("simulate", "back", "--duration", "0"), ("sim.duration_s", "> 0")),
    (("simulate", "back", "--trajectory", "no/such/run.csv"), ("--trajectory", "no such folder")),
    (("compare", "back", "default"), ("two or more", "my_follower.py:MyFollower default")),
    (("compare", "back", "default", "nosuch.py:Mine"), ("nosuch.py", "No such file")),
    (("compare", "teleop", "default", "follower.view=side_left"), ("teleop", "follower")),
    (("compare", "convoy", "default", "follower.view=side_left"), ("convoy", "one robot")),
    (("compare", "back", "default", "follower.vew=side_left"), ("did you mean view",)),
    (("new", "robt", "mine"), ("robt", "'robot'")),
    (("new", "robot", "My-Robot"), ("My-Robot", "such as my_robot")),
    (("collect", "back"), ("sim.mode=lockstep", "collector")),
    (("run", "pilot", "back"), ("pilot", "physics")),
    (("run", "back"), ("SCENARIO", "`mecazen up back`", "`mecazen simulate back`")),
    (("help", "nothing"), ("nothing", "No such command")),
    (("param", "set", "follower.standoff_m", "1.5"), ("NAME=VALUE", "follower.standoff_m=1.5")),
    (("up", "back", "--set", "sim.speed=0"), ("sim.speed", "0.01")),
    (("up", "back", "--processes", "0"), ("--processes", "1")),
    (("keys", "create", "/dev/null/keys"), ("/dev/null/keys",)),
    (("hardware", "probe", "--port", "/dev/none"), ("/dev/none", "no such port")),
    (("hardware", "check", "--yes", "--port", "/dev/null"), ("/dev/null", "not a serial port")),
    (("hardware", "probe", "--port", "/dev/null", "--board", "x3"), ("x3", "rosmaster_x3")),
    (("hardware", "probe", "--port", "/dev/null", "--robot", "x9"), ("x9", "rosmaster_x3")),
    (("keys", "create", "new", "--host", "a b"), ("--host a b",)),
    (("keys", "create", "new", "--host", "0.0.0.0"), ("--host 0.0.0.0", "no host")),  # noqa: S104
    # what is asked of a running simulation
    (("sim", "step", "0"), ("ticks", "1")),
    (("sim", "speed", "0"), ("factor", "0.01")),
    (("sim", "speed", "1e9"), ("factor", "1000")),
    (("sim", "reset", "--seed", "-1"), ("--seed", "0")),
    (("sim", "restart"), ("restart",)),
    ((*NOBODY, "sim", "state"), ("tcp/127.0.0.1:1", "mecazen up")),
    (("--connect", "tcp://127.0.0.1:1", "sim", "state"), ("tcp/127.0.0.1:1", "mecazen up")),
    (("--connect", "nonsense", "sim", "state"), ("nonsense",)),
    (("--tls", "no/keys", "sim", "state"), ("no/keys",)),
    ((*NOBODY, "status"), ("tcp/127.0.0.1:1", "mecazen up")),
    ((*NOBODY, "pub", "cmd_vel", "{}"), ("tcp/127.0.0.1:1", "mecazen up")),
    (("--namespace", "a b", "echo", "odom"), ("--namespace a b",)),
    (("echo", "odom", "--namespace", "a"), ("--namespace", "before the command")),
    (("--namespace", "a", "up", "back"), ("echo", "--set bus.namespace=")),
    (("echo", "odom", "--count", "0"), ("--count", "1")),
    (("pub", "two/cmd_vel", '{"linear":{"x":"fast"}}'), ("two/cmd_vel", "float")),
    (("pub", "two/target/cmd_vel", '{"linear":{"x":1e9}}'), ("two/target/cmd_vel", "<= 1")),
    (("pub", "cmd_vel", '{"linear":{"x":1e999}}'), ("cmd_vel",)),
    (("pub", "cmd_vel", "{"), ("cmd_vel",)),
    (("pub", "cmd_vel", "[]"), ("cmd_vel", "object")),
    (("pub", "/cmd_vel", "{}"), ("/cmd_vel", "leading")),
    (("pub", "**", "{}"), ("**", "one key")),
    (("pub", "cmd_vel", "\udcff"), ("\\udcff", "UTF-8")),
    (("pub", "cmd_vel", "{}", "--rate", "0"), ("--rate", "0.01")),
    (("teleop",), ("terminal", "mecazen pub")),
    (("teleop", "--speed", "-1"), ("--speed", "0.01")),
    (("pub", "cmd_vel", "{}", "--duration", "1"), ("--duration", "--rate")),
    # figures and recordings
    (("bench", "compare", "none.csv", "none.csv"), ("none.csv", "No such file")),
    (("bench", "compare", "README.md", "README.md"), ("README.md", "no results of mecazen bench")),
    (("plot", "/dev/null"), ("/dev/null", "regular file")),
    (("score", "none.mcap"), ("none.mcap", "No such file")),
    (("people", "import", "none.txt"), ("none.txt", "No such file")),
    (("replay", "none.mcap"), ("none.mcap", "No such file")),
    (("replay", "/dev/null", "--through", "follower", "--loop"), ("regular file",)),
    ((*NOBODY, "record", "-o", "/dev/null/run.mcap"), ("tcp/127.0.0.1:1",)),
    # settings
    setting("physics.dt_s=0.0019", "sim.tick_s", "nearest: 0.0016666666666666668, 0.002"),
    setting("follower.estimator=magic", "magic", "kf_displacement"),
    setting("target.path.file=x.csv", "x.csv", scenario="pedestrian"),
    setting("start={x_m=0.1}", "start", "inside the person"),
    setting("services=['physics','pilot']", "pilot", "nodes: body"),
    setting("processes=[['physics','viewer']]", "viewer"),
    setting("controller.command_key=robot/*", "controller.command_key"),
    setting("controller.odometry=imu", "controller.odometry", "ground_truth"),
    setting("controller.odom_frame_id=base_link", "must differ from base_frame_id"),
    setting("controller.limits.x.max_velocity_m_s=0.0", "max_velocity_m_s", "> 0"),
    setting("sensor.rate_hz=30", "sensor.rate_hz = 30 must divide the tick rate"),
    setting("sensor.latency_s=0.015", "sensor.latency_s", "whole number of ticks"),
    setting("sensor.faults.stand_ins_s=[[1,2]]", "needs faults.other_m"),
    setting("sensor.faults={other_m=1,stand_ins_s=[[2,1]]}", "must end after it begins"),
    setting("sensors.tracker.rate_hz=30", "sensors.tracker.rate_hz = 30", scenario="senses"),
    setting("sensors.tracker.latency_s=0.015", "whole number of ticks", scenario="senses"),
    setting("crowd.reactive={count=3,x_m=[1,0],y_m=[0,2]}", "x_m: 1 must be below 0"),
    setting("crowd.reactive={count=9,x_m=[0,2],y_m=[0,2]}", "one walker for each square metre"),
    setting("crowd.walkers=[{path={kind='waypoints',points_m=[[0,0],[0,0]]}}]", "points 1 and 2"),
    setting("crowd.walkers=[{enters_and_leaves=true,path={kind='circle'}}]", "must be recorded"),
    setting("follower.estimator_params.gain=1", "imm has no parameter gain, allowed: "),
    setting("follower.control={kind='pid',x={kp=-1}}", "follower.control.x.kp", ">= 0"),
    setting("follower.planner.priorities=['distance']", "must be distance, visibility, "),
    setting("follower.standoff_m=0.5", "must be at least 0.58: the radii of"),
    setting("robot.rollers.bearing_friction_nms=1e-3", "must be below", "or physics.dt_s"),
    setting("world.obstacles=[{kind='box',size_m=[1,1,0.01],position_m=[9,0]}]", "0.01 m high"),
    setting("world.obstacles=[{kind='box',size_m=[1,1,1],position_m=[-1.3,0]}]", "inside the box"),
    setting("world.obstacles=[{kind='box',size_m=[1,1,1],position_m=[3,0]}]", "crosses the box"),
]


@pytest.mark.parametrize(("arguments", "words"), BAD, ids=[" ".join(given) for given, _ in BAD])
def test_what_a_user_gets_wrong_is_one_line_and_says_what_is_allowed(arguments, words, tmp_path):
    writes = arguments[:2] == ("keys", "create")
    done = here(*arguments, folder=tmp_path if writes else ROOT)
    assert done.returncode in (1, 2), done
    assert not done.stdout
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")
    for word in words:
        assert word in line
    assert not list(tmp_path.iterdir())
