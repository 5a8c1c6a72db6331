"""Raster image of the road seen from above."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.geometry.polylines import along, length_of
from scex_sumo.learned.inputs.surface import cells_of, fill, lane_outline
from scex_sumo.road import Lane, Road

PIXEL_M = 1.0
FINE = 2  # cells per pixel and direction, for soft edges
MARGIN_M = 16.0  # around the outermost lane
MAX_PIXELS = 2_000_000  # larger maps are cut around their middle
CHANNELS = ("drivable", "boundary", "marking", "cos", "sin", "limit", "crosswalk")
LIMIT_SCALE_MPS = 15.0
CROSSING = ("crosswalk", "zebra")


@dataclass(frozen=True, kw_only=True, eq=False)
class Raster:
    """A map seen from above."""

    # (7, R, C) `CHANNELS`, about -1 to 1; row 0 is the lowest y; cos and sin are times the drivable share
    values: FloatArray
    corner: FloatArray  # (2,) centre of the pixel in row 0, column 0, m


@owner_cache
def raster_of(road: Road) -> Raster:
    """Draw a map: vehicle lanes, bounds, markings, directions and limits, crosswalks."""
    lanes = list(road.vehicle_lanes.values())
    points = np.concatenate([lane_outline(lane) for lane in lanes]) if lanes else np.zeros((1, 2))
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    middle, size = (low + high) / 2, np.minimum(high - low, np.sqrt(MAX_PIXELS) * PIXEL_M)
    corner = middle - size / 2
    columns, rows = (np.ceil(size / PIXEL_M).astype(int) + 1).tolist()
    values = np.zeros((len(CHANNELS), rows, columns))
    fine = np.zeros((4, rows * FINE, columns * FINE))
    count = np.zeros((rows * FINE, columns * FINE))
    fine_corner = corner - PIXEL_M / 2 + PIXEL_M / FINE / 2
    for lane in lanes:
        _draw_lane(fine, count, lane, fine_corner)
    covered = np.maximum(count, 1.0)
    fine[1:] /= covered
    values[[0, 3, 4, 5]] = fine.reshape(4, rows, FINE, columns, FINE).mean(axis=(2, 4))
    for lane in lanes:
        for bound in (lane.left_bound, lane.right_bound):
            _draw_line(values[1], bound, corner)
    for marking in road.markings:
        _draw_line(values[2], marking.points, corner)
    for area in road.areas:
        if area.kind in CROSSING and len(area.outline) >= 3:
            fill(values[6], area.outline, corner, PIXEL_M)
    return Raster(values=values, corner=corner)


def _draw_lane(fine: FloatArray, count: FloatArray, lane: Lane, corner: FloatArray) -> None:
    rows, columns, hit = cells_of(
        lane_outline(lane), corner, PIXEL_M / FINE, (count.shape[0], count.shape[1])
    )
    if not hit.any():
        return
    x = corner[0] + PIXEL_M / FINE * np.arange(columns.start, columns.stop)
    y = corner[1] + PIXEL_M / FINE * np.arange(rows.start, rows.stop)
    length = length_of(lane.centreline)
    line = along(lane.centreline, np.linspace(0.0, length, max(2, int(length) + 1)))
    step = np.gradient(line, axis=0)
    direction = step / np.maximum(np.hypot(*step.T), 1e-9)[:, None]
    i, j = np.nonzero(hit)
    nearest = np.argmin((x[j][:, None] - line[:, 0]) ** 2 + (y[i][:, None] - line[:, 1]) ** 2, axis=1)
    i, j = i + rows.start, j + columns.start
    fine[0, i, j] = 1.0
    fine[1, i, j] += direction[nearest, 0]
    fine[2, i, j] += direction[nearest, 1]
    fine[3, i, j] += lane.speed_limit_mps / LIMIT_SCALE_MPS
    count[i, j] += 1


def _draw_line(channel: FloatArray, points: FloatArray, corner: FloatArray) -> None:
    if len(points) < 2:
        return
    length = length_of(points)
    dense = along(points, np.linspace(0.0, length, int(length / (PIXEL_M / 4)) + 2))
    column, row = np.round((dense - corner) / PIXEL_M).astype(int).T
    inside = (row >= 0) & (row < channel.shape[0]) & (column >= 0) & (column < channel.shape[1])
    channel[row[inside], column[inside]] = 1.0
