"""Recordings of every dataset: read, repaired, resampled and aligned to their map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import shapely

from scex_sumo.base.arrays import BoolArray
from scex_sumo.base.errors import ScexError, listed
from scex_sumo.base.progress import Progress
from scex_sumo.converters.datasets.checks import Check, without_explained
from scex_sumo.converters.datasets.repairs import align_tracks, check_recording, repair_tracks
from scex_sumo.converters.datasets.sample import resample_tracks
from scex_sumo.converters.datasets.scene import CleanRecording
from scex_sumo.converters.registries import Dataset, Window, dataset_of
from scex_sumo.converters.tracks.check import check_values
from scex_sumo.converters.tracks.evidence import Evidence, evidence
from scex_sumo.converters.tracks.rows import TrackRows, TrackTable, joined_rows, other_rate
from scex_sumo.road import Road
from scex_sumo.roads.matching import match
from scex_sumo.scene import STEP_S

OUTSIDE_M = 5.0  # from all lanes: there the map ends, or a parking lot begins
PARKED_M = 1.0  # a vehicle that stays within this never moves
PARKED_SHARE = 0.3  # of a lane's width: a vehicle this far from the middle does not wait in the lane


def read_recorded(
    paths: Sequence[Path],
    net: Path | None = None,
    window: Window = (None, None),
    progress: Progress | None = None,
) -> tuple[TrackTable, tuple[str, ...]]:
    """Read a recording, one file or consecutive chunks; nothing is repaired.

    ``progress`` tells how far SUMO has simulated a configuration.

    Returns:
        The recording, and a phrase for each thing left out.
    """
    dataset = dataset_of(paths[0])
    simulation = {"window": window, "progress": progress} if dataset.simulated else {}
    table, notes = dataset.read(paths, net=net, **simulation)
    check_values(table)
    return table, notes


def read_clean(
    paths: Sequence[Path],
    road: Road | None,
    *,
    repair: bool = True,
    align: bool = True,
    window: Window = (None, None),
    progress: Progress | None = None,
) -> CleanRecording:
    """Read a recording, check and repair it, resample it to 10 Hz and align it to its map.

    Args:
        road: the map; without it nothing is aligned.
        repair: as `repair_tracks`. Cases of INTERACTION v1.2 are repaired when one is taken.
        align: as `align_tracks`, with the other recordings of the folder if the evidence is thin.
        window: first and last time that is needed, s.
        progress: as of `read_recorded`.
    """
    table, findings = read_recorded(paths, None if road is None else road.net, window, progress)
    dataset = dataset_of(paths[0])
    checks: tuple[Check, ...] = ()
    if repair:
        checks = () if dataset.simulated else check_recording(table.vehicles, road)
        table, findings = repaired(table, findings, dataset)
        findings = without_explained(findings, checks)
    from_car = dataset.from_car
    if align and road is not None and not from_car:
        table, moved = align_tracks(table, road, siblings=_siblings(paths))
        findings = (*findings, *moved)
    if road is not None and from_car:
        table, left = within_map(table, road)
        findings = (*findings, *left)
    return CleanRecording(table=table, findings=findings, repair=repair, checks=checks)


def repaired(
    table: TrackTable, findings: tuple[str, ...], dataset: Dataset
) -> tuple[TrackTable, tuple[str, ...]]:
    """Repair a recording and resample it to 10 Hz; cases stay as they are."""
    if table.has_cases:
        return table, findings
    table, before = dataset.repair(table)
    table, after = repair_tracks(table, exact=dataset.simulated)
    if other_rate(table.step_s):
        vehicles, others = resample_tracks(table.vehicles), resample_tracks(table.others)
        recorded_s = table.step_s
        table = replace(table, vehicles=vehicles, others=others, step_s=STEP_S, recorded_step_s=recorded_s)
    return table, (*findings, *before, *after)


def _siblings(paths: Sequence[Path]) -> Iterator[tuple[str, Evidence]]:
    if len(paths) > 1:
        return
    for file in sorted(dataset_of(paths[0]).siblings(paths[0])):
        if file.name != paths[0].name:
            with suppress(ScexError):
                yield file.name, _evidence(file, file.stat().st_mtime_ns)


@lru_cache(maxsize=128)
def _evidence(path: Path, _changed_ns: int) -> Evidence:
    return evidence(repaired(*read_recorded([path]), dataset_of(path))[0].vehicles)


def within_map(table: TrackTable, road: Road) -> tuple[TrackTable, list[str]]:
    """Cut tracks of vehicles where they leave the mapped lanes, and make obstacles of parked vehicles.

    A parked vehicle never moves and stands beside the middle of every lane. Returns a phrase for each.
    """
    rows, notes = table.vehicles, []
    inside = _near_lanes(rows, road)
    if not inside.all():
        cut = sorted({rows.labels[k] for k in rows.track[~inside]}, key=lambda label: (len(label), label))
        notes.append(
            f"{len(cut)} of {rows.tracks} vehicles are over {OUTSIDE_M:g} m from all mapped lanes, left out "
            f"there: {listed(cut)}"
        )
        kept = rows.take(inside)
        gaps = np.cumsum(~inside)[inside]  # so many samples are missing before each one
        new = np.append(True, (np.diff(kept.segment) != 0) | (np.diff(gaps) > 0))[: len(kept)]
        rows = kept.with_columns(segment=np.cumsum(new) - 1)
    parked = _parked(rows, road)
    if parked.any():
        still = rows.take(parked[rows.track])
        notes.append(
            f"{still.tracks} vehicles that never move stand beside the lanes: parked, taken for obstacles"
        )
        still = replace(still, types=("parked",) * still.tracks)
        rows, others = rows.take(~parked[rows.track]), joined_rows(table.others, still)
        table = replace(table, others=others)
    return replace(table, vehicles=rows), notes


def _near_lanes(rows: TrackRows, road: Road) -> BoolArray:
    areas = [
        shapely.make_valid(shapely.Polygon(np.concatenate([lane.left_bound, lane.right_bound[::-1]])))
        for lane in road.vehicle_lanes.values()
    ]
    near = np.zeros(len(rows), bool)
    points = shapely.points(rows.x, rows.y)
    near[shapely.STRtree(areas).query(points, predicate="dwithin", distance=OUTSIDE_M)[0]] = True
    return near


def _parked(rows: TrackRows, road: Road) -> BoolArray:
    """Return (K,) whether each track is a parked vehicle."""
    if not len(rows):
        return np.zeros(0, bool)
    begin = np.flatnonzero(np.append(True, np.diff(rows.track) != 0))
    spread = [
        np.ptp(np.quantile(part, (0.05, 0.95))) for a in (rows.x, rows.y) for part in np.split(a, begin[1:])
    ]
    still = np.hypot(*np.reshape(spread, (2, -1))) < PARKED_M
    middle = (begin + np.append(begin[1:], len(rows))) // 2
    matches = match(road, rows.x[middle], rows.y[middle], rows.psi_rad[middle])
    widths = np.array([road.lanes[int(i)].width_m for i in matches.lane_id])
    waiting = matches.vehicle[np.abs(matches.offset) <= PARKED_SHARE * widths]
    return np.asarray(still & ~np.isin(np.arange(rows.tracks), waiting))
