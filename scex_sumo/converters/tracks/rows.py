"""Recorded tracks as flat arrays of samples."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.geometry.polylines import wrap
from scex_sumo.scene import STEP_S, SeedScene

MAX_GAP_S = 0.5
"""A longer gap splits a track into two segments: nothing is interpolated or smoothed across it."""

STANDING_MPS = 0.5  # slower road users stand: trackers let standing vehicles drift this fast
JUMP_M = 3.0  # a shorter step between two samples is no jump
FORWARD_MPS = 3.0  # faster than this a vehicle does not drive backwards or sideways


def ahead_speed(vx: FloatArray, vy: FloatArray, heading: FloatArray) -> FloatArray:
    """Return speeds, m/s, below 0 where road users move backwards, not where they stand."""
    speed = np.hypot(vx, vy)
    reverses = (vx * np.cos(heading) + vy * np.sin(heading) < 0.0) & (speed > STANDING_MPS)
    return np.asarray(np.where(reverses, -speed, speed))


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackRows:
    """Samples of tracks, sorted by case, track and time; N rows of K tracks.

    Attributes:
        case: (N,) index into ``TrackTable.cases``.
        track: (N,) number of the row's track, 0 to K - 1, never decreasing.
        segment: (N,) as ``track``, with a new number after a gap of more than 0.5 s or a jump.
        labels: (K,) track ids as recorded.
        types: (K,) lower case.
        frame_id: (N,) as recorded.
        timestamp_ms: (N,)
        x: (N,) centre, m; likewise y.
        vx: (N,) m/s; likewise vy.
        psi_rad: (N,) heading; the course of the motion if the recording has none.
        length: (N,) m; likewise width.
    """

    case: IntArray
    track: IntArray
    segment: IntArray
    labels: tuple[str, ...]
    types: tuple[str, ...]
    frame_id: IntArray
    timestamp_ms: FloatArray
    x: FloatArray
    y: FloatArray
    vx: FloatArray
    vy: FloatArray
    psi_rad: FloatArray
    length: FloatArray
    width: FloatArray

    def __len__(self) -> int:
        return len(self.track)

    @property
    def tracks(self) -> int:
        """Number of tracks K."""
        return len(self.labels)

    @cached_property
    def speed(self) -> FloatArray:
        """(N,) m/s, at least 0."""
        return np.asarray(np.hypot(self.vx, self.vy))

    @cached_property
    def speed_ahead(self) -> FloatArray:
        """(N,) m/s, below 0 where a vehicle reverses."""
        return ahead_speed(self.vx, self.vy, self.psi_rad)

    @cached_property
    def track_id(self) -> IntArray:
        """(N,) track ids as numbers, of vehicles only: others may have names such as P1."""
        return np.array([number_of(label) for label in self.labels], np.int64)[self.track]

    @cached_property
    def stamps_ms(self) -> FloatArray:
        """(M,) distinct stamps, rising, ms."""
        return np.unique(self.timestamp_ms)

    @cached_property
    def pieces(self) -> tuple[IntArray, IntArray]:
        """(S,) first and last row of each segment."""
        if not len(self):
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        begin = np.flatnonzero(np.append(True, np.diff(self.segment) != 0))
        return begin, np.append(begin[1:], len(self)) - 1

    @cached_property
    def piece(self) -> IntArray:
        """(N,) number of each row's segment among the S."""
        return np.cumsum(np.diff(self.segment, prepend=self.segment[:1]) != 0)

    def take(self, keep: BoolArray | IntArray | slice) -> TrackRows:
        """Rows where ``keep`` (N,) is True, of rising indices, or of a slice; empty tracks are left out."""
        used, track = np.unique(self.track[keep], return_inverse=True)
        columns = {name: getattr(self, name)[keep] for name in ROW_COLUMNS}
        return TrackRows(
            **columns,
            track=track.astype(np.int64),
            labels=tuple(self.labels[k] for k in used),
            types=tuple(self.types[k] for k in used),
        )

    def of_case(self, index: int) -> TrackRows:
        """Rows and tracks of one case."""
        return self.take(slice(*np.searchsorted(self.case, (index, index + 1))))

    def turned(self, angle: float) -> TrackRows:
        """A copy with headings and velocities turned counter-clockwise by an angle, rad; positions stay."""
        c, s = math.cos(angle), math.sin(angle)
        return self.with_columns(
            psi_rad=wrap(self.psi_rad + angle), vx=c * self.vx - s * self.vy, vy=s * self.vx + c * self.vy
        )

    def with_columns(self, **columns: Any) -> TrackRows:
        """A copy with some columns (arrays) replaced."""
        return replace(self, **columns)


