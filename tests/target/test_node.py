"""The target and the crowd: persons at every tick, what the sensor saw, and wrong payloads."""

import math

import pytest
from harness import SCENARIOS, Rig, Steps, assert_sendable, load_robot
from hostile import forged
from mecazen import keys
from mecazen import messages as m
from mecazen.config import Scenario, SensorConfig, TargetConfig
from mecazen.config.people import Circle, Driven, Gait, Goal, Standing, Straight
from mecazen.geometry import Pose2D, Twist2D
from mecazen.keys import of_robot
from mecazen.loading import load_scenario, parse_settings
from mecazen.parameters import changed
from mecazen.skeleton import INDEX, JOINTS
from mecazen.wire import encode
from mecazen_target.crowd import CrowdNode
from mecazen_target.node import TargetNode

NEXUS = load_robot()
ORIGIN = Pose2D()
STANDING = Standing(x_m=2.0, y_m=1.0, yaw_deg=90.0)
DRIVEN = Driven(timeout_s=0.05)


class Target(Steps):
    """A person on a path; the sensor is exact by default."""

    def __init__(self, path, gait=None, seed=1, **sensor):
        scenario = Scenario(
            robot=NEXUS,
            seed=seed,
            sensor=SensorConfig(**{"position_std_m": 0.0, "yaw_std_deg": 0.0, **sensor}),
            target=TargetConfig(path=path, gait=gait),
        )
        super().__init__(TargetNode, scenario)

    def tick(self, tick, robot=ORIGIN, command=None, people=None):
        """Return the outputs of a tick in which the robot truly is at a pose."""
        samples = {keys.GROUND_TRUTH: m.planar_odometry(m.Time(), "world", "x", robot, Twist2D())}
        if command is not None:
            samples[keys.TARGET_CMD_VEL] = m.Twist.planar(command)
        if people is not None:
            samples[keys.PEOPLE] = people
        return self.step(tick, samples)

    def person(self, tick, command=None):
        """Return where the person is at a tick."""
        return pose_of(self.tick(tick, command=command)[keys.TARGET_ODOM])

    def bytes(self, ticks):
        """Return all that is published in some ticks."""
        sent = (message for tick in range(ticks) for message in self.tick(tick).values())
        return b"".join(map(encode, sent))


def pose_of(odom):
    return odom.pose.pose.to_planar()


def test_frames_come_at_the_sensors_rate():
    target = Target(STANDING)
    for tick in range(9):
        outputs = target.tick(tick)
        assert list(outputs) == [keys.TARGET_ODOM, keys.OBSERVATION][: 1 + (tick % 4 == 0)]
        odom = outputs[keys.TARGET_ODOM]
        assert odom.header.stamp == m.Time(nanosec=tick * 10_000_000)
        assert (odom.header.frame_id, odom.child_frame_id) == ("world", "person")
        assert pose_of(odom) == pytest.approx((2.0, 1.0, math.pi / 2))


def test_frame_has_pose_and_covariance():
    # the person, at (2, 1) with heading 90°, is 1 m behind a robot that looks back along x
    seen = {"base_link": (-1.0, 0.0, -math.pi / 2), "world": (2.0, 1.0, math.pi / 2)}
    for frame_id, pose in seen.items():
        frame = Target(STANDING, frame=frame_id).tick(0, Pose2D(1.0, 1.0, math.pi))
        assert frame[keys.OBSERVATION].header.frame_id == frame_id
        assert frame[keys.OBSERVATION].poses[0].pose.to_planar() == pytest.approx(pose)
        assert frame[keys.OBSERVATION].poses[0].covariance == (0.0,) * 36
    noisy = Target(STANDING, position_std_m=0.1, yaw_std_deg=math.degrees(0.2)).tick(0)
    covariance = m.diagonal_covariance((0.01, 0.01, 0.0, 0.0, 0.0, 0.04))
    assert noisy[keys.OBSERVATION].poses[0].covariance == pytest.approx(covariance)


