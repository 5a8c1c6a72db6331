"""Evidence of where vehicles drive: poses of moving vehicles of a recording, and the lanes they are on."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import listed
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


def lane_distance(samples: Evidence, road: Road) -> float:
    """Return the median distance of samples to the middle of their lanes, m; nan without any."""
    few = thinned(samples)
    offsets = nearest_lanes(road, few.x, few.y, few.heading)[2] if len(few.x) else np.zeros(0)
    return float(np.median(np.abs(offsets))) if len(offsets) else math.nan


def nearest_lanes(
    road: Road, x: FloatArray, y: FloatArray, heading: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Match poses to their best lanes.

    Returns:
        Of the poses that match a lane: their indices, heading errors in rad and offsets in m.
    """
    matches = match(road, x, y, heading)
    best = np.append(True, np.diff(matches.vehicle) != 0)[: len(matches.vehicle)]
    return matches.vehicle[best], matches.heading_error[best], matches.offset[best]


def on_closed_lanes(samples: Evidence, road: Road) -> str | None:
    """Return a phrase with the remedy if most samples lie on lanes that the map closes to cars."""
    lanes = {i: replace(lane, kind="vehicle") for i, lane in road.lanes.items() if lane.kind != "vehicle"}
    few = thinned(samples, most=400)
    matches = match(replace(road, lanes=lanes), few.x, few.y, few.heading)
    if 2 * len(np.unique(matches.vehicle)) <= len(few.x):
        return None
    names = sorted({lanes[int(i)].subtype or str(i) for i in matches.lane_id})
    return f"they are on lanes that the map closes to cars: {listed(names)}; allow cars there"
