"""Kills and freezes at random moments: whoever fails, the robot stays sane and follows again.

`--scale N` makes N hundreds of them, each with its own seed. `--log FILE` keeps each in a line of
JSON, and continues after those hundreds that are in the file, so that a long series may be divided.
"""

from contextlib import closing
from pathlib import Path
from statistics import median

import msgspec
from faults import FREEZING, PARTS, WALK, Following, Strike, strikes
from harness import SCENARIOS
from stack import Stack

EACH = 100
"""Kills and freezes of a run."""
SEED = 7


def test_after_each_kill_and_each_freeze_the_robot_follows_again(scale, request, tmp_path):
    log = Path(request.config.getoption("--log") or tmp_path / "chaos.jsonl")
    done = read(log)
    for seed in range(SEED + len(done) // EACH, SEED + scale):
        done = done[: (seed - SEED) * EACH]  # a run that was cut short begins again
        with closing(Stack(SCENARIOS / "circle.toml", WALK, restart=True)) as stack:
            for struck in strikes(Following(stack, restart=True), EACH, seed):
                done.append(struck)
                print(f"{len(done):4} {struck}", flush=True)
        log.write_bytes(b"".join(msgspec.json.encode(one) + b"\n" for one in done))
    report(done)
    assert all(struck.in_time for struck in done)


def read(log: Path) -> list[Strike]:
    """Return the kills and freezes of earlier runs."""
    lines = log.read_text().splitlines() if log.exists() else []
    return [msgspec.json.decode(line, type=Strike) for line in lines]


def report(done: list[Strike]) -> None:
    """Print what it took, by what failed."""
    print(f"\n{len(done)} kills and freezes, {EACH} with each seed from {SEED} on;")
    print("back: wall time from the kill until ready again, or of the freeze;")
    print("follows: simulated time from then on")
    print(f"{'':22}{'number':>8}{'back p50':>10}{'max':>7}{'follows p50':>13}{'max':>7}")
    killed = [struck for struck in done if not struck.frozen]
    frozen = [struck for struck in done if struck.frozen]
    groups = {f"{name} killed": [s for s in killed if s.names == (name,)] for name in PARTS}
    groups |= {"two killed at once": [s for s in killed if len(s.names) == 2]}
    groups |= {f"{name} frozen": [s for s in frozen if s.names == (name,)] for name in FREEZING}
    groups |= {"all": done}
    for name, group in groups.items():
        back = [struck.back_s for struck in group]
        resumed = [struck.resumed_s for struck in group]
        print(
            f"{name:22}{len(group):8}{median(back):9.2f}s{max(back):6.2f}s"
            f"{median(resumed):12.2f}s{max(resumed):6.2f}s"
        )
    print(f"fastest {max(s.fastest_m_s for s in done):.2f} m/s, ", end="")
    print(f"hardest change {max(s.hardest_m_s2 for s in done):.2f} m/s² over 0.2 s")
