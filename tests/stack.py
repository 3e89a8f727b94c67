"""Whole systems as processes, each at a port and a namespace of its own."""

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from harness import wait
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import Process, Scenario
from mecazen.errors import BusError
from mecazen.keys import AnswerT, Call, RequestT
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import ResetRequest
from mecazen.robots import join_key
from mecazen.runtime.pace import RECORD, declare_every
from mecazen_tools.processes import Supervisor, private_router
from mecazen_tools.trajectory import Trajectory


class Stack:
    """The processes of a scenario, and a bus that watches them.

    With `restart` those that end are started again.
    """

    def __init__(self, path: Path, settings: tuple[str, ...], *, restart: bool = False) -> None:
        secure = any(setting.startswith("bus.keys=") for setting in settings)
        self.settings = (*settings, *private_router("tls" if secure else "tcp"))
        self.scenario: Scenario = load_scenario(path, parse_settings(self.settings))
        self.supervisor = Supervisor(path, self.settings, restart=restart)
        self.supervisor.start_router()
        self.bus = ZenohBus(self.scenario.bus)
        self.bus.declare_alive("test")
        if self.scenario.sim.mode == "lockstep":
            declare_every(self.bus, RECORD)

    @property
    def endpoint(self) -> str:
        """Where tools connect."""
        return self.scenario.bus.connect[0]

    def start(self) -> None:
        """Start every process, and wait until all services, of each robot, are ready."""
        for process in self.scenario.process_plan:
            self.supervisor.start(process)
        ready = {join_key(f"{part}/ready", robot) for part, robot in self.scenario.parts}
        self.wait(lambda: ready <= self.bus.presence.names)

    def watch(self, trajectory: Trajectory) -> int:
        """Begin the run again once this bus hears every publisher; return the number of the run.

        Services do not wait for this bus, so its links may come after the first ticks.
        """
        self.wait(lambda: trajectory.done)
        run = None
        while run is None:
            try:
                run = self.call(keys.SIM_RESET, ResetRequest(seed=self.scenario.seed), 2.0).run
            except BusError:  # the clock waits until this bus has taken its samples
                self.bus.drain()
        trajectory.reset()
        return run

    def call(
        self, call: Call[RequestT, AnswerT], request: RequestT, timeout_s: float = 10.0
    ) -> AnswerT:
        """Query a service as tools do, by a client, whose queries all go to the router.

        The bus of a stack is a peer: while its links change, a query may end without an answer.
        """
        with closing(ZenohBus(self.scenario.bus, "client")) as tool:
            return tool.call(call, request, timeout_s)

    def launch(self, *services: str, needed: bool = True) -> None:
        """Start services of a single robot, each in a process of its own."""
        for service in services:
            self.supervisor.start(Process((service,)), needed=needed)

    def wait(self, condition: Callable[[], bool]) -> None:
        """Deliver samples until a condition holds; a process that ends is an error."""
        self.wait_unwatched(lambda: self.supervisor.poll(0.0) is None and condition())

    def wait_unwatched(self, condition: Callable[[], bool]) -> None:
        """Deliver samples until a condition holds, whichever process ends meanwhile."""
        wait(self.bus, condition)

    def memory(self, kind: str = "pss") -> dict[str, int]:
        """Return the memory of each process; what several share is divided among them [bytes]."""
        import psutil  # only tests of whole systems have it

        pids = self.supervisor.pids.items()
        return {name: getattr(psutil.Process(pid).memory_full_info(), kind) for name, pid in pids}

    def close(self) -> None:
        """End everything."""
        self.bus.close()
        self.supervisor.stop()
