"""Recordings of traffic with their map: loaded, cleaned, and cut into seed scenes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from scex_sumo.base.errors import TrackError, listed
from scex_sumo.base.progress import Progress
from scex_sumo.converters.datasets.checks import Check, doubts, refuse_implausible
from scex_sumo.converters.datasets.find import find_recordings, find_tracks
from scex_sumo.converters.datasets.moment import Moment, find_moments
from scex_sumo.converters.datasets.reader import read_clean
from scex_sumo.converters.datasets.repairs import doubt_place, explain_mismatch
from scex_sumo.converters.datasets.scene import FUTURE_STEPS, CleanRecording, take_scene
from scex_sumo.converters.lanelet.origin import recorded_origin
from scex_sumo.converters.maps import LANELET2, read_map
from scex_sumo.converters.registries import Recording, Window, dataset_of, map_format, place_name
from scex_sumo.converters.tracks.evidence import Evidence, evidence, on_closed_lanes, on_lanes
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.road import Road
from scex_sumo.roads.matching import off_road
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene

MIN_SHARE_ON_LANES = 0.1  # a recording with less of its driving on lanes does not belong to its map

__all__ = [
    "LoadedRecording",
    "Recording",
    "find_recordings",
    "load_recording",
    "recorded_scene",
    "recording_moments",
    "recording_of",
    "seed_at",
]


@dataclass(frozen=True, kw_only=True, eq=False)
class LoadedRecording:
    """A recording with its map, cleaned.

    Attributes:
        road: the map; recordings of one site loaded one after the other share it.
        table: the tracks at 10 Hz; cases of INTERACTION v1.2 are only aligned.
        findings: one phrase for each kind of defect that was repaired.
        notes: warnings that all its seed scenes have: an implausible recording, a wrong place of the map.
        checks: plausibility of the recording before repairs.

    Example:
        >>> (recording,) = scex.find_recordings([scex.example_path("roundabout")])
        >>> scex.load_recording(recording).table.step_s
        0.1
    """

    recording: Recording
    road: Road
    table: TrackTable
    findings: tuple[str, ...]
    notes: tuple[str, ...] = ()
    checks: tuple[Check, ...] = ()


def load_recording(
    recording: Recording, origin: tuple[float, float] | None = None, *, force: bool = False
) -> LoadedRecording:
    """Read a recording and its map, repair it and align it to the map.

    Args:
        origin: latitude and longitude of the map's coordinates; None looks beside the tracks.
        force: accept sizes that no vehicle has, and vehicles that would drive backwards.

    Raises:
        MapError: the map is missing or cannot be read, or its origin is not known.
        TrackError: the tracks cannot be read, hold no vehicle, are impossible, or do not lie on the map.

    Example:
        >>> loaded = scex.load_recording(scex.find_recordings([scex.example_path("roundabout")])[0])
        >>> len(loaded.road.lanes) > 0
        True
    """
    map_path, track_path = recording.map_path, recording.track_paths[0]
    stamp = map_path.stat().st_mtime_ns if map_path.exists() else 0
    if origin is None and map_format(map_path).read is LANELET2.read:
        origin = recorded_origin(map_path, tracks_path=track_path)
    road = _read_road(map_path, stamp, origin)
    clean = read_clean(recording.track_paths, road, window=_with_history(recording.window))
    if not force:
        refuse_implausible(track_path, clean.checks, "repair the recording")
    _check(clean.table, road, map_path)
    return LoadedRecording(
        recording=recording,
        road=road,
        table=clean.table,
        findings=clean.findings,
        notes=(*doubts(clean.checks), *_doubts(evidence(clean.table.vehicles), road, track_path)),
        checks=clean.checks,
    )


def seed_at(
    loaded: LoadedRecording, time_s: float, *, case: str | None = None, min_history: int = 0
) -> SeedScene:
    """Cut out the seed scene of one moment, the same as `scex_sumo.read_seed` gives for that file and time.

    Args:
        time_s: the moment in the recording's clock.
        case: id of a case, if the file holds cases; None takes the first one.
        min_history: vehicles with fewer recorded previous steps are left out (0 to 10).

    Raises:
        TrackError: no vehicle at that moment, or an unknown case.

    Example:
        >>> loaded = scex.load_recording(scex.find_recordings([scex.example_path("roundabout")])[0])
        >>> scex.seed_at(loaded, 4.0).time_s
        4.0
    """
    scene = take_scene(
        CleanRecording(table=loaded.table, findings=loaded.findings, repair=True),
        name=loaded.recording.name,
        location=place_name(loaded.recording.map_path),
        case=case,
        time_s=time_s,
        min_history=min_history,
    )
    twice = [note for note in doubts(loaded.checks, _labels(scene)) if note not in loaded.notes]
    scene = _warned(scene, off_road(loaded.road, scene), (*twice, *loaded.notes))
    return loaded.table.complete(dataclasses.replace(scene, road=loaded.road))


def recording_moments(loaded: LoadedRecording, *, every_s: float) -> list[Moment]:
    """List all moments that can be seed scenes, at least ``every_s`` apart; one for each case.

    Only those in the recording's window count.

    Example:
        >>> loaded = scex.load_recording(scex.find_recordings([scex.example_path("roundabout")])[0])
        >>> len(scex.recording_moments(loaded, every_s=1.0))
        19
    """
    return find_moments(loaded.table, every_s=every_s, window=loaded.recording.window)


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
    force: bool = False,
    progress: Progress | None = None,
) -> SeedScene:
    """Read one moment of a recording.

    Without ``case`` and ``time_s`` it is the moment with most vehicles that move and are recorded from 1 s
    before to 3 s after; that of a case (INTERACTION v1.2) is its frame 10.

    Args:
        tracks: a track file, or a folder with consecutive chunks of one CommonRoad recording.
        case: id of a case; ``1``, ``1.0`` and ``"1.0"`` are the same.
        time_s: the moment in the recording's clock; the nearest frame, of the first case if none is given.
        min_history: vehicles with fewer recorded previous steps are left out (0 to 10).
        road: the map as read; tracks beside its lanes are moved onto them.
        align: False leaves the tracks where they are, see `align_tracks`.
        force: accept a moment with over half of its vehicles on no lane, sizes that no vehicle has, and
            vehicles that would drive backwards.
        progress: as of `read_clean`.

    Raises:
        TrackError: no, unusable or impossible tracks, an unknown case, a moment outside the recording or
            without vehicles, or with its vehicles beside the lanes.
    """
    recording = recording_of(Path(map_path), tracks)
    at = time_s if time_s is not None and math.isfinite(time_s) else None
    clean = read_clean(
        recording.track_paths,
        road,
        repair=repair,
        align=align,
        window=_with_history((at, at)),
        progress=progress,
    )
    if not force:
        refuse_implausible(recording.track_paths[0], clean.checks, "--force runs it all the same")
    scene = take_scene(
        clean,
        name=recording.name,
        location=place_name(recording.map_path),
        case=case,
        time_s=time_s,
        min_history=min_history,
    )
    implausible = doubts(clean.checks, _labels(scene))
    if road is None:
        return dataclasses.replace(scene, notes=(*scene.notes, *implausible))
    samples, off = evidence(clean.table.vehicles), off_road(road, scene)
    simulated = dataset_of(recording.track_paths[0]).simulated
    _check_place(scene, off, samples, road, force=force, simulated=simulated)
    scene = _warned(scene, off, (*implausible, *_doubts(samples, road, recording.track_paths[0])))
    return clean.table.complete(dataclasses.replace(scene, road=road))


def recording_of(map_path: Path, tracks: str | Path | None) -> Recording:
    """Name the recording of a map: the given tracks or folder of tracks, or what `find_tracks` finds."""
    path = find_tracks(map_path) if tracks is None else Path(tracks)
    dataset = dataset_of(path)
    files = dataset.files(path)
    name = dataset.name(map_path, files)
    return Recording(name=name, site="", dataset="", map_path=map_path, track_paths=files)


def _check_place(
    scene: SeedScene, off: list[int], samples: Evidence, road: Road, *, force: bool, simulated: bool
) -> None:
    """Raise a `TrackError` if over half of the vehicles are ``off`` the lanes, without ``force``; or all."""
    if len(off) < scene.vehicles and (force or 2 * len(off) <= scene.vehicles):
        return
    now = scene.now
    here = Evidence(x=now.x[off], y=now.y[off], heading=now.heading[off], track=np.arange(len(off)))
    share, doubt = on_lanes(samples, road), None if simulated else doubt_place(samples, road)
    if closed := on_closed_lanes(here, road):
        why = f"{closed}, or choose another moment with --time S"
    elif simulated:
        why = "the simulation has them beside the lanes for cars; choose another moment with --time S"
    elif doubt is None and len(samples.x) and share >= MIN_SHARE_ON_LANES:
        why = f"though {share:.0%} of the recording's driving is; choose another moment with --time S"
    else:
        why = doubt.removeprefix("warning: ") if doubt else explain_mismatch(samples, road)
    forced = "; --force runs it all the same" if len(off) < scene.vehicles else ""
    beside = f"{len(off)} of {scene.vehicles} vehicles are on no mapped lane"
    raise TrackError(f"{scene.name}: {beside}; {why}{forced}")


def _warned(scene: SeedScene, off: list[int], doubts: Sequence[str]) -> SeedScene:
    """Return a seed scene with notes on its vehicles ``off`` the lanes, and on the recording's place."""
    notes = []
    if off:
        shown, beside = listed(scene.track_ids[v] for v in off), f"{len(off)} of {scene.vehicles} vehicles"
        notes.append(f"warning: {beside} are on no mapped lane and will drive straight ({shown})")
    return dataclasses.replace(scene, notes=(*scene.notes, *notes, *doubts))


