"""Seed scenes of recordings, with their map; options of a seed scene."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import TrackError, UsageError, warn_notes
from scex_sumo.base.options import option
from scex_sumo.base.progress import Progress, progress_of
from scex_sumo.scene import SeedScene

INPUT: Final = "Input"
"""Group of these options in the help."""


@checked
def read_seed(
    map_path: str | Path,
    *,
    tracks: str | Path | None = None,
    case: str | None = None,
    time: float | None = None,
    origin: tuple[float, float] | None = None,
    align: bool = True,
    force: bool = False,
    cache: bool = True,
    progress: Progress | bool | None = None,
) -> SeedScene:
    """Read one moment of a recording, with its map; notes on both are `ScexWarning`.

    Args:
        map_path: a map, or a folder with one recording and its map.
        tracks: a track file in INTERACTION format, a CommonRoad scenario, or a folder with the chunks of a
            CommonRoad recording; None: the dataset's folder layout, or a CommonRoad map's vehicles.
        case: of a file with ``case_id``; None: the busiest one.
        time: seconds in the recording; None: frame 10 of a case, or the moment with most moving vehicles
            recorded from 1 s before to 3 s after.
        origin: latitude and longitude of the map's coordinates; None looks beside the tracks.
        align: move tracks beside the lanes onto them, see `align_tracks`.
        force: accept a moment with over half of its vehicles on no lane, as a wrong origin makes them, sizes
            that no vehicle has, and vehicles that would drive backwards.
        cache: keep the road in ``~/.cache/scex-sumo``.
        progress: True for a bar; or called with (done, total) while SUMO simulates a configuration.

    Raises:
        MapError: the map cannot be read.
        TrackError: the tracks cannot be read, hold no such moment, or lie beside the lanes.

    Example:
        >>> scex.read_seed(scex.example_path("roundabout"), time=4.0).vehicles
        14
    """
    from scex_sumo.converters.datasets.interaction import find_tracks
    from scex_sumo.converters.datasets.recordings import recorded_scene
    from scex_sumo.converters.maps import read_map

    map_path, given = Path(map_path), None if tracks is None else Path(tracks)
    if given is not None or map_path.is_dir():
        from scex_sumo.converters.datasets.find import map_and_tracks

        map_path, given = map_and_tracks(map_path, given)
    try:
        track_path = find_tracks(map_path) if given is None else given
    except TrackError:
        read_map(map_path)  # no map is the likelier reason
        raise
    road = read_map(map_path, origin=origin, tracks=track_path, own_corner=False, keep=cache)
    with progress_of(progress, f"simulating {map_path.name}") as tick:
        scene = recorded_scene(
            map_path,
            tracks=track_path,
            case=case,
            time_s=time,
            road=road,
            align=align,
            force=force,
            progress=tick,
        )
    warn_notes([*road.notes, *scene.notes])
    return scene


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
