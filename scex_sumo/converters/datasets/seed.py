"""Seed scene of one moment of a recording, by the files' paths."""

from __future__ import annotations

from pathlib import Path

from scex_sumo.converters.datasets.reader import chains, read_clean
from scex_sumo.converters.formats import is_commonroad, map_name
from scex_sumo.converters.moments.scene import recording_name, take_scene
from scex_sumo.converters.tracks.find import find_tracks
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene


def recorded_scene(
    map_path: str | Path,
    *,
    tracks: str | Path | None = None,
    case: str | float | None = None,
    time_s: float | None = None,
    min_history: int = 0,
    repair: bool = True,
    road: Road | None = None,
    align: bool = True,
) -> SeedScene:
    """Read one moment of a recording.

    Without ``case`` and ``time_s`` it is the moment with most vehicles that move and are recorded from 1 s
    before to 3 s after, the earliest of equals; the moment of a case (INTERACTION v1.2) is its frame 10.
    A time without a case is looked up in the first case.

    Args:
        map_path: the map; names the seed scene, and finds the tracks where none are given.
        tracks: CSV file in INTERACTION format, a CommonRoad scenario, or a folder with consecutive chunks of
            one CommonRoad recording; None looks for it, see ``find_tracks``.
        case: id of a case; ``1``, ``1.0`` and ``"1.0"`` are the same.
        time_s: the moment in the recording's clock (``timestamp_ms`` / 1000); the nearest frame is taken.
        min_history: vehicles with fewer recorded previous steps are left out (0 to 10).
        repair: whether defects are repaired, see ``repair_tracks``.
        road: the map as read; tracks that lie beside its lanes are then moved onto them.
        align: False leaves them where they are, see ``align_tracks``.

    Raises:
        TrackError: no or unusable tracks, an unknown case, a moment outside the recording or without
            vehicles.
    """
    map_path = Path(map_path)
    paths = _files(find_tracks(map_path) if tracks is None else Path(tracks))
    return take_scene(
        read_clean(paths, road, repair=repair, align=align),
        name=recording_name(map_path, paths),
        location=map_name(map_path),
        case=case,
        time_s=time_s,
        min_history=min_history,
    )


def _files(path: Path) -> tuple[Path, ...]:
    """The chunks of a folder that holds one recording of them; else the path itself."""
    if path.is_dir():
        found = chains([file for file in path.iterdir() if is_commonroad(file)])
        if len(found) == 1:
            return found[0]
    return (path,)
