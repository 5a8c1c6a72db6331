"""Recordings of every dataset: read, repaired, resampled and aligned to their map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from scex_sumo.base.errors import ScexError
from scex_sumo.base.progress import Progress
from scex_sumo.converters.cleaning.align import align_tracks
from scex_sumo.converters.cleaning.plausibility import lost_vehicles, plausibility, without_explained
from scex_sumo.converters.cleaning.repair import repair_tracks
from scex_sumo.converters.datasets.moment import STAMP_MS
from scex_sumo.converters.datasets.sample import interpolated
from scex_sumo.converters.datasets.scene import CleanRecording
from scex_sumo.converters.naming import in_memory, refuse_unreadable
from scex_sumo.converters.registries import Dataset, Window, dataset_of
from scex_sumo.converters.tracks.check import check_values
from scex_sumo.converters.tracks.evidence import Evidence, evidence
from scex_sumo.converters.tracks.rows import TrackRows, TrackTable, other_rate
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S


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
) -> CleanRecording:
    """Read a recording, check and repair it, resample it to 10 Hz and align it to its map.

    Args:
        road: the map; without it nothing is aligned.
        align: as `align_tracks`, with the other recordings of the folder if the evidence is thin.
        window: first and last time that is needed, s.
        progress: as of `read_recorded`.
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
    return CleanRecording(table=table, findings=findings, repair=True, checks=checks)


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


def resample_tracks(rows: TrackRows) -> TrackRows:
    """Sample tracks at every full 0.1 s of the recording's clock; shorter pieces are left out."""
    begin, end = rows.pieces
    step_ms = 1000.0 * STEP_S
    low = np.ceil((rows.timestamp_ms[begin] - STAMP_MS) / step_ms).astype(np.int64)
    high = np.floor((rows.timestamp_ms[end] + STAMP_MS) / step_ms).astype(np.int64)
    count = np.maximum(high - low + 1, 0)
    piece = np.repeat(np.arange(len(begin)), count)
    frame = np.arange(len(piece)) - (np.cumsum(count) - count)[piece] + low[piece]
    at = interpolated(rows, begin[piece], end[piece], step_ms * frame)
    used, track = np.unique(rows.track[at.nearest], return_inverse=True)
    return TrackRows(
        case=rows.case[at.nearest],
        track=track.astype(np.int64),
        segment=piece.astype(np.int64),
        labels=tuple(rows.labels[k] for k in used),
        types=tuple(rows.types[k] for k in used),
        frame_id=frame,
        timestamp_ms=step_ms * frame,
        x=at.x,
        y=at.y,
        vx=at.vx,
        vy=at.vy,
        psi_rad=wrap(at.heading),
        length=rows.length[at.nearest],
        width=rows.width[at.nearest],
    )
