"""Recordings of traffic: found in a dataset's folders, read, cleaned, and cut into seed scenes."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from scex_sumo.converters.cleaning.align import evidence, on_lanes
from scex_sumo.converters.cleaning.misfit import LEAST_ON_LANES, why_beside
from scex_sumo.converters.datasets.find import Recording, find_recordings
from scex_sumo.converters.datasets.reader import read_clean
from scex_sumo.converters.datasets.seed import recorded_files
from scex_sumo.converters.formats import map_name, unpacked_name
from scex_sumo.converters.lanelet.origin import recorded_origin
from scex_sumo.converters.maps import read_map
from scex_sumo.converters.moments.moments import Moment, moments
from scex_sumo.converters.moments.scene import Clean, take_scene
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.errors import TrackError
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene

__all__ = [
    "LoadedRecording",
    "Recording",
    "find_recordings",
    "load_recording",
    "recording_moments",
    "seed_at",
]


@dataclass(frozen=True, kw_only=True, eq=False)
class LoadedRecording:
    """A recording with its map, cleaned.

    Attributes:
        recording: where it came from.
        road: the map; recordings of one site loaded one after the other share it.
        table: the tracks, repaired, aligned to the map, at 10 Hz. Cases of INTERACTION v1.2 are only
            aligned: each is repaired by itself when `seed_at` takes it.
        findings: one phrase for each kind of defect that was repaired, with figures.
    """

    recording: Recording
    road: Road
    table: TrackTable
    findings: tuple[str, ...]


def load_recording(recording: Recording, origin: tuple[float, float] | None = None) -> LoadedRecording:
    """Read a recording and its map, repair it and align it to the map.

    Args:
        recording: where it is.
        origin: latitude and longitude of the map's coordinates; None looks beside the tracks.

    Raises:
        MapError: the map is missing or cannot be read, or its origin is not known.
        TrackError: the tracks cannot be read, hold no vehicle, or do not lie on the map.
    """
    map_path, track_path = recording.map_path, recording.track_paths[0]
    stamp = map_path.stat().st_mtime_ns if map_path.exists() else 0
    if origin is None and unpacked_name(map_path).endswith(".osm"):
        origin = recorded_origin(map_path, tracks_path=track_path)
    road = _read_road(map_path, stamp, origin)
    clean = read_clean(recording.track_paths, road)
    _check(clean.table, road, map_path)
    return LoadedRecording(recording=recording, road=road, table=clean.table, findings=clean.findings)


def seed_at(
    loaded: LoadedRecording,
    time_s: float,
    *,
    case: str | None = None,
    min_history: int = 0,
) -> SeedScene:
    """The seed scene of one moment, the same as `scex_sumo.read_seed` gives for that file and time.

    Args:
        loaded: the recording.
        time_s: the moment in the recording's clock, s.
        case: id of a case, of a file that holds cases; None takes the first one.
        min_history: vehicles with fewer recorded previous steps are left out (0 to 10).

    Returns:
        The seed scene, its ``road`` that of the recording.

    Raises:
        TrackError: no vehicle at that moment, or an unknown case.
    """
    scene = take_scene(
        Clean(table=loaded.table, findings=loaded.findings, repair=True),
        name=loaded.recording.name,
        location=map_name(loaded.recording.map_path),
        case=case,
        time_s=time_s,
        min_history=min_history,
    )
    return dataclasses.replace(scene, road=loaded.road)


def recording_moments(loaded: LoadedRecording, *, every_s: float) -> list[Moment]:
    """All moments that can be seed scenes, in order of time; one per case in a file of cases.

    Args:
        loaded: the recording.
        every_s: least time between two moments, s.
    """
    return moments(loaded.table, every_s=every_s)


def beside_lanes(map_path: Path, tracks: Path | None, road: Road) -> str:
    """Why no vehicle of a moment is on a mapped lane: the moment, the origin or the map, with the remedy."""
    samples = evidence(read_clean(recorded_files(map_path, tracks), road).table.vehicles)
    share = on_lanes(samples, road)
    if len(samples.x) and share >= LEAST_ON_LANES:
        return f"though {share:.0%} of the recording's driving is; choose another moment with --time S"
    return why_beside(samples, road)


def _check(table: TrackTable, road: Road, map_path: Path) -> None:
    """Refuse tracks that no seed scene can be made of."""
    if not len(table.vehicles):
        raise TrackError(f"{table.path}: no motor vehicle among the tracks; leave it out")
    samples = evidence(table.vehicles)
    share = on_lanes(samples, road)
    if share < LEAST_ON_LANES:
        raise TrackError(
            f"{table.path}: only {share:.0%} of where its vehicles drive is on lanes of {map_path}; "
            f"{why_beside(samples, road)}"
        )


@lru_cache(maxsize=4)
def _read_road(map_path: Path, _changed_ns: int, origin: tuple[float, float] | None) -> Road:
    """The map; one object for all recordings of a site, so that what others keep by road is kept."""
    return read_map(map_path, origin=origin, own_corner=False)
