"""Options of a seed scene: which recorded moment, or how a map is populated."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from scex_sumo.base.errors import UsageError
from scex_sumo.base.options import option


@dataclass(frozen=True, kw_only=True)
class SeedOptions:
    """Options of a seed scene, except its map.

    Raises:
        UsageError: options exclude one another.
    """

    tracks: Path | None = option("Recorded tracks; default: those beside the map.", None, metavar="CSV")
    fcd: Path | None = option(
        "Tracks of a SUMO simulation (fcd-output .xml, .xml.gz, .parquet).", None, metavar="FCD"
    )
    state: Path | None = option("Saved state of a SUMO simulation (.xml, .xml.gz).", None, metavar="STATE")
    case: str | None = option("Case of a file with case_id.", None, metavar="ID")
    time: float | None = option("Moment in seconds; default: the busiest.", None, metavar="S")
    synthetic: int | None = option("Populate the map with N vehicles by SUMO instead.", None, metavar="N")
    like: str | None = option(
        "Of --synthetic: what its scenes look like.", None, metavar="sumo|recorded|NAME", names=("--as",)
    )
    speed: float | None = option(
        "Of scenes as recorded: mean speed of the traffic, m/s; default: drawn for road and density.",
        None,
        metavar="V",
    )
    people: int | None = option(
        "Of --synthetic: pedestrians and cyclists on footways, crossings and beside lanes.", None, metavar="N"
    )
    origin: str | None = option(
        "Origin of the map's coordinates; default: that of meta_data.csv.", None, metavar="LAT,LON"
    )
    force: bool = option(
        "Run a moment with over half of its vehicles on no lane, or impossible sizes or headings, too.",
        False,
        names=("--force",),
    )

    def __post_init__(self) -> None:
        if self.time is not None and not math.isfinite(self.time):
            raise UsageError(f"--time {self.time}: needs a moment in seconds")
        given = {"--tracks": self.tracks, "--fcd": self.fcd, "--state": self.state}
        named = [name for name, path in given.items() if path is not None]
        if len(named) > 1:
            raise UsageError(f"{' and '.join(named)} exclude one another; give one of them")
        if self.synthetic is None:
            if self.like is not None:
                raise UsageError("--as: needs --synthetic N")
            if self.speed is not None:
                raise UsageError("--speed: needs --synthetic N --as recorded")
            if self.people is not None:
                raise UsageError("--people: needs --synthetic N")
            return
        others = {"--tracks": self.source, "--case": self.case, "--time": self.time}
        named = [name for name, value in others.items() if value is not None]
        if named:
            raise UsageError(f"--synthetic: makes its own tracks; leave out {', '.join(named)}")

    @property
    def source(self) -> Path | None:
        """The tracks that are given, whatever their kind."""
        return self.tracks or self.fcd or self.state
