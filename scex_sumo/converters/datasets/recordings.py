"""Recordings of traffic with their map: loaded, cleaned, and cut into seed scenes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

from scex_sumo.base.errors import listed
from scex_sumo.base.progress import Progress
from scex_sumo.converters.cleaning.off_lanes import doubt_place, explain_off_lanes
from scex_sumo.converters.cleaning.plausibility import doubts, refuse_implausible
from scex_sumo.converters.datasets.interaction import find_tracks
from scex_sumo.converters.datasets.reader import read_clean
from scex_sumo.converters.datasets.scene import FUTURE_STEPS, take_scene
from scex_sumo.converters.registries import Recording, Window, dataset_of, place_name
from scex_sumo.converters.tracks.evidence import Evidence, evidence
from scex_sumo.road import Road
from scex_sumo.roads.matching import off_road
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene


def recorded_scene(
    map_path: str | Path,
    *,
    tracks: str | Path | None = None,
    case: str | float | None = None,
    time_s: float | None = None,
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
        align=align,
        window=window_with_history((at, at)),
        progress=progress,
    )
    if not force:
        refuse_implausible(
            recording.track_paths[0], clean.checks, "read_seed(..., force=True) runs it all the same"
        )
    scene = take_scene(
        clean,
        name=recording.name,
        location=place_name(recording.map_path),
        case=case,
        time_s=time_s,
    )
    implausible = doubts(clean.checks, labels_of(scene))
    if road is None:
        return dataclasses.replace(scene, notes=(*scene.notes, *implausible))
    samples, off = evidence(clean.table.vehicles), off_road(road, scene)
    simulated = dataset_of(recording.track_paths[0]).simulated
    # Over half of the vehicles beside the lanes need ``force``; a scene with all of them there is refused.
    if len(off) == scene.vehicles or (2 * len(off) > scene.vehicles and not force):
        raise explain_off_lanes(scene, off, samples, road, simulated=simulated)
    scene = with_warnings(
        scene, off, (*implausible, *doubts_of_place(samples, road, recording.track_paths[0]))
    )
    return clean.table.complete(dataclasses.replace(scene, road=road))


def recording_of(map_path: Path, tracks: str | Path | None) -> Recording:
    """Name the recording of a map: the given tracks or folder of tracks, or what `find_tracks` finds."""
    path = find_tracks(map_path) if tracks is None else Path(tracks)
    dataset = dataset_of(path)
    files = dataset.files(path)
    name = dataset.name(map_path, files)
    return Recording(name=name, site="", dataset="", map_path=map_path, track_paths=files)


def with_warnings(scene: SeedScene, off: list[int], doubts: Sequence[str]) -> SeedScene:
    """Return a seed scene with notes on its vehicles ``off`` the lanes, and on the recording's place."""
    notes = []
    if off:
        shown, beside = listed(scene.track_ids[v] for v in off), f"{len(off)} of {scene.vehicles} vehicles"
        where = "on no mapped lane of their direction"
        notes.append(f"warning: {beside} are {where} and will drive straight ({shown})")
    return dataclasses.replace(scene, notes=(*scene.notes, *notes, *doubts))


def labels_of(scene: SeedScene) -> set[str]:
    """Return the track ids of a seed scene as text."""
    return {str(track) for track in scene.track_ids}


def window_with_history(window: Window) -> Window:
    """Return the part of a recording that seed scenes in a window need."""
    first, last = window
    return (
        None if first is None else first - HISTORY_STEPS * STEP_S,
        None if last is None else last + FUTURE_STEPS * STEP_S,
    )


def doubts_of_place(samples: Evidence, road: Road, tracks: Path) -> tuple[str, ...]:
    """Return a warning if a map is likely at a wrong place, from where vehicles drive."""
    dataset = dataset_of(tracks)
    doubt = None if dataset.within is not None or dataset.simulated else doubt_place(samples, road)
    return (doubt,) if doubt else ()
