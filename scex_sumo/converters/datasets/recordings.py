"""Recordings of every dataset: read, repaired, resampled, aligned to their map, and cut into seed scenes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from scex_sumo.base.errors import ScexError, listed
from scex_sumo.base.progress import Progress
from scex_sumo.converters.cleaning.align import align_tracks, evidence, on_lanes
from scex_sumo.converters.cleaning.plausibility import (
    Check,
    doubts,
    lost_vehicles,
    plausibility,
    refuse_implausible,
    without_explained,
)
from scex_sumo.converters.cleaning.repair import repair_tracks
from scex_sumo.converters.datasets.interaction import find_tracks
from scex_sumo.converters.datasets.moment import STAMP_MS
from scex_sumo.converters.datasets.scene import FUTURE_STEPS, interpolated, take_scene
from scex_sumo.converters.naming import in_memory, refuse_unreadable
from scex_sumo.converters.registries import Dataset, Recording, Window, dataset_of, place_name
from scex_sumo.converters.tracks.check import check_values
from scex_sumo.converters.tracks.rows import TrackRows, TrackTable, other_rate
from scex_sumo.road import Road
from scex_sumo.roads.matching import off_road
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene

MOST_ON_LANES = 0.95  # share of the driving on lanes from which a map's place is in no doubt


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
    """Read one moment of a recording; arguments and errors are those of `scex_sumo.read_seed`.

    Args:
        case: ``1``, ``1.0`` and ``"1.0"`` are the same.
        time_s: the nearest frame is taken, of the first case if none is given.
        road: the map as read; without it nothing is aligned.
    """
    recording = recording_of(Path(map_path), tracks)
    moment_s = time_s if time_s is not None and math.isfinite(time_s) else None
    window = window_with_history((moment_s, moment_s))
    table, findings, checks = read_clean(
        recording.track_paths, road, align=align, window=window, progress=progress
    )
    track_path, place = recording.track_paths[0], place_name(recording.map_path)
    if not force:
        refuse_implausible(track_path, checks, "read_seed(..., force=True) runs it all the same")
    scene = take_scene(table, findings, name=recording.name, location=place, case=case, time_s=time_s)
    implausible = doubts(checks, scene.track_ids)
    if road is None:
        return replace(scene, notes=(*scene.notes, *implausible))
    samples, off = evidence(table.vehicles), off_road(road, scene)
    # Over half of the vehicles beside the lanes need ``force``; a scene with all of them there is refused.
    if len(off) == scene.vehicles or (2 * len(off) > scene.vehicles and not force):
        from scex_sumo.converters.cleaning.place import explain_off_lanes

        raise explain_off_lanes(scene, off, samples, road, simulated=dataset_of(track_path).simulated)
    scene = with_warnings(scene, off, (*implausible, *doubts_of_place(samples, road, track_path)))
    return table.complete(replace(scene, road=road))


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
    return replace(scene, notes=(*scene.notes, *notes, *doubts))


def window_with_history(window: Window) -> Window:
    """Return the part of a recording that seed scenes in a window need."""
    first, last = window
    return (
        None if first is None else first - HISTORY_STEPS * STEP_S,
        None if last is None else last + FUTURE_STEPS * STEP_S,
    )


def doubts_of_place(samples: TrackRows, road: Road, tracks: Path) -> tuple[str, ...]:
    """Return a warning if a map is likely at a wrong place, from where vehicles drive."""
    dataset = dataset_of(tracks)
    if dataset.within is not None or dataset.simulated or on_lanes(samples, road) > MOST_ON_LANES:
        return ()
    from scex_sumo.converters.cleaning.place import doubt_place

    doubt = doubt_place(samples, road)
    return (doubt,) if doubt else ()


def read_recorded(
    paths: Sequence[Path],
    net: Path | None = None,
    window: Window = (None, None),
    progress: Progress | None = None,
) -> tuple[TrackTable, tuple[str, ...]]:
    """Read a recording, one file or consecutive chunks; nothing is repaired; a phrase for what is left out.

    ``progress`` tells how far SUMO has simulated a configuration.
    """
    for path in paths:
        refuse_unreadable(path)
    dataset = dataset_of(paths[0])
    simulation = {"window": window, "progress": progress} if dataset.simulated else {}
    with in_memory(paths[0]):
        table, notes = dataset.read(paths, net=net, **simulation)
    check_values(table)
    return table, notes


def read_clean(
    paths: Sequence[Path],
    road: Road | None,
    *,
    align: bool = True,
    window: Window = (None, None),
    progress: Progress | None = None,
) -> tuple[TrackTable, tuple[str, ...], tuple[Check, ...]]:
    """Read a recording, check and repair it, resample it to 10 Hz and align it to its map.

    Without a ``road`` nothing is aligned. Of a simulation only the ``window``, s, is needed. Returns the
    tracks (cases are only aligned), what was repaired, and the plausibility before.
    """
    table, findings = read_recorded(paths, None if road is None else road.net, window, progress)
    dataset = dataset_of(paths[0])
    checks = () if dataset.simulated else plausibility(table.vehicles, road)
    raw = table
    table, findings = repaired(table, findings, dataset)
    checks = (lost_vehicles(raw, table), *checks)
    findings = without_explained(findings, checks)
    if road is not None and dataset.within is not None:
        table, left = dataset.within(table, road)
        findings = (*findings, *left)
    elif road is not None and align:
        table, moved = align_tracks(table, road, siblings=_siblings(paths))
        findings = (*findings, *moved)
    return table, findings, checks


def repaired(
    table: TrackTable, findings: tuple[str, ...], dataset: Dataset
) -> tuple[TrackTable, tuple[str, ...]]:
    """Repair a recording and resample it to 10 Hz; cases stay as they are."""
    if table.has_cases:
        return table, findings
    table, before = dataset.repair(table)
    check_values(table)
    table, after = repair_tracks(table, exact=dataset.simulated)
    if other_rate(table.step_s):
        vehicles, others = resample_tracks(table.vehicles), resample_tracks(table.others)
        recorded_s = table.step_s
        table = replace(table, vehicles=vehicles, others=others, step_s=STEP_S, recorded_step_s=recorded_s)
    return table, (*findings, *before, *after)


def _siblings(paths: Sequence[Path]) -> Iterator[tuple[str, TrackRows]]:
    if len(paths) > 1:
        return
    for file in sorted(dataset_of(paths[0]).siblings(paths[0])):
        if file.name != paths[0].name:
            with suppress(ScexError):
                yield file.name, _evidence(file, file.stat().st_mtime_ns)


@lru_cache(maxsize=128)
def _evidence(path: Path, _changed_ns: int) -> TrackRows:
    return evidence(repaired(*read_recorded([path]), dataset_of(path))[0].vehicles)


def resample_tracks(rows: TrackRows) -> TrackRows:
    """Sample tracks at every full 0.1 s of the recording's clock; shorter pieces are left out."""
    begin, end = rows.pieces
    step_ms = 1000.0 * STEP_S
    low = np.ceil((rows.timestamp_ms[begin] - STAMP_MS) / step_ms).astype(np.int64)
    high = np.floor((rows.timestamp_ms[end] + STAMP_MS) / step_ms).astype(np.int64)
    count = np.maximum(high - low + 1, 0)
    piece = np.repeat(np.arange(len(begin)), count)
    frame = np.arange(len(piece)) - (np.cumsum(count) - count)[piece] + low[piece]
    columns, nearest, _ = interpolated(rows, begin[piece], end[piece], step_ms * frame)
    stamps = {"segment": piece.astype(np.int64), "frame_id": frame, "timestamp_ms": step_ms * frame}
    return rows.take(nearest).with_columns(**columns, **stamps)
