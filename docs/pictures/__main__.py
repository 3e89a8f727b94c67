"""Makes the pictures of the documents that `make results` does not make.

Run from the repository by `make pictures`, or for some pictures: ONLY="hero viewer".
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

from docs.pictures import charts, gallery, guarded, hero, rollers, viewer

DOCS = Path(__file__).parents[1]
PICTURES: dict[str, Callable[[Path], None]] = {
    "figures/convoy.png": gallery.convoy,
    "figures/corridor.png": partial(guarded.strip, name="corridor"),
    "figures/door.png": partial(guarded.strip, name="door"),
    "figures/engines.png": charts.engines,
    "figures/guard.png": partial(guarded.one, name="door", time_s=7.2, size=gallery.SIZE_PX),
    "figures/hard_stop.png": partial(guarded.strip, name="hard_stop"),
    "figures/hero.webp": hero.draw,
    "figures/places.png": gallery.places,
    "figures/planner.png": gallery.planner,
    "figures/rollers.png": rollers.draw,
    "figures/sensors.png": gallery.sensors,
    "senses.png": partial(viewer.scene, scenario="senses", at_s=7.0),
    "viewer.png": partial(viewer.views, scenario="side", at_s=37.0),
}
"""The function that draws each picture, by its path in docs/."""


def main(names: list[str]) -> None:
    """Draw pictures by their names without suffix, or all."""
    known = {Path(place).stem: place for place in PICTURES}
    if unknown := sorted(set(names) - set(known)):
        sys.exit(f"no picture {unknown[0]!r}; pictures: {', '.join(known)}")
    for name in names or known:
        file = DOCS / known[name]
        PICTURES[known[name]](file)
        print(f"docs/{known[name]}: {file.stat().st_size / 1000:.0f} kB", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
