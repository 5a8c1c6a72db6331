"""Resampling of recordings to 10 Hz."""

from __future__ import annotations

import numpy as np

from scex_sumo.converters.datasets.moment import STAMP_MS
from scex_sumo.converters.datasets.sample import interpolated
from scex_sumo.converters.tracks.rows import TrackRows
from scex_sumo.geometry.polylines import wrap
from scex_sumo.scene import STEP_S


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
