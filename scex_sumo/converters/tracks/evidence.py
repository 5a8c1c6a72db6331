"""Evidence of where vehicles drive: poses of moving vehicles of a recording, and the lanes they are on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.tracks.rows import TrackRows
from scex_sumo.road import Road
from scex_sumo.roads.matching import match

MOVING_MPS = 2.0  # slower samples tell nothing about lanes
SAMPLE_M = 1.0
MAX_SAMPLES = 2000  # more are thinned out evenly


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """Poses of moving vehicles, one for every metre driven; ``track`` (n,) counts from 0."""

    x: FloatArray
    y: FloatArray
    heading: FloatArray
    track: IntArray

    @property
    def tracks(self) -> int:
        """Number of tracks."""
        return int(self.track.max()) + 1 if len(self.track) else 0

    def take(self, keep: BoolArray) -> Evidence:
        """Return the samples where ``keep`` (n,) is True."""
        number = np.unique(self.track[keep], return_inverse=True)[1].astype(np.int64)
        return Evidence(x=self.x[keep], y=self.y[keep], heading=self.heading[keep], track=number)


def evidence(rows: TrackRows) -> Evidence:
    """Return one pose for every metre that vehicles drive."""
    joined = np.diff(rows.segment) == 0
    step = np.where(joined, np.hypot(np.diff(rows.x), np.diff(rows.y)), 0.0)
    mark = np.floor(np.append(0.0, np.cumsum(step)) / SAMPLE_M)
    keep = np.append(True, ~joined | (np.diff(mark) > 0.0))[: len(rows)] & (rows.speed > MOVING_MPS)
    track = np.unique(rows.track[keep], return_inverse=True)[1].astype(np.int64)
    return Evidence(x=rows.x[keep], y=rows.y[keep], heading=rows.psi_rad[keep], track=track)


def thinned(samples: Evidence, most: int = MAX_SAMPLES) -> Evidence:
    """Return at most so many samples, evenly taken."""
    if len(samples.x) <= most:
        return samples
    chosen = np.zeros(len(samples.x), bool)
    chosen[np.linspace(0, len(samples.x) - 1, most).astype(np.int64)] = True
    return samples.take(chosen)


def on_lanes(samples: Evidence, road: Road) -> float:
    """Return the share of samples that match a lane; 1 without samples."""
    few = thinned(samples, most=400)
    if not len(few.x):
        return 1.0
    return len(np.unique(match(road, few.x, few.y, few.heading).vehicle)) / len(few.x)