def test_late_frame_has_stamp_and_poses_of_capture():
    target = Target(Straight(speed_m_s=1.0), latency_s=0.03)
    frames = {}
    for tick in range(9):
        outputs = target.tick(tick, Pose2D(x=-0.5 * tick))
        frames[tick] = outputs.get(keys.OBSERVATION)
        assert pose_of(outputs[keys.TARGET_ODOM]).x == pytest.approx(0.01 * tick)
    assert frames[0].poses == ()  # taken before anything was
    for tick in (4, 8):
        assert frames[tick].header.stamp == m.Time(nanosec=(tick - 3) * 10_000_000)
        assert frames[tick].poses[0].pose.position.x == pytest.approx(0.51 * (tick - 3))


def test_runs_of_one_seed_are_identical():
    walk = {"path": Circle(speed_m_s=1.0), "gait": Gait(), "dropout_probability": 0.2}
    walk |= {"position_std_m": 0.05, "yaw_std_deg": 5.0}
    target = Target(**walk)
    runs = {}
    for seed in (1, 2, 1):
        target.reset(seed)
        ran = target.bytes(200)
        assert ran == runs.setdefault(seed, ran) == Target(**walk, seed=seed).bytes(200)
    assert runs[1] != runs[2]


def test_driven_person_stops_after_the_last_command():
    target = Target(DRIVEN)
    assert target.person(0) == Pose2D()
    walked = [target.tick(1, command=Twist2D(1.0)), *map(target.tick, range(2, 9))]
    odoms = [outputs[keys.TARGET_ODOM] for outputs in walked]
    # 5 ticks of 10 mm, then the timeout
    expected = [0.01, 0.02, 0.03, 0.04, 0.05, 0.05, 0.05, 0.05]
    assert [pose_of(odom).x for odom in odoms] == pytest.approx(expected)
    assert [odom.twist.twist.linear.x for odom in odoms] == [1.0] * 5 + [0.0] * 3
    turn = Twist2D(0.0, 1.0, 2.0)
    assert target.person(9, turn) == pytest.approx(Pose2D(0.05).integrate(turn, 0.01))


def test_driven_person_catches_up_missed_ticks():
    target = Target(DRIVEN)
    target.person(0)
    assert target.person(3, Twist2D(1.0)).x == pytest.approx(0.03)
    odom = target.tick(100)[keys.TARGET_ODOM]
    assert pose_of(odom).x == pytest.approx(0.05)
    assert odom.twist.twist.linear.x == 0.0
    assert target.person(200_000_000).x == pytest.approx(0.05)  # 23 days later, at once


def test_person_on_a_path_ignores_commands():
    target = Target(Straight(speed_m_s=1.0, length_m=3.0))
    assert target.person(100, Twist2D(-1.0)).x == pytest.approx(1.0)
    report = {"time_s": 1.0, "x_m": 1.0, "y_m": 0.0, "walked_m": 1.0, "true_distance_error_m": 0.0}
    assert target.node.diagnostics() == report
    assert target.person(1000).x == pytest.approx(3.0)


def test_person_with_a_goal_avoids_pedestrians():
    def walk(*others):
        target = Target(Goal(goal_m=(6.0, 0.0), speed_m_s=1.0))
        crowd = m.People(persons=(m.Person(id="target"), *others))
        outputs = [target.tick(k, Pose2D(2.0), people=crowd) for k in range(800)]
        return [pose_of(one[keys.TARGET_ODOM]) for one in outputs]

    alone, past = walk(), walk(m.Person(id="walker_1", pose=m.Pose.planar(Pose2D(3.0, 0.3))))
    assert max(abs(pose.y) for pose in alone) < 0.25  # fluctuations
    assert min(pose.distance(Pose2D(3.0, 0.3)) for pose in past) > 0.4  # the radii of two bodies
    assert all(walked[-1].distance(Pose2D(6.0)) < 0.6 for walked in (alone, past))


def test_end_of_a_walk_is_reported():
    target = Target(Straight(speed_m_s=1.0, length_m=3.0))
    target.person(299)
    assert "walk_ended" not in target.node.diagnostics()
    target.person(300)
    assert target.node.diagnostics()["walk_ended"] is True
    for path in (DRIVEN, Circle(), Standing()):
        endless = Target(path)
        endless.person(100_000)
        assert "walk_ended" not in endless.node.diagnostics()


