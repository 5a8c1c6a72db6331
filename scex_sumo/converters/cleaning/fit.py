"""Fit of tracks to the lanes of their map: a shift and a turn by robust least squares."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.tracks.rows import TrackRows
from scex_sumo.road import Road
from scex_sumo.roads.matching import match

LANE_SIGMA_M = 0.5  # samples farther off the middle count less
SHIFT_SIGMA_M = 1.0  # usual offsets
TURN_SIGMA_RAD = math.radians(1.5)
# Number of independent observations at most: samples of one track share its error.
INDEPENDENT = 30
MIN_OFFSET_M = 0.3  # across the lanes; smaller offsets are left alone
MIN_GAIN = 0.3  # by which the spread within lanes must shrink, for tracks that the estimate has not seen
MAX_OFFSET_M = 3.0  # a larger offset means a wrong origin
_ROUNDS, _STILL_M, _STILL_RAD = 6, 0.005, 1e-4


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """Shift in m, and turn about a centre in rad, that put tracks onto lanes."""

    centre: tuple[float, float]
    dx: float = 0.0
    dy: float = 0.0
    turn: float = 0.0

    def moved(self, rows: TrackRows) -> TrackRows:
        """Return tracks with their positions, headings and velocities moved."""
        c, s = math.cos(self.turn), math.sin(self.turn)
        rx, ry = rows.x - self.centre[0], rows.y - self.centre[1]
        x, y = self.centre[0] + c * rx - s * ry + self.dx, self.centre[1] + s * rx + c * ry + self.dy
        return rows.turned(self.turn).with_columns(x=x, y=y)


def is_certain(fit: Alignment, samples: TrackRows, road: Road, before: FloatArray) -> bool:
    """Whether an offset is large, and fits tracks that it was not estimated from, too."""
    moved, psi = fit.moved(samples), samples.psi_rad
    across = (moved.y - samples.y) * np.cos(psi) - (moved.x - samples.x) * np.sin(psi)
    if float(np.median(np.abs(across))) < MIN_OFFSET_M or math.hypot(fit.dx, fit.dy) > MAX_OFFSET_M:
        return False
    even: BoolArray = samples.track % 2 == 0
    halves = [(samples.take(half), samples.take(~half)) for half in (even, ~even)]
    unseen = np.concatenate([matched(other, road, fit_to_lanes(half, road))[-1] for half, other in halves])
    return _spread(unseen) <= (1.0 - MIN_GAIN) * _spread(before)


def fit_to_lanes(samples: TrackRows, road: Road) -> Alignment:
    """Return the alignment that brings most samples near the middle of lanes, but for a common habit."""
    centre = float(samples.x.mean()), float(samples.y.mean())
    fit, habit = Alignment(centre=centre), 0.0
    prior = np.diag([s**-2.0 for s in (SHIFT_SIGMA_M, SHIFT_SIGMA_M, TURN_SIGMA_RAD, LANE_SIGMA_M)])
    independent = min(samples.tracks, INDEPENDENT)
    for _ in range(_ROUNDS):
        moved, lane_heading, sample, offset = matched(samples, road, fit)
        if not len(sample):
            return fit
        nx, ny = -np.sin(lane_heading), np.cos(lane_heading)
        arm = -nx * (moved.y[sample] - centre[1] - fit.dy) + ny * (moved.x[sample] - centre[0] - fit.dx)
        slopes = np.stack((nx, ny, arm, np.ones(len(sample))), axis=1)
        estimate = np.array((fit.dx, fit.dy, fit.turn, habit))
        step = np.zeros(4)
        for _ in range(3):
            residual = offset + habit + slopes @ step
            weight = 1.0 / (1.0 + (residual / LANE_SIGMA_M) ** 2)
            track_weight = np.bincount(samples.track[sample], weight, samples.tracks)
            weight = weight / np.sqrt(np.maximum(track_weight, 1e-9))[samples.track[sample]]
            weight *= independent / (weight.sum() * LANE_SIGMA_M**2)
            weighted = (slopes * weight[:, None]).T
            step = np.linalg.solve(weighted @ slopes + prior, -weighted @ (offset + habit) - prior @ estimate)
        dx, dy, turn, habit = (float(value) for value in estimate + step)
        fit = replace(fit, dx=dx, dy=dy, turn=turn)
        if np.abs(step[:2]).max() < _STILL_M and abs(step[2]) < _STILL_RAD:
            break
    return fit


def matched(
    samples: TrackRows, road: Road, alignment: Alignment
) -> tuple[TrackRows, FloatArray, IntArray, FloatArray]:
    """Return moved samples, and heading of the lane, index and offset of those that match one."""
    moved = alignment.moved(samples)
    matches = match(road, moved.x, moved.y, moved.psi_rad)
    sample = matches.vehicle[matches.best]
    heading = moved.psi_rad[sample] - matches.heading_error[matches.best]
    return moved, heading, sample, matches.offset[matches.best]


def _spread(offsets: FloatArray) -> float:
    return float(np.median(np.abs(offsets - np.median(offsets)))) if len(offsets) else math.inf
