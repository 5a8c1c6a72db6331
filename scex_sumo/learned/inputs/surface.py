"""Road seen from above: the room that a path has on both sides, and a raster image."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.driving.paths import DS_M, SeedPaths
from scex_sumo.geometry.polylines import along, length_of
from scex_sumo.road import Lane, Road

CELL_M = 0.25
MAX_CELLS = 12_000_000  # larger maps get larger cells: about 200 MB
MARGIN_M = 3.0  # around the outermost lane
MAX_ROOM_M = 12.0
STRIDE = 4  # of the samples of a path in the table
MARCH_STEPS = 24
PIXEL_M = 1.0
FINE = 2  # cells per pixel and direction, for soft edges
RASTER_MARGIN_M = 16.0  # around the outermost lane
MAX_PIXELS = 2_000_000  # larger maps are cut around their middle
CHANNELS = ("drivable", "boundary", "marking", "cos", "sin", "limit", "crosswalk")
LIMIT_SCALE_MPS = 15.0
CROSSING = ("crosswalk", "zebra")


class Surface(NamedTuple):
    """Grid of distances to the edge of the vehicle lanes."""

    depth: FloatArray  # (R, C) m, positive inside; row 0 is the lowest y
    corner: FloatArray  # (2,) centre of the cell in row 0, column 0, m
    cell: float  # side, m

    def at(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the depth at points, m, bilinear; beyond the grid that of its border."""
        rows, columns = self.depth.shape
        u = np.clip((x - self.corner[0]) / self.cell, 0, columns - 1.001)
        v = np.clip((y - self.corner[1]) / self.cell, 0, rows - 1.001)
        i, j = v.astype(np.int64), u.astype(np.int64)
        fi, fj = v - i, u - j
        flat, index = self.depth.ravel(), i * columns + j
        below = flat[index] * (1 - fj) + flat[index + 1] * fj
        above = flat[index + columns] * (1 - fj) + flat[index + columns + 1] * fj
        return np.asarray(below * (1 - fi) + above * fi)


