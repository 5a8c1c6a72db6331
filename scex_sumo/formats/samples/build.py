"""Rows and tables of tracks, built from samples or joined from parts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.arguments import checked
from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.tracks.rows import TrackRows, TrackTable, segments_of
from scex_sumo.scene import STEP_S


@checked
def track_rows(
    track: IntArray,
    labels: Sequence[str],
    types: Sequence[str],
    *,
    frame_id: IntArray | None = None,
    **columns: FloatArray,
) -> TrackRows:
    """Build the rows of one recording from samples sorted by track and time.

    Args:
        track: (N,) index into labels and types, never decreasing; tracks without samples are left out.
        labels: ids of the tracks; of vehicles whole numbers.
        types: lower case, e.g. ``car``, ``truck``, ``pedestrian``.
        frame_id: (N,); None counts steps of 0.1 s.
        columns: (N,) each of `FLOAT_COLUMNS`, all of them.

    Example:
        >>> zeros = np.zeros(2)
        >>> rows = scex.track_rows(
        ...     np.array([0, 0]), ["7"], ["car"], timestamp_ms=np.array([0.0, 100.0]),
        ...     x=zeros, y=zeros, vx=zeros, vy=zeros,
        ...     psi_rad=zeros, length=zeros + 4.5, width=zeros + 1.8,
        ... )
        >>> rows.labels
        ('7',)
    """
    used, number = np.unique(track, return_inverse=True)
    number, stamps = number.astype(np.int64), columns["timestamp_ms"]
    return TrackRows(
        case=np.zeros(len(number), np.int64),
        track=number,
        segment=segments_of(number, stamps),
        labels=tuple(str(labels[k]) for k in used),
        types=tuple(str(types[k]) for k in used),
        frame_id=np.rint(stamps / (1000.0 * STEP_S)).astype(np.int64) if frame_id is None else frame_id,
        **columns,
    )


def track_table(
    path: Path,
    motor: BoolArray,
    track: IntArray,
    labels: Sequence[str],
    types: Sequence[str],
    *,
    step_s: float,
    notes: tuple[str, ...] = (),
    **columns: Any,
) -> TrackTable:
    """Build a recording, with the vehicles apart from the others; further arguments as of `track_rows`.

    Args:
        motor: (N,) whether a sample is one of a vehicle.
    """
    vehicles, others = (
        track_rows(track[keep], labels, types, **{name: values[keep] for name, values in columns.items()})
        for keep in (motor, ~motor)
    )
    return TrackTable(path=path, cases=("",), vehicles=vehicles, others=others, step_s=step_s, notes=notes)
