"""A one-page report of a recorded walk."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import RenderableType
from rich.table import Table

from mecazen_experiments.gait.curves import (
    JOINTS,
    NORM_NOTICE,
    MeanSd,
    curves,
    norm,
    variable_scores,
)
from mecazen_experiments.gait.parameters import PARAMETERS, Gait, Parameter
from mecazen_experiments.gait.recorded import RecordedWalk

HIDDEN_PERCENT = 90.0
"""Joints that are seen in a smaller share of the frames are listed."""
FAR = 2.0
"""Number of standard deviations from the norm beyond which values are marked with a star."""


def report(walk: RecordedWalk, title: str) -> Iterator[RenderableType]:
    """Yield the output of `mecazen gait`."""
    yield f"[b]{title}, run {walk.run}, seed {walk.seed}[/]"
    yield (
        f"Seen from: {walk.view} ({walk.bearing_deg:.0f}° from straight ahead), "
        f"{walk.distance_m:.2f} m; a body in {walk.reported_percent:.0f} % of the frames"
    )
    hidden = {name: share for name, share in walk.seen_percent.items() if share < HIDDEN_PERCENT}
    listed = ", ".join(f"{name} {share:.0f} %" for name, share in hidden.items())
    yield f"Seen in less than {HIDDEN_PERCENT:g} % of the frames: {listed or 'no joint'}"
    refined = walk.stages.get("refined")
    gait = None if refined is None else refined.gait
    if refined is None or gait is None:
        yield "No stride was found."
        return
    strides = ", ".join(
        f"{sum(one.side == s for one in refined.strides)} {s}" for s in ("left", "right")
    )
    yield f"Strides: {strides}. * is farther than {FAR:g} SD from the norm."
    yield _parameters(walk, gait)
    yield _curves(walk)
    for side, scores in variable_scores(curves(refined)).items():
        each = ", ".join(f"{joint} {getattr(scores, joint):.1f}°" for joint in JOINTS)
        yield f"{side}: GVS {each}; sagittal GPS (3 of 9 variables) {scores.sagittal_gps:.1f}°"
    yield f"[dim]{NORM_NOTICE}[/]"


def _parameters(walk: RecordedWalk, gait: Gait) -> Table:
    """Return the parameters of refined joints, with the deviations of filtered joints."""
    at = norm().nearest(gait.mean("speed_m_s"))
    table = Table("", "left", "right", "asymmetry", "SD", title="Parameters")
    filtered = walk.stages["filtered"].gait
    truth = walk.stages["truth"].gait if "truth" in walk.stages else None
    if truth is not None:
        table.add_column("truth")
    table.add_column(f"norm, {at.name}")
    for name, parameter in PARAMETERS.items():
        sd = None if filtered is None else filtered.sd(name)
        row = [
            f"{parameter.title} \\[{parameter.unit}]",
            _shown(gait.left[name].mean, parameter),
            _shown(gait.right[name].mean, parameter),
            f"{gait.asymmetry_percent(name):.1f} %",
            "" if sd is None else _shown(sd, parameter),
        ]
        if truth is not None:
            row.append(_shown(truth.mean(name), parameter))
        known: MeanSd | None = getattr(at, name, None)
        if known is None:
            row.append("")
        else:
            mean, spread = known
            far = "*" * (abs(gait.mean(name) - mean) > FAR * spread)
            row.append(f"{_shown(mean, parameter)} ± {_shown(spread, parameter)} {far}")
        table.add_row(*row)
    return table


def _curves(walk: RecordedWalk) -> Table:
    """Return angles every 10 % of the gait cycle beside the norm."""
    found, of = curves(walk.stages["refined"]), norm().curves
    table = Table("cycle \\[%]", title=f"Angles \\[°]; norm at {of.speed_m_s:g} m/s")
    for joint in JOINTS:
        for head in (f"{joint}\nleft", "\nright", "\nnorm"):
            table.add_column(head)
    for percent in range(0, 101, 10):
        row = [str(percent)]
        for joint in JOINTS:
            mean, sd = (of.at_all(values[joint])[percent] for values in (of.deg, of.sd_deg))
            for side in ("left", "right"):
                value = found[side, joint].mean[percent]
                row.append(f"{value:.0f}{'*' * bool(abs(value - mean) > FAR * sd)}")
            row.append(f"{mean:.0f} ± {sd:.0f}")
        table.add_row(*row)
    return table


def _shown(value: float, parameter: Parameter) -> str:
    return f"{parameter.scale * value:.{parameter.digits}f}"
