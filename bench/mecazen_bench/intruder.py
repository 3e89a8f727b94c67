"""A client fuzzes a stack of processes, open or secured: nothing that it sends changes it."""

from __future__ import annotations

import math
import random
import tempfile
import time
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any

from mecazen import keys
from mecazen.bus.session import open_session
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.errors import BusError
from mecazen.graph import COLLECTOR
from mecazen.loading import load_scenario
from mecazen.messages import Empty, Message
from mecazen.runtime.readiness import announce_readiness
from mecazen.wire import ENCODINGS, MAX_MESSAGE_BYTES, encode
from mecazen_tools import certificates
from mecazen_tools.simulate import simulate
from mecazen_tools.trajectory import Trajectory

from mecazen_bench.figures import Figure, Group, Row, Target
from mecazen_bench.flood import SECURE
from mecazen_bench.malformed import CALLS, NONE, SEED, TICKS, Budget, Malformed, sample_messages
from mecazen_bench.stack import SCENARIOS, Usage, running, spin_until

PAYLOADS = 100_000
"""Payloads sent to each stack, where the option does not say another number."""
BATCH = 200
POOL = 50_000
"""Malformed payloads that are made beforehand, and sent again and again in a random order."""
HUGE_EVERY = 100_000
"""One in so many is longer than a link takes, and has it closed."""
EXPRESSIONS = ("**", "*", "*/odom", "sim/*", "diagnostics/*", "**/cmd_vel")
SIZES = (1, 15, 17, 40, 2000, 70_000)
"""Of attachments that are no stamps."""
OPEN_QUERIES = 50
"""Of the intruder wait for their answers at most, so that services look at every one: they refuse
unread what comes while a hundred wait."""
ASKED = 20
"""Sessions of tools that ask what simulated time does, once the intruder has gone."""
GROWTH_MB = Target(high=64.0)
"""Of any one process: a service may keep 16 samples of 64 KiB on each of its keys."""


class Intruder:
    """Sends payloads that must be refused: malformed, or good ones in a wrong way.

    Args:
        session: A client's.
        good: Real messages by key.
        pool: So many malformed payloads are made, and sent again and again in a random order.
        forge: Whether good messages with forged stamps are among them, on the keys themselves:
            only access control refuses these.
    """

    def __init__(
        self,
        session: Any,
        good: Mapping[str, Sequence[Message]],
        pool: int,
        *,
        forge: bool,
    ) -> None:
        self._session = session
        self._random = random.Random(SEED)  # noqa: S311
        self._forge = forge
        self._pool = list(islice(Malformed(good), pool))
        self._good = [
            (key, encode(m, f)) for key, of in good.items() for m in of for f in ENCODINGS
        ]
        self._puts = [(key, payload) for key, payload in self._good if key not in CALLS]
        self._tokens: list[Any] = []
        self._asked: deque[tuple[Any, bool]] = deque()
        self.sent = 0
        self.accepted = 0
        """Malformed queries that were answered otherwise than with an error."""

    def send(self, count: int) -> None:
        """Send some more."""
        for _ in range(count):
            self.sent += 1
            if self.sent % HUGE_EVERY == 0:
                self._session.put("cmd_vel", bytes(2 * MAX_MESSAGE_BYTES))
            else:
                self._send_one(self._random.random())

    def _send_one(self, which: float) -> None:
        choice = self._random.choice
        if which < 0.85:
            key, payload, label, attachment = choice(self._pool)
            if key in CALLS:
                self._ask(key, payload, attachment, malformed=True)
            else:
                self._session.put(key, payload, encoding=label or None, attachment=attachment)
        elif which < 0.90:
            self._session.put(choice(EXPRESSIONS), choice(self._puts)[1])
        elif which < 0.93:
            self._ask(choice(EXPRESSIONS), choice(self._good)[1], None, malformed=False)
        elif which < 0.98:
            key, payload = choice(self._puts)
            sizes = (*SIZES, 16) if self._forge else SIZES
            self._session.put(key, payload, attachment=self._random.randbytes(choice(sizes)))
        else:
            name = f"mecazen/[/{self._random.randrange(1000)}]\x1b"
            self._tokens.append(self._session.liveliness().declare_token(name))
            if len(self._tokens) > 100:
                self._tokens.pop(0).undeclare()

    def _ask(self, key: str, payload: bytes, attachment: bytes | None, *, malformed: bool) -> None:
        replies = self._session.get(key, payload=payload, attachment=attachment, timeout=1.0)
        self._asked.append((replies, malformed))
        self.take_answers(OPEN_QUERIES)

    def take_answers(self, wait: int = 0) -> None:
        """Wait for the answers to all queries but the newest."""
        while len(self._asked) > wait:
            replies, malformed = self._asked.popleft()
            for reply in replies:
                self.accepted += malformed and reply.ok is not None


