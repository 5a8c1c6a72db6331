"""Options of a seed scene: which recorded moment, or how a map is populated."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from scex_sumo.base.errors import UsageError
from scex_sumo.base.options import option

INPUT: Final = "Input"
"""Group of these options in the help."""


@dataclass(frozen=True, kw_only=True)
class SeedOptions:
    """Options of a seed scene, except its map.

    Raises:
        UsageError: options exclude one another.
    """

    tracks: Path | None = option(
        "Recorded tracks, fcd-output or a saved state of SUMO; default: those beside the map.",
        None,
        metavar="FILE",
        names=("--tracks", "--fcd"),
        panel=INPUT,
    )
    case: str | None = option("Case of a file with case_id.", None, metavar="ID", panel=INPUT)
    time: float | None = option("Moment in seconds; default: the busiest.", None, metavar="S", panel=INPUT)
    synthetic: int | None = option(
        "Populate the map with N vehicles instead.", None, metavar="N", panel=INPUT
    )
    like: str | None = option(
        "Of --synthetic: traffic that SUMO drives (default), or as recorded.",
        None,
        metavar="sumo|recorded",
        names=("--as",),
        panel=INPUT,
    )
    origin: str | None = option(
        "Origin of the map's coordinates; default: that of meta_data.csv.",
        None,
        metavar="LAT,LON",
        panel=INPUT,
    )

    def __post_init__(self) -> None:
        if self.time is not None and not math.isfinite(self.time):
            raise UsageError(f"--time {self.time}: needs a moment in seconds")
        if self.synthetic is None:
            if self.like is not None:
                raise UsageError("--as: needs --synthetic N")
            return
        others = {"--tracks": self.tracks, "--case": self.case, "--time": self.time}
        named = [name for name, value in others.items() if value is not None]
        if named:
            raise UsageError(f"--synthetic: makes its own tracks; leave out {', '.join(named)}")
