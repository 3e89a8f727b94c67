"""Kills and freezes at random moments: whoever fails, the robot stays sane and follows again.

`--scale N` makes N hundreds of them, each with its own seed. `--log FILE` keeps each in a line of
JSON, and continues after those hundreds that are in the file, so that a long series may be divided.
"""

from contextlib import closing
from pathlib import Path

import msgspec
from faults import WALK, Following, Strike, strikes
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
    assert all(struck.in_time for struck in done)


def read(log: Path) -> list[Strike]:
    """Return the kills and freezes of earlier runs."""
    lines = log.read_text().splitlines() if log.exists() else []
    return [msgspec.json.decode(line, type=Strike) for line in lines]