def test_skeleton_walks_with_the_person():
    target = Target(Straight(speed_m_s=1.0), kind="fused")
    ticks = {tick: target.tick(tick) for tick in range(201)}
    assert all((keys.TARGET_SKELETON in ticks[tick]) == (tick % 2 == 0) for tick in ticks)
    assert not any(keys.OBSERVATION in outputs for outputs in ticks.values())
    skeleton, person = ticks[200][keys.TARGET_SKELETON], pose_of(ticks[200][keys.TARGET_ODOM])
    assert skeleton.header.stamp.ns == 2_000_000_000
    assert len(skeleton.joints) == len(JOINTS)
    pelvis = skeleton.joints[INDEX["pelvis"]]
    # the pelvis sways about the way, by some centimetres at most
    assert math.hypot(pelvis.x - person.x, pelvis.y - person.y) < 0.06
    assert 0.8 < pelvis.z < 1.0


TRUTH = m.planar_odometry(m.Time(1), "world", "base_link", Pose2D(1.0, 2.0, 0.5), Twist2D(0.1))
COMMAND = m.Twist.planar(Twist2D(0.1, 0.2, 0.3))


@forged({"ground_truth/odom": [TRUTH], "target/cmd_vel": [COMMAND]})
def test_hostile_samples_do_no_lasting_harm(wrong):
    exact = SensorConfig(position_std_m=0.0, yaw_std_deg=0.0)
    scenario = Scenario(NEXUS, sensor=exact, target=TargetConfig(path=DRIVEN))
    rig = Rig("target", scenario, keys.TARGET_ODOM, keys.OBSERVATION)

    def run(number, tick, robot=ORIGIN):
        """Return the outputs of a tick of a run."""
        truth = m.planar_odometry(m.Time(), "world", "base_link", robot, Twist2D())
        return rig.put(keys.GROUND_TRUTH, truth, rig.at(tick, number))

    run(1, 0)
    rig.put_wrong(wrong)
    for sample in run(1, 5):
        assert_sendable(sample)
    last = 2**32 - 1
    assert run(last, 0)[0].message.pose.pose.to_planar() == Pose2D()
    rig.bus.put_bytes("target/cmd_vel", b'{"linear":{"x":1.0}}')
    for tick in range(1, 4):
        (odom,) = run(last, tick)
        assert (odom.key, odom.stamp) == ("target/odom", rig.at(tick, last))
        assert odom.message.pose.pose.position.x == pytest.approx(0.01 * tick)
    _, frame = run(last, 4, Pose2D(y=1.0))
    assert (frame.key, frame.stamp) == ("target/observation", rig.at(4, last))
    assert frame.message.poses[0].pose.to_planar() == pytest.approx((0.04, -1.0, 0.0))


WALKERS = (
    "crowd.walkers=[{ path = { kind = 'goal', x_m = 3.0, goal_m = [0.0, 3.0] }, "
    "body = { height_m = 1.1 } }, { path = { kind = 'straight', y_m = -2.0, speed_m_s = 1.0 } }]"
)


def moving(x, y):
    return m.planar_odometry(m.Time(), "world", "x", Pose2D(x, y, 0.0), Twist2D(0.5))


class Crowd(Steps):
    """The node, among robots and their persons who stand side by side."""

    def __init__(self, name, *settings):
        super().__init__(
            CrowdNode, load_scenario(SCENARIOS / f"{name}.toml", parse_settings(settings))
        )
        self.names = self.node.scenario.names

    def tick(self, tick):
        samples = {keys.CLOCK: m.Clock()}
        for y, robot in enumerate(self.names):
            samples[of_robot(keys.GROUND_TRUTH, robot)] = moving(-1.0, y)
            samples[of_robot(keys.TARGET_ODOM, robot)] = moving(0.0, y)
            skeleton = m.Skeleton(height=1.7, joints=(m.Point(y=y),) * len(JOINTS))
            samples[of_robot(keys.TARGET_SKELETON, robot)] = skeleton
        return self.step(tick, samples).get(keys.PEOPLE)


