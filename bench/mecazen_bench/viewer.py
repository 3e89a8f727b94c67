"""The viewer beside a run in real time: processor time and memory."""

from __future__ import annotations

from contextlib import closing

from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import Process
from mecazen.errors import MecazenError

from mecazen_bench.figures import Group, Target
from mecazen_bench.stack import START_S, Usage, running, spin

WINDOW_S = 6.0
"""Of the measurement; a quarter of it before that warms up."""

CPU_PERCENT = Target(high=10.0)
MEMORY_MB = Target(high=300.0)


def run(window_s: float = WINDOW_S) -> list[Group]:
    """Run the scenario `side` with a viewer to which no browser is attached."""
    with running("side", "viewer.web_port=0", "viewer.data_port=0") as stack:
        stack.supervisor.start(Process(("viewer",)))
        lines = iter(lambda: stack.supervisor.poll(START_S), None)
        if not any(line.is_address for line in lines):
            raise MecazenError("the viewer does not serve")
        with closing(ZenohBus(stack.scenario.bus, "client")) as bus:
            bus.subscribe(keys.CLOCK, lambda *_: None)
            spin(bus, window_s / 4)
            service = stack.processes()["viewer"]
            usage = Usage({"service": service, "Rerun's server": service.children()[0]})
            spin(bus, window_s)
            rows = usage.rows(CPU_PERCENT, "less", MEMORY_MB)
    how = f"real time, 30 frames a second, no browser; over {window_s:g} s; resident memory"
    return [Group("Viewer: scenario side", how, tuple(rows))]