def _labels(scene: SeedScene) -> set[str]:
    return {str(track) for track in scene.track_ids}


def _with_history(window: Window) -> Window:
    """Return the part of a recording that seed scenes in a window need."""
    first, last = window
    return (
        None if first is None else first - HISTORY_STEPS * STEP_S,
        None if last is None else last + FUTURE_STEPS * STEP_S,
    )


def _doubts(samples: Evidence, road: Road, tracks: Path) -> tuple[str, ...]:
    dataset = dataset_of(tracks)
    doubt = None if dataset.from_car or dataset.simulated else doubt_place(samples, road)
    return (doubt,) if doubt else ()


def _check(table: TrackTable, road: Road, map_path: Path) -> None:
    if not len(table.vehicles):
        raise TrackError(f"{table.path}: no motor vehicle among the tracks; leave it out")
    samples = evidence(table.vehicles)
    share = on_lanes(samples, road)
    if share < MIN_SHARE_ON_LANES:
        raise TrackError(
            f"{table.path}: only {share:.0%} of where its vehicles drive is on lanes of {map_path}; "
            f"{on_closed_lanes(samples, road) or explain_mismatch(samples, road)}"
        )


@lru_cache(maxsize=4)
def _read_road(map_path: Path, _changed_ns: int, origin: tuple[float, float] | None) -> Road:
    """One object for all recordings of a site, so that everything remembered by road is shared."""
    return read_map(map_path, origin=origin, own_corner=False)
