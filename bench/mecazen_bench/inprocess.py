"""A scenario's services in this process, tick by tick."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, cast

from mecazen.bus import Bus, LocalBus
from mecazen.config import Scenario
from mecazen.runtime import find_service
from mecazen_tools.simulate import in_lockstep
from mecazen_tools.trajectory import Trajectory


class InProcess:
    """The services of a scenario of one robot on the bus within this process, in lockstep.

    Args:
        scenario: What to simulate.
        seen_by: Returns the bus as a part sees it; the last part is the trajectory.
    """

    def __init__(
        self, scenario: Scenario, seen_by: Callable[[LocalBus, str], Bus] = lambda bus, _: bus
    ) -> None:
        scenario = in_lockstep(scenario)
        self._sim = scenario.sim
        self.bus = LocalBus()
        bus = seen_by(self.bus, "trajectory")
        self.trajectory = Trajectory(bus, self._sim.tick_ns, self._sim.ticks, scenario.services)
        self._parts = {
            part: find_service(part, scenario)(seen_by(self.bus, part), scenario)
            for part in scenario.services
        }
        for part in self._parts:
            self.bus.declare_alive(part)

    def ticks(self) -> Iterator[None]:
        """Run it whole; stop at each tick when it is answered, before physics goes on."""
        physics = cast(Any, self._parts["physics"])  # its class is not known here
        physics.begin()
        for _ in range(1, self._sim.ticks):
            physics.await_answers()
            yield
            physics.step()
        physics.await_answers()
        self.bus.spin()

    def close(self) -> None:
        """End the services."""
        for part in self._parts.values():
            part.close()
