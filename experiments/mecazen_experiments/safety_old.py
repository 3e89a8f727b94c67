"""The safety of following as a kind of experiment, as `followbench` still needs it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import msgspec
from mecazen.config import Scenario
from mecazen_tools.observe import Watched

from mecazen_experiments.report import Kind, Record, Row
from mecazen_experiments.safety import measure
from mecazen_experiments.statistics import most_per_hour
from mecazen_experiments.tables_old import Column

COLUMNS: tuple[Column, ...] = (
    ("contacts\nperson", "contacts_person", 0),
    ("person\nall", "contacts_person_all", 0),
    ("others", "contacts_others", 0),
    ("others\nall", "contacts_others_all", 0),
    ("walls", "contacts_walls", 0),
    ("gap \\[m]\nperson", "gap_person_m", 2),
    ("others", "gap_others_m", 2),
    ("walls", "gap_walls_m", 2),
    ("conflict\n\\[s]", "conflict_s", 2),
    ("in view\n\\[%]", "view_percent", 1),
    ("regain\n\\[s]", "regain_s", 2),
    ("D_err\n\\[m]", "d_err_m", 3),
    ("Θ_err\n\\[°]", "theta_err_deg", 1),
    ("frozen\n\\[s]", "frozen_s", 2),
    ("jerk\n\\[m/s³]", "jerk_rms_m_s3", 1),
)


class Safety(msgspec.Struct, frozen=True):
    """The measures of a run, see `safety.measure`."""

    contacts_person: int
    contacts_person_all: int
    contacts_others: int
    contacts_others_all: int
    contacts_walls: int
    gap_person_m: float | None
    gap_others_m: float | None
    gap_walls_m: float | None
    conflict_s: float
    view_percent: float
    regain_s: float
    d_err_m: float | None
    theta_err_deg: float | None
    frozen_s: float
    jerk_rms_m_s3: float | None
    time_s: float


def safety(run: Watched, scenario: Scenario) -> Safety:
    """Return the measures of a run."""
    return Safety(**measure(run, scenario))  # type: ignore[arg-type]


def _at_most(row: Row[Any]) -> str:
    caused = ("contacts_person", "contacts_others", "contacts_walls")
    most = most_per_hour(sum(row.sums[name] for name in caused), row.sums["time_s"] / 3600.0)
    return f"{most:.1f}"


MORE: Mapping[str, Callable[[Row[Any]], str]] = {"caused,\nat most\n\\[1/h]": _at_most}
SUMS = [name for name in Safety.__struct_fields__ if name.startswith("contacts_")] + ["time_s"]
SAFETY: Kind[Safety] = Kind(
    "safety",
    Record[Safety],
    lambda _: (_ for _ in ()).throw(NotImplementedError),
    msgspec.structs.asdict,
    sums=SUMS,
    least=[name for name in Safety.__struct_fields__ if name.startswith("gap_")],
)
