"""Blocks of scenes: rows of tracks as arrays of (case, step, vehicle).

Short cases are stacked. Long recordings are cut into windows with the history and future of metrics.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.converters.tracks.rows import TrackRows, TrackTable
from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.metrics.formulas.tq import WINDOW_S
from scex_sumo.scene import States

WINDOW_STEPS = 64
STACKED_STEPS = 200  # longer cases are cut into windows
SILENT_STEPS = 600  # limit of gaps without vehicles
STACKED_VALUES = 1 << 20  # largest (case, step, vehicle, vehicle) of stacked cases


@dataclass(frozen=True, kw_only=True, eq=False)
class Block:
    """Scenes of C cases.

    Attributes:
        case: (C,) index of the case.
        track_id: (C, V); meaningless where a case has fewer vehicles.
        timestamp_ms: (C, T) history included; 0 in steps without vehicles.
        planned: the tracks driven from each step on.
    """

    case: IntArray
    track_id: IntArray
    timestamp_ms: IntArray
    tracks: SceneTracks
    planned: PlannedPaths


@dataclass(frozen=True, kw_only=True, eq=False)
class _Timed:
    """Rows by case, track and time, with (N,) step numbers and accelerations in m/s²."""

    rows: TrackRows
    step: IntArray
    acceleration: FloatArray
    step_s: float


def blocks(table: TrackTable, *, history: int = 0) -> Iterator[Block]:
    """Yield the motor vehicles of a recording or of a file of cases in blocks.

    Args:
        history: steps at the start of each case without evaluation.
    """
    if len(table.vehicles) == 0:
        return
    timed = _on_grid(table.vehicles, table.step_s)
    case = timed.rows.case
    starts = np.flatnonzero(np.diff(case, prepend=-1))
    ends = np.append(starts[1:], len(case))
    longest = STACKED_STEPS
    short, sizes = [], []
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        if timed.step[start:end].max() < STACKED_STEPS:
            longest = max(longest, int(timed.step[start:end].max()) + 1)
            short.append((start, end))
            sizes.append(len(np.unique(timed.rows.track[start:end])))
        else:
            yield from _windows(timed, start, end, history)
    # Cases of similar size waste little memory.
    order = np.argsort(np.array(sizes, dtype=np.int64), kind="stable")
    while order.size:
        largest = sizes[order[-1]]
        count = max(STACKED_VALUES // (longest * max(largest, 1) ** 2), 1)
        chosen, order = np.sort(order[-count:]), order[:-count]
        ranges = [short[i] for i in chosen.tolist()]
        begin = [start for start, _ in ranges]
        index = np.concatenate([np.arange(*ends) for ends in ranges])
        future = np.repeat(np.arange(len(ranges)), [end - start for start, end in ranges])
        vehicle = timed.rows.track[index] - timed.rows.track[begin][future]
        yield _block(timed, timed.rows.case[begin], index, future, vehicle, first=history)


def _on_grid(rows: TrackRows, step_s: float) -> _Timed:
    """Number the steps of each case. Stamps may jitter; steps without vehicles count."""
    scene = np.stack([rows.case.astype(np.float64), rows.timestamp_ms], axis=1)
    scenes, which = np.unique(scene, axis=0, return_inverse=True)
    which = which.reshape(-1)
    new_case = np.diff(scenes[:, 0], prepend=-1) != 0
    ahead = np.rint(np.diff(scenes[:, 1], prepend=0) / (1000 * step_s))
    # Step by step: rounded stamps must not drift off the grid.
    count = np.cumsum(np.where(new_case, 0, np.clip(ahead, 1, SILENT_STEPS)))
    start = count[np.flatnonzero(new_case)][np.cumsum(new_case) - 1]
    follows = np.diff(rows.track, prepend=-1) == 0
    elapsed = np.diff(rows.timestamp_ms, prepend=0) / 1000
    change = np.diff(rows.speed_ahead, prepend=0)
    acceleration = np.divide(change, elapsed, out=np.zeros(len(rows)), where=follows & (elapsed > 0))
    step = (count - start).astype(np.int64)[which]
    return _Timed(rows=rows, step=step, acceleration=acceleration, step_s=step_s)


def _windows(timed: _Timed, start: int, end: int, history: int) -> Iterator[Block]:
    step, track = timed.step[start:end], timed.rows.track[start:end]
    back = round(WINDOW_S / timed.step_s)
    seen = np.unique(step)
    begin = history
    while True:
        seen_after = seen[np.searchsorted(seen, begin) :]
        if seen_after.size == 0:
            return
        begin = int(seen_after[0])
        until = begin + WINDOW_STEPS
        window_tracks = np.unique(track[(step >= begin) & (step < until)])
        oldest = max(begin - back, 0)
        index = start + np.flatnonzero(np.isin(track, window_tracks) & (step >= oldest))
        vehicle = np.searchsorted(window_tracks, timed.rows.track[index])
        future, case = np.zeros(len(index), dtype=np.int64), timed.rows.case[start : start + 1]
        first = begin - oldest
        yield _block(
            timed, case, index, future, vehicle, oldest=oldest, first=first, until=first + WINDOW_STEPS
        )
        begin = until


def _block(
    timed: _Timed,
    case: IntArray,
    index: IntArray,
    future: IntArray,
    vehicle: IntArray,
    *,
    oldest: int = 0,
    first: int,
    until: int | None = None,
) -> Block:
    """Return (n,) rows as a block of C cases that begins at step ``oldest``.

    Steps from ``first`` to ``until`` of it are evaluated; later ones are planned.
    """
    rows, step, futures = timed.rows, timed.step[index] - oldest, len(case)
    shape = (futures, int(step.max()) + 1, int(vehicle.max()) + 1)
    entry = (future, step, vehicle)

    def dense(values: FloatArray) -> FloatArray:
        array = np.full(shape, np.nan)
        array[entry] = values[index]
        return array

    present = np.zeros(shape, dtype=bool)
    present[entry] = True
    # Backwards: a track's first size stays.
    backwards = np.arange(len(index))[::-1]
    length, width = np.ones((2, futures, shape[2]))
    types = np.full((futures, shape[2]), "", dtype=f"U{max(map(len, rows.types), default=1)}")
    track_id = np.zeros((futures, shape[2]), dtype=np.int64)
    slot = (future[backwards], vehicle[backwards])
    length[slot], width[slot] = rows.length[index][backwards], rows.width[index][backwards]
    types[slot] = np.array(rows.types)[rows.track[index]][backwards]
    track_id[slot] = rows.track_id[index][backwards]
    stamps = np.full(shape[:2], np.nan)
    stamps[future, step] = rows.timestamp_ms[index]
    acceleration, first = dense(timed.acceleration), min(first, shape[1])
    x, y, heading, speed = map(dense, (rows.x, rows.y, rows.psi_rad, rows.speed_ahead))
    sizes: dict[str, Any] = {"length": length, "width": width, "types": types, "step_s": timed.step_s}
    whole = SceneTracks(
        states=States(x=x, y=y, heading=heading, speed=speed),
        present=present,
        first=first,
        acceleration=acceleration,
        **sizes,
    )
    planned, now = PlannedPaths.from_tracks(whole), slice(until)
    steps = slice(None if until is None else until - first)
    return Block(
        case=case,
        track_id=track_id,
        timestamp_ms=np.nan_to_num(np.rint(stamps[:, now])).astype(np.int64),
        tracks=replace(
            whole, states=whole.states[:, now], present=present[:, now], acceleration=acceleration[:, now]
        ),
        planned=replace(planned, index=planned.index[steps], column=planned.column[steps]),
    )