class PathRoom(NamedTuple):
    """Room beside the paths of a seed scene."""

    left: FloatArray  # (P, K) m from the path to the edge of the surface, at most `MAX_ROOM_M`
    right: FloatArray  # (P, K) m
    end: FloatArray  # (P,) arc length of the last sample on the surface, m; 0 without one
    spacing: float  # of the samples, m

    def at(self, path: IntArray, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the room left and right at arc lengths; the smaller of two samples counts."""
        index = np.clip((s / self.spacing).astype(np.int64), 0, self.left.shape[1] - 2)
        left, right = (np.minimum(a[path, index], a[path, index + 1]) for a in (self.left, self.right))
        return left, right


def lane_outline(lane: Lane) -> FloatArray:
    """Return (L, 2) outline of a lane; if both bounds are one line, its width around the centreline."""
    left, right = lane.left_bound, lane.right_bound
    if len(left) != len(right) or not np.allclose(left, right):
        return lane.outline
    step = np.gradient(lane.centreline, axis=0)
    normal = np.column_stack([-step[:, 1], step[:, 0]])
    normal /= np.maximum(np.hypot(*normal.T), 1e-9)[:, None]
    half = lane.width_m / 2 * normal
    return np.concatenate([lane.centreline + half, (lane.centreline - half)[::-1]])


@owner_cache
def surface_of(road: Road) -> Surface:
    """Return the union of a map's vehicle lanes."""
    outlines = [lane_outline(lane) for lane in road.vehicle_lanes.values()]
    if not outlines:
        return Surface(np.full((2, 2), -MAX_ROOM_M), np.zeros(2), 1.0)
    points = np.concatenate(outlines)
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    cell = max(CELL_M, float(np.sqrt(np.prod(high - low) / MAX_CELLS)))
    columns, rows = (np.ceil((high - low) / cell).astype(int) + 1).tolist()
    inside = np.zeros((rows, columns), dtype=np.bool_)
    for outline in outlines:
        fill(inside, outline, low, cell)
    # cells next to the edge are half a cell away from it
    from scipy.ndimage import distance_transform_edt  # takes 0.2 s to import

    depth = distance_transform_edt(inside) - distance_transform_edt(~inside)
    return Surface((depth - 0.5 * np.sign(depth)) * cell, low, cell)


def cells_of(
    outline: FloatArray, low: FloatArray, cell: float, shape: tuple[int, int]
) -> tuple[slice, slice, BoolArray]:
    """Return rows, columns and mask of a grid's cells in a polygon."""
    first = np.clip(np.floor((outline.min(axis=0) - low) / cell).astype(int), 0, None)
    last = np.ceil((outline.max(axis=0) - low) / cell).astype(int) + 1
    rows = slice(first[1], min(last[1], shape[0]))
    columns = slice(first[0], min(last[0], shape[1]))
    x = low[0] + cell * np.arange(columns.start, columns.stop)
    y = low[1] + cell * np.arange(rows.start, rows.stop)
    if not len(x) or not len(y):
        return rows, columns, np.zeros((len(y), len(x)), dtype=np.bool_)
    polygon = shapely.make_valid(shapely.polygons(outline))
    shapely.prepare(polygon)
    hit = shapely.intersects_xy(polygon, np.tile(x, len(y)), np.repeat(y, len(x)))
    return rows, columns, np.asarray(hit).reshape(len(y), len(x))


def fill(grid: BoolArray | FloatArray, outline: FloatArray, low: FloatArray, cell: float) -> None:
    """Set the cells of a grid in a polygon to 1."""
    rows, columns, hit = cells_of(outline, low, cell, (grid.shape[0], grid.shape[1]))
    grid[rows, columns][hit] = 1


@owner_cache
def path_room(paths: SeedPaths, road: Road) -> PathRoom:
    """Measure the room beside all paths of a seed scene by rays to both sides."""
    surface = surface_of(road)
    table = paths.table.reshape(*paths.x.shape, -1)[:, ::STRIDE]
    x, y, cos, sin = (table[..., k] for k in range(4))
    inside = surface.at(x, y) > 0
    left = _march(surface, x, y, -sin, cos)
    right = _march(surface, x, y, sin, -cos)
    last = np.maximum.accumulate(np.where(inside, np.arange(inside.shape[1]), 0), axis=1)
    spacing = STRIDE * DS_M
    left, right = (np.take_along_axis(side, last, axis=1) for side in (left, right))
    return PathRoom(left, right, last[:, -1] * spacing, spacing)


def _march(surface: Surface, x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray) -> FloatArray:
    marched_m, inside = np.zeros_like(x), np.ones(x.shape, dtype=np.bool_)
    for _ in range(MARCH_STEPS):
        depth = surface.at(x + marched_m * dx, y + marched_m * dy)
        inside &= depth > 0
        marched_m += np.where(inside, np.maximum(depth, surface.cell), 0.0)
    marched_m += np.minimum(surface.at(x + marched_m * dx, y + marched_m * dy), 0.0)
    return np.clip(marched_m, 0.0, MAX_ROOM_M)


class Raster(NamedTuple):
    """A map seen from above."""

    # (7, R, C) `CHANNELS`, about -1 to 1; row 0 is the lowest y; cos and sin are times the drivable share
    values: FloatArray
    corner: FloatArray  # (2,) centre of the pixel in row 0, column 0, m


@owner_cache
def raster_of(road: Road) -> Raster:
    """Draw a map: vehicle lanes, bounds, markings, directions and limits, crosswalks."""
    lanes = list(road.vehicle_lanes.values())
    points = np.concatenate([lane_outline(lane) for lane in lanes]) if lanes else np.zeros((1, 2))
    low, high = points.min(axis=0) - RASTER_MARGIN_M, points.max(axis=0) + RASTER_MARGIN_M
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
    return Raster(values, corner)


def _draw_lane(fine: FloatArray, count: FloatArray, lane: Lane, corner: FloatArray) -> None:
    shape = count.shape[0], count.shape[1]
    rows, columns, hit = cells_of(lane_outline(lane), corner, PIXEL_M / FINE, shape)
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
