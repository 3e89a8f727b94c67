"""The guard's node: from cmd_vel and the scans to the command for the controller."""

from __future__ import annotations

import math

from mecazen import messages as m
from mecazen.commands import Commands, sources
from mecazen.config import Scenario
from mecazen.drive import Drive
from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D, PoseHistory, Twist2D, jumped
from mecazen.keys import GUARD_CMD_VEL, GUARD_STATE, ODOM, SCAN
from mecazen.node import Inputs, Node, Outputs, Tick
from mecazen.ticks import ROUNDING_S
from mecazen.wire import NS_PER_S

from mecazen_guard.guard import Guard, Verdict
from mecazen_guard.surroundings import Surroundings

HISTORY_NS = NS_PER_S
"""Time for which poses are kept [ns]; older scans are refused."""
SILENT_SCANS = 3.0
"""Number of scan periods without a scan after which a lidar counts as silent."""
STOPPED = 0.02
"""With a smaller factor the reported state is `stop`."""
SIDES = "ahead", "to the left", "behind", "to the right"


class GuardNode(Node):
    """Limits the command so that the robot can stop in time; zero if the lidar is unreliable."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        config, lidar, robot = scenario.guard, scenario.sensors.lidar, scenario.robot
        self.commands = Commands(sources(scenario))
        self.silence_s = SILENT_SCANS / lidar.rate_hz
        assert robot.lidar is not None
        self.surroundings = Surroundings(
            config, lidar, robot.lidar.pose, is_real=scenario.has_real_lidar
        )
        drive = Drive.from_scenario(scenario)
        self.guard = Guard(robot.footprint, drive, _reaction_s(scenario))

    def configure(self, scenario: Scenario) -> None:
        super().configure(scenario)
        self.commands.sources = sources(scenario)
        self.surroundings.config = scenario.guard
        self.guard.configure(Drive.from_scenario(scenario), _reaction_s(scenario))

    def reset(self, seed: int) -> None:
        self.surroundings.forget()
        self.poses = PoseHistory(HISTORY_NS)
        self.pose = Pose2D()
        self.commands.reset()
        self.fault = "no scan yet"
        self.state = m.GuardState(state="blind")

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the limited command of a tick, and the guard's state with the reason."""
        if tick.period_s > 0.0:  # if 0, a newer command replaces the one of this tick
            self._place(tick, inputs[ODOM])
        if (scan := inputs.get(SCAN)) is not None:
            self.fault = ""
            try:
                self.surroundings.update(scan, tick.time_ns / NS_PER_S, self.poses)
            except RefusedError as refusal:
                self.fault = str(refusal)
                inputs.refuse(SCAN, self.fault)
        wanted = self.commands.choose(inputs) or m.Twist()
        verdict, fault = self._decide(tick, wanted.to_planar())
        self.state = self._state(tick.time, verdict, fault)
        let_through = wanted if verdict.factor == 1.0 else m.Twist.planar(verdict.twist)
        return {GUARD_STATE: self.state, GUARD_CMD_VEL: let_through}

    def _place(self, tick: Tick, odom: m.Odometry) -> None:
        pose = odom.pose.pose.to_planar()
        if len(self.poses) == 0 or tick.period_s > self._obeyed_s + ROUNDING_S:
            self.guard.begin(odom.twist.twist.to_planar())
        elif jumped(self.pose, pose, tick.period_s):
            self.surroundings.forget()
            self.poses = PoseHistory(HISTORY_NS)
            self.fault = "the odometry was set, and there is no scan since"
        self.pose = pose
        self.poses.add(tick.time_ns, pose)

    @property
    def _obeyed_s(self) -> float:
        """Longest time for which the robot follows a command without a new one [s]."""
        return self.scenario.command_timeout_s + self.scenario.sim.tick_s

    def _decide(self, tick: Tick, wanted: Twist2D) -> tuple[Verdict, str]:
        """Return the verdict, and the fault of the lidar; "" if it has none."""
        seen = self.surroundings.time
        age_s = math.inf if seen is None else tick.time_ns / NS_PER_S - seen
        fault = self.fault
        if not fault and age_s > self.silence_s + ROUNDING_S:
            fault = f"the lidar has been silent for {age_s:.1f} s"
        if fault:
            wanted = Twist2D()
        points = self.surroundings.seen_from(self.pose)
        passed_s = min(tick.period_s, self._obeyed_s)
        verdict = self.guard.step(wanted, points, min(age_s, self.silence_s), passed_s)
        return (verdict._replace(factor=0.0) if fault else verdict), fault

    def _state(self, time: m.Time, verdict: Verdict, fault: str) -> m.GuardState:
        state, reason = "clear", ""
        if fault:
            state, reason = "blind", fault
        elif verdict.factor < 1.0:
            state = "stop" if verdict.factor < STOPPED else "slow"
            side = SIDES[round(verdict.bearing / (math.pi / 2.0)) % 4]
            reason = f"something is {max(verdict.distance, 0.0):.2f} m {side}"
        return m.GuardState(
            header=m.Header(stamp=time, frame_id="base_link"),
            state=state,
            factor=verdict.factor,
            reason=reason,
            distance=0.0 if math.isinf(verdict.distance) else max(verdict.distance, 0.0),
            bearing=verdict.bearing,
        )

    def diagnostics(self) -> dict[str, object]:
        state = {
            "drives": self.commands.driver,
            "guard": self.state.state,
            "let_through": round(self.state.factor, 2),
        }
        return state | ({"reason": self.state.reason} if self.state.reason else {})


def _reaction_s(scenario: Scenario) -> float:
    """Return the longest time for which the wheels follow a command after the next was due [s].

    The last tick of this time is the one in which the controller waits for a silent guard.
    """
    return scenario.guard.reaction_s + scenario.guard.hold_s + scenario.sim.tick_s
