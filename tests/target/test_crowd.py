"""The crowd as a node: the persons that it reports, the ticks, and the limits of a scenario."""

import pytest
from harness import SCENARIOS, Steps
from mecazen import keys
from mecazen.geometry import Pose2D, Twist2D
from mecazen.keys import of_robot
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import Clock, Point, Skeleton, Time, planar_odometry
from mecazen.parameters import changed
from mecazen.skeleton import JOINTS
from mecazen_target.crowd import CrowdNode

WALKERS = (
    "crowd.walkers=[{ path = { kind = 'goal', x_m = 3.0, goal_m = [0.0, 3.0] }, "
    "body = { height_m = 1.1 } }, { path = { kind = 'straight', y_m = -2.0, speed_m_s = 1.0 } }]"
)


def moving(x, y):
    return planar_odometry(Time(), "world", "x", Pose2D(x, y, 0.0), Twist2D(0.5))


class Crowd(Steps):
    """The node, among robots and their persons who stand side by side."""

    def __init__(self, name, *settings):
        super().__init__(
            CrowdNode, load_scenario(SCENARIOS / f"{name}.toml", parse_settings(settings))
        )
        self.names = self.node.scenario.names

    def tick(self, tick):
        samples = {keys.CLOCK: Clock()}
        for y, robot in enumerate(self.names):
            samples[of_robot(keys.GROUND_TRUTH, robot)] = moving(-1.0, y)
            samples[of_robot(keys.TARGET_ODOM, robot)] = moving(0.0, y)
            skeleton = Skeleton(height=1.7, joints=(Point(y=y),) * len(JOINTS))
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