def run(payloads: int = PAYLOADS, ticks: int = TICKS, minutes: float = math.inf) -> Group:
    """Fuzz an open and a secured stack of processes over Zenoh."""
    scenario = load_scenario(SCENARIOS / "back.toml", ("sim.duration_s=1.0",))
    good = sample_messages(scenario)
    rows = [measure(good, payloads, ticks, minutes, secure=secure) for secure in (False, True)]
    how = (
        f"one client, with a viewer's certificate on the secured stack, during {ticks} ticks of "
        f"lockstep and after them, seed {SEED}; memory of all processes after a quarter of the "
        "payloads and at the end, then tools ask for the state"
    )
    return Group("Intruder: scenario back as processes", how, tuple(rows))


def measure(
    good: Mapping[str, Sequence[Message]],
    payloads: int,
    ticks: int,
    minutes: float = math.inf,
    *,
    secure: bool,
) -> Row:
    """Fuzz the scenario `back` in lockstep as processes, while it runs and after its end."""
    name = "secured stack" if secure else "open stack"
    path = SCENARIOS / "back.toml"
    duration = f"sim.duration_s={ticks / 100}"
    plain = load_scenario(path, (duration,))
    expected = simulate(plain, "back")[0].trajectory_sha256
    services = plain.services
    with tempfile.TemporaryDirectory() as folder:
        settings = [duration, "sim.mode=lockstep"]
        settings.append(f"services={[*services, COLLECTOR]}".replace("'", '"'))
        if secure:
            certificates.create(Path(folder) / "keys")
            settings += [f"bus.zenoh_config={SECURE}", f"bus.keys={folder}/keys"]
        protocol: Any = "tls" if secure else "tcp"
        with running("back", *settings, services=services, protocol=protocol) as stack:
            scenario = stack.scenario
            with (
                closing(ZenohBus(scenario.bus, lossless=True, name=COLLECTOR)) as bus,
                open_session(scenario.bus, "client", "viewer") as session,
            ):
                trajectory = Trajectory(bus, scenario.sim.tick_ns, ticks, services)
                intruder = Intruder(session, good, min(POOL, payloads), forge=secure)
                declare_alive(bus, COLLECTOR, scenario)
                announce_readiness(bus, COLLECTOR, scenario)
                spin_until(bus, lambda: trajectory.done, "no tick is answered")
                usage = Usage(stack.processes())
                before: dict[str, float] = {}
                processes = stack.processes().values()
                budget = Budget(name, payloads, minutes)
                rate, spent, crashes = 0.0, 0.0, 0
                while not crashes and not (rate and trajectory.complete):
                    if spent >= 1.0:
                        intruder.take_answers()
                        rate = rate or budget.rate(intruder.sent)
                    # a tenth of them at least while it runs
                    elif intruder.sent * ticks < payloads * max(1, trajectory.done) * 10:
                        intruder.send(min(BATCH, payloads - intruder.sent))
                    bus.spin_once(0.0 if trajectory.complete else 0.01)
                    bus.drain()
                    crashes = sum(not process.is_running() for process in processes)
                    spent = budget.spent(
                        intruder.sent, lambda: f"{sum(usage.memory_mb().values()):.0f} MB"
                    )
                    if not before and spent >= 0.25:
                        before = usage.memory_mb()
            unanswered, slowest_s = _ask_as_tools(scenario.bus, ticks)
            after = usage.memory_mb()
    figures = {
        "payloads": Figure.of(intruder.sent, "more"),
        "accepted": Figure.of(intruder.accepted, NONE),
        "payloads/s": Figure.of(rate, "more"),
        "trajectories that differ": Figure.of(trajectory.sha256() != expected, NONE),
        "crashes": Figure.of(crashes, NONE),
        "MB before": Figure.of(sum(before.values()), "less"),
        "MB after": Figure.of(sum(after.values()), "less"),
        "largest growth MB": Figure.of(max(after[n] - before[n] for n in before), GROWTH_MB),
        "tools not answered": Figure.of(unanswered, NONE),
        "slowest answer ms": Figure.of(1e3 * slowest_s, "less"),
    }
    return Row(name, figures)


def _ask_as_tools(config: Any, ticks: int) -> tuple[int, float]:
    """Ask what simulated time does, as a tool does; return how often nobody answered, or wrongly.

    The slowest answer comes with it [s], from the opening of the session on.
    """
    wrong, slowest_s = 0, 0.0
    for _ in range(ASKED):
        begin = time.perf_counter()
        try:
            with closing(ZenohBus(config, "client", lossless=True)) as bus:
                state = bus.call(keys.SIM_STATE, Empty())
            wrong += state.tick != ticks - 1 or state.paused
        except BusError:
            wrong += 1
        slowest_s = max(slowest_s, time.perf_counter() - begin)
    return wrong, slowest_s
