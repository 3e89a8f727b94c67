"""A world of a few lines, and a clock that advances it."""

from harness import Listener, load_robot
from mecazen import keys
from mecazen.bus import Bus
from mecazen.config import RobotConfig, Scenario, SimConfig, StartConfig
from mecazen.geometry import Pose2D, Twist2D
from mecazen.keys import of_robot
from mecazen.messages import JointState, Odometry, String, planar_odometry
from mecazen.node import Node
from mecazen.robots import join_key
from mecazen.runtime.clock import Clock
from mecazen.runtime.host import Host
from mecazen.wire import RefusedError

ALL = ("physics", "controller", "target", "follower")
ALONE = ("physics",)
STATES = (keys.CLOCK, keys.JOINT_STATES, keys.GROUND_TRUTH)


class Carts(Node):
    """Moves each robot at the speed of its newest command that is not backwards."""

    def reset(self, seed):
        self.x, self.speed = dict.fromkeys(self.scenario.names, 0.0), {}

    def step(self, tick, inputs):
        for name in self.x:
            topic = of_robot(keys.JOINT_COMMAND, name)
            command = inputs.get(topic)
            if command and command.velocity < (0.0,):
                inputs.refuse(topic, "backwards")
            elif command:
                self.speed[name] = command.velocity[0]
            self.age_s = inputs.age_s(topic)
            self.x[name] += self.speed.get(name, 0.0) * tick.period_s * bool(tick.number)
        return {
            of_robot(topic, name): message
            for name, x in self.x.items()
            for topic, message in state(tick, Pose2D(x=x)).items()
        }

    def answer(self, call, request):
        robot = call.key.rpartition("/")[0]
        if robot == "blue":
            raise RefusedError("shy")
        return String(data=f"<robot {robot}>")

    def files(self):
        names = self.scenario.names
        return {join_key("robot_description", n): {"cart.stl": n.encode()} for n in names}

    def diagnostics(self):
        return {"age_s": self.age_s}


def state(tick, pose):
    truth = planar_odometry(tick.time, "world", "base_link", pose, Twist2D())
    return {keys.JOINT_STATES: JointState(header=truth.header), keys.GROUND_TRUTH: truth}


class Answer:
    """A reply that may come later than the request."""

    message = error = None

    def answer(self, message):
        assert self.message is self.error is None
        self.message = message

    def refuse(self, reason):
        assert self.message is self.error is None
        self.error = reason


class Rig:
    """The clock at the first tick of a run; the test answers its ticks."""

    def __init__(self, services=ALL, *names, kind=Carts, begin=True, programs=None, **sim):
        sim = SimConfig(**{"mode": "lockstep", "answer_timeout_s": 1e-3, **sim})
        robots = tuple(
            RobotConfig(name=name, start=StartConfig(y_m=2.0 * number))
            for number, name in enumerate(names)
        )
        self.scenario = Scenario(
            load_robot(), services, programs or {}, seed=3, sim=sim, robots=robots
        )
        self.bus = Bus()
        self.clock = Clock(Host([("physics", "")], self.bus, self.scenario, {"physics": kind}))
        self.world = self.clock.host.loop.turns[1].running
        self.samples = {
            name: Listener(self.bus, *(of_robot(topic, name) for topic in STATES))
            for name in self.scenario.names
        }
        self.health = Listener(self.bus, keys.diagnostics("physics"))
        for part, robot in self.scenario.parts:
            self.bus.declare_alive(part, robot)
        if begin:
            self.clock.begin()

    def answer(self, *parts, name="", speed=1.0, stamp=None):
        """Answer the tick for the controller, the target or both."""
        for part in parts or ("controller", "target"):
            topic = keys.JOINT_COMMAND if part == "controller" else keys.TARGET_ODOM
            message = JointState(velocity=(speed,)) if part == "controller" else Odometry()
            self.bus.publisher(of_robot(topic, name)).put(message, stamp or self.clock.stamp)

    def tick(self, *parts, **answer):
        """Answer the tick for services of all robots; return the samples of the next tick."""
        for name in self.samples:
            self.answer(*parts, name=name, **answer)
        self.clock.step()
        return self.take()

    def take(self, name=None):
        return self.samples[next(iter(self.samples)) if name is None else name].take()

    def ask(self, call, request):
        """Query a key that is answered later."""
        answer = Answer()
        self.bus.server(call)(request, answer)
        return answer


def x_of(samples):
    """Return where a cart is by its last sample [m]."""
    return samples[-1].message.pose.pose.position.x