FLOAT_COLUMNS = ("timestamp_ms", "x", "y", "vx", "vy", "psi_rad", "length", "width")
ROW_COLUMNS = ("case", "segment", "frame_id", *FLOAT_COLUMNS)


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackTable:
    """A recording, or a file of cases.

    Attributes:
        cases: ids of the cases, e.g. ``1.0``; one empty string for a recording.
        others: tracks of all other road users.
        recorded_step_s: usual time between samples as recorded.
        notes: what the reader decided or left out, one phrase each.
        complete: adds to a seed scene with its road what belongs to its moment, e.g. phases of lights.

    Example:
        >>> loaded = scex.load_recording(scex.find_recordings([scex.example_path("roundabout")])[0])
        >>> loaded.table.has_cases
        False
    """

    path: Path
    cases: tuple[str, ...]
    vehicles: TrackRows
    others: TrackRows
    step_s: float
    recorded_step_s: float | None = None
    notes: tuple[str, ...] = ()
    complete: Callable[[SeedScene], SeedScene] = lambda scene: scene

    @property
    def has_cases(self) -> bool:
        """Whether the file holds cases (INTERACTION v1.2) and not one recording."""
        return self.cases != ("",)

    def case(self, index: int) -> TrackTable:
        """Rows of one case only; ``cases`` stays, so that indices keep their meaning."""
        return replace(self, vehicles=self.vehicles.of_case(index), others=self.others.of_case(index))


def number_of(label: str) -> int:
    """Number of a vehicle by its label, not through a float: ``4.0`` is 4."""
    return int(label.partition(".")[0])


def other_rate(step_s: float) -> bool:
    """Whether a usual time between samples is not 0.1 s."""
    return abs(step_s - STEP_S) > 0.02 * STEP_S


def segments_of(track: IntArray, timestamp_ms: FloatArray) -> IntArray:
    """(N,) segment numbers: a new one for each track and after a gap of more than 0.5 s."""
    new = np.ones(len(track), bool)
    # 1.5 ms: stamps are rounded to milliseconds
    new[1:] = (np.diff(track) != 0) | (np.diff(timestamp_ms) > 1000.0 * MAX_GAP_S + 1.5)
    return np.asarray(np.cumsum(new) - 1, np.int64)


def numbered_again(rows: TrackRows) -> TrackRows:
    """Number segments from 0 on after rows were left out; gaps that are too long now begin new ones."""
    new = (np.diff(rows.segment) != 0) | (np.diff(segments_of(rows.track, rows.timestamp_ms)) != 0)
    return rows.with_columns(segment=np.append(0, np.cumsum(new)).astype(np.int64)[: len(rows)])


def joined_rows(*chunks: TrackRows) -> TrackRows:
    """Join several sets of tracks, one after the other."""
    tracks = np.cumsum([0, *(chunk.tracks for chunk in chunks)])
    segments = np.cumsum([0, *(int(chunk.segment.max(initial=-1)) + 1 for chunk in chunks)])
    shifts = zip(chunks, tracks, segments, strict=False)
    moved = [chunk.with_columns(track=chunk.track + k, segment=chunk.segment + n) for chunk, k, n in shifts]
    names = ("track", *ROW_COLUMNS)
    return TrackRows(
        **{name: np.concatenate([getattr(chunk, name) for chunk in moved]) for name in names},
        labels=tuple(label for chunk in chunks for label in chunk.labels),
        types=tuple(kind for chunk in chunks for kind in chunk.types),
    )