def test_people_are_published_at_the_skeletons_rate():
    crowd = Crowd("senses", WALKERS)
    frames = {tick: crowd.tick(tick) for tick in range(5)}
    assert [tick for tick, frame in frames.items() if frame] == [0, 2, 4]
    frame = frames[4]
    assert [one.id for one in frame.persons] == ["target", "walker_1", "walker_2"]
    assert [one.height for one in frame.persons] == [1.7, 1.1, 1.75]
    assert all(len(one.joints) == len(JOINTS) for one in frame.persons)
    # the child's head is above where it stands: 0.93 of 1.1 m by Winter's table, and half a head
    child = frame.persons[1]
    assert 0.9 < max(joint.z for joint in child.joints) < 1.1
    assert frame.persons[2].pose.position.x == pytest.approx(0.04)
    assert [one.name for one in frame.robots] == ["robot"]
    assert frame.robots[0].pose.position.x == -1.0


TICKS = range(0, 260, 2)


def test_added_people_have_their_own_time():
    def run(changes):
        crowd, frames = Crowd("senses", WALKERS), {}
        for tick in TICKS:
            if tick in changes:
                crowd.node.configure(changed(crowd.node.scenario, changes[tick]))
            persons = crowd.tick(tick).persons
            frames[tick] = {person.id: person for person in persons}
        return frames

    straight = {"kind": "straight", "x_m": 20.0, "speed_m_s": 1.0, "start_after_s": 0.5}
    box = {"kind": "box", "size_m": [0.5, 0.5, 1.0], "position_m": [32.0, -0.3]}
    frames = run(
        {
            20: {"world.added.anna": {"kind": "person", "path": straight, "height_m": 1.6}},
            40: {"world.added.bob": {"kind": "person"}, "world.added.box": box},
            200: {"world.added.anna": None},
        }
    )
    assert [tick for tick, persons in frames.items() if "anna" in persons] == [*range(20, 200, 2)]
    anna = frames[120]["anna"]
    assert anna.pose.position.x == pytest.approx(20.5)
    assert (anna.height, len(anna.joints)) == (1.6, len(JOINTS))
    assert [tick for tick, persons in frames.items() if "bob" in persons] == [*range(40, 260, 2)]
    plain = run({})
    ways, before = (
        [[seen[tick][name] for tick in TICKS] for name in ("walker_1", "walker_2")]
        for seen in (frames, plain)
    )
    assert ways[0] != before[0]  # a person with a goal gives way to bob
    assert ways[1] == before[1]


def test_recorded_people_are_there_while_they_walk(tmp_path):
    (tmp_path / "walk.csv").write_text("t_s,x_m,y_m\n0,0,0\n1,1,0\n2,2,0\n")
    path = f"{{ kind = 'recorded', file = '{tmp_path}/walk.csv', start_after_s = 1.0, x_m = 3.0 }}"
    walker = f"crowd.walkers=[{{ enters_and_leaves = true, path = {path} }}]"
    crowd = Crowd("senses", walker)
    frames = [(tick, crowd.tick(tick).persons[1:]) for tick in range(0, 400, 2)]
    present = {tick: persons[0] for tick, persons in frames if persons}
    assert list(present) == [*range(100, 300, 2)]  # of 10 ms
    assert present[200].pose.position.x == pytest.approx(4.0)
    assert all(person.id == "walker_1" for person in present.values())
    # the robot is at x = -1
    crowd = Crowd("senses", walker.replace("x_m = 3.0", "x_m = -1.0"))
    places = [crowd.tick(tick).persons[1:] for tick in range(100, 300, 2)]
    assert 0.5 < next(persons[0].pose.position.x + 1.0 for persons in places if persons) < 1.0


def test_all_robots_and_their_persons_are_published():
    frame = Crowd("convoy", "sensor.kind=fused").tick(0)
    assert [one.id for one in frame.persons] == ["one", "two"]
    assert [one.pose.position.y for one in frame.persons] == [0.0, 1.0]
    assert [one.name for one in frame.robots] == ["one", "two"]


def test_a_run_begun_anew_is_the_same_again():
    crowd = Crowd("crowd")
    first = [crowd.tick(tick) for tick in range(0, 60, 2)]
    crowd.reset(crowd.node.scenario.seed)
    assert [crowd.tick(tick) for tick in range(0, 60, 2)] == first
    crowd.reset(99)
    assert crowd.tick(0) != first[0]
