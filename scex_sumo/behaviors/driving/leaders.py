"""Leader search: the next vehicle or obstacle along each driver's path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, Rows, least_of
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.driving.paths import DS_M, OnPath, SeedPaths
from scex_sumo.geometry.polylines import COARSE, Feet
from scex_sumo.scene import SceneHistory, States, VehicleIndex

LATER_WEIGHT = 0.1  # m² per m along the path; the nearest coarse sample is up to 4 m² off
MAX_PAIRS = 60_000  # at a time: bounds the memory, fits the processor's cache
MIN_ACROSS_MPS = 1e-3
CORRIDOR_MARGIN_M = 0.3  # of the driver's corridor, beyond its width on each side
OBSTACLE_CLEARANCE_M = 1.5  # of an obstacle's centre from the path


@dataclass(frozen=True, kw_only=True, eq=False)
class Leaders(Rows):
    """The leader of each of n vehicles."""

    gap: FloatArray  # (n,) bumper to bumper, m; inf without a leader, negative on overlap
    speed: FloatArray  # (n,) along the path, m/s; 0 without a leader
    index: IntArray  # (n,) column: vehicles first, then obstacles; -1 without a leader


@dataclass(frozen=True, kw_only=True, eq=False)
class Ahead(Rows):
    """The k vehicles and obstacles in the way of n drivers."""

    driver: IntArray  # (k,) the driver
    other: IntArray  # (k,) column: vehicles first, then obstacles
    gap: FloatArray  # (k,) bumper to bumper along the path, m
    speed: FloatArray  # (k,) component along the path, m/s
    cos: FloatArray  # (k,) cosine of its heading against the path's
    leaves: FloatArray  # (k,) s until it has left the driver's corridor with constant velocity

    def leaders(self, n: int) -> Leaders:
        """Return the one with the smallest gap for each of the n drivers."""
        result = Leaders(gap=np.full(n, np.inf), speed=np.zeros(n), index=np.full(n, -1))
        chosen = least_of(self.driver, self.gap, self.other)
        driver = self.driver[chosen]
        result.gap[driver], result.speed[driver] = self.gap[chosen], self.speed[chosen]
        result.index[driver] = self.other[chosen]
        return result


@dataclass(frozen=True, kw_only=True, eq=False)
class BoxesOnPaths(Rows):
    """Boxes of k vehicles on paths."""

    s: FloatArray  # (k,) arc length of the centre, m
    offset: FloatArray  # (k,) of the centre from the path, m, left positive
    cos: FloatArray  # (k,) of its heading against the path's; so ``sin``
    sin: FloatArray
    along: FloatArray  # (k,) half extent along the path, m
    across: FloatArray  # (k,) half extent across it, m

    @classmethod
    def of(cls, feet: Feet, heading: FloatArray, length: FloatArray, width: FloatArray) -> BoxesOnPaths:
        """Place boxes with headings (k,), rad, and sizes (k,), m, whose centres have these foot points."""
        s, offset, direction = feet
        cos, sin = np.cos(heading - direction), np.sin(heading - direction)
        along, across = half_extents(cos, sin, length, width)
        return cls(s=s, offset=offset, cos=cos, sin=sin, along=along, across=across)


def half_extents(
    cos: FloatArray, sin: FloatArray, length: FloatArray, width: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return how far rectangles reach along and across a direction from their centres, m.

    ``cos``, ``sin``: of the angle of their length to it; ``length``, ``width``: whole, m; all broadcast.
    """
    cos, sin = np.abs(cos), np.abs(sin)
    return (cos * length + sin * width) / 2, (cos * width + sin * length) / 2


def find_leaders(
    history: SceneHistory,
    vehicles: VehicleIndex,
    paths: SeedPaths,
    row: IntArray,
    s_centre: FloatArray,
    *,
    clearance: float = 1.5,
    radius: float = 100.0,
) -> Leaders:
    """Find the nearest vehicle or obstacle ahead of each of n drivers on its path.

    Args:
        row: (n,) path of each driver in ``paths``, see `chosen_paths`.
        s_centre: (n,) where it is on it, m, see `path_positions`.
        clearance: of a vehicle's centre from the path, m; bodies in the driver's corridor count, too.
        radius: that drivers see, m.

    Returns:
        ``gap`` (n,) bumper to bumper, m, inf without a leader; ``speed`` (n,) along the path, m/s; ``index``
        (n,), -1 without.

    Example:
        >>> history = scex.SceneHistory.of_scene(scex.read_seed(scex.example_path("roundabout")))
        >>> vehicles = scex.VehicleIndex(future=np.array([0]), vehicle=np.array([3]))
        >>> paths, row = scex.chosen_paths(history, history.scene.road, vehicles, "straight")
        >>> s, _, _ = scex.path_positions(history, vehicles, paths, row)
        >>> leader = scex.find_leaders(history, vehicles, paths, row, s, radius=80.0)
        >>> bool(leader.gap[0] > 0)
        True
    """
    near = find_ahead(history, vehicles, paths, row, s_centre, clearance=clearance, radius=radius)
    return near.leaders(len(vehicles))


def find_ahead(
    history: SceneHistory,
    vehicles: VehicleIndex,
    paths: SeedPaths,
    row: IntArray,
    s_centre: FloatArray,
    *,
    clearance: float = 1.5,
    radius: float = 100.0,
    aside: FloatArray | float = 0.0,
    margin: float = CORRIDOR_MARGIN_M,
) -> Ahead:
    """Find the vehicles and obstacles on or near each driver's path, within the perception radius.

    One counts if its body is in the driver's corridor and its centre ahead of the driver's; or if its nearest
    end is ahead of the driver's front, it does not face the driver (within 60 degrees), and its centre is
    near the path. ``aside``: (n,) offset of each driver's line, m, left positive; ``margin``: of the corridor
    beyond the driver's width, on each side, m; else as `find_leaders`.
    """
    others, aside = everyone(history), np.broadcast_to(aside, row.shape)
    clear = np.where(others.obstacle, OBSTACLE_CLEARANCE_M, clearance)
    size, parts = max(1, MAX_PAIRS // max(1, others.length.size)), []
    for begin in range(0, max(1, len(vehicles)), size):
        k = slice(begin, begin + size)
        on = OnPath(history, vehicles[k], paths, row[k])
        parts.append(_ahead_of(on, others, s_centre[k], aside[k], clear, radius, margin))
        parts[-1].driver[:] += begin
    return Ahead.join(parts)


def _ahead_of(
    on: OnPath,
    others: Everyone,
    s_centre: FloatArray,
    aside: FloatArray,
    clearance: FloatArray,
    radius: float,
    margin: float,
) -> Ahead:
    history, vehicles, paths, row = on
    now = on.now
    length, width = history.scene.length[vehicles.vehicle], history.scene.width[vehicles.vehicle]
    ox, oy = others.states.x[vehicles.future], others.states.y[vehicles.future]  # (n, M)
    near = (ox - now.x[:, None]) ** 2 + (oy - now.y[:, None]) ** 2 <= radius**2
    near &= others.present[vehicles.future]
    near[np.arange(len(vehicles)), vehicles.vehicle] = False
    # Points further than this from every coarse sample count in no case.
    bodies = float(width.max(initial=0.0)) / 2 + margin + others.longest / 2
    reach = max(float(clearance.max(initial=0.0)), bodies) + float(np.abs(aside).max(initial=0.0))
    i, j, guess = _first_guess(paths, row, s_centre, ox, oy, near, radius, reach + COARSE * DS_M)
    feet = paths.refine(row[i], guess, ox[i, j], oy[i, j], 3)
    heading, speed = (a[vehicles.future[i], j] for a in (others.states.heading, others.states.speed))
    box = BoxesOnPaths.of(feet, heading, others.length[j], others.width[j])
    offset, ahead = box.offset - aside[i], box.s - s_centre[i]
    body = np.abs(offset) - box.across
    inside, gap = body <= width[i] / 2 + margin, ahead - box.along - length[i] / 2
    follows = (gap > 0) & (box.cos >= -0.5)
    counts = np.where(follows, (np.abs(offset) <= clearance[j]) | inside, inside & (ahead > 0))
    # Bodies have to pass each other by half of both widths, on the side where it is going.
    across = speed * box.sin
    to_go = np.abs(offset) - body + width[i] / 2 - np.sign(across) * offset
    leaves = np.maximum(to_go, 0.0) / np.maximum(np.abs(across), MIN_ACROSS_MPS)
    all_ahead = Ahead(driver=i, other=j, gap=gap, speed=speed * box.cos, cos=box.cos, leaves=leaves)
    return all_ahead.take(counts)


def _first_guess(
    paths: SeedPaths,
    row: IntArray,
    s: FloatArray,
    x: FloatArray,
    y: FloatArray,
    near: BoolArray,
    radius: float,
    reach: float,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return driver, column and arc length of the nearest coarse sample, of near points within reach."""
    spacing = COARSE * DS_M
    samples = paths.coarse.shape[2]
    span = min(samples, int(radius / spacing) + 4)
    start = np.clip((s / spacing).astype(np.int64) - 2, 0, samples - span)
    window = start[:, None] + np.arange(span)
    coarse = paths.coarse.transpose(0, 2, 1)[row[:, None], window]  # (n, span, 3)
    # A path may pass a place twice, e.g. in a roundabout: the first time counts.
    penalty_m2 = LATER_WEIGHT * spacing * np.arange(span)
    coarse[:, :, 2] += penalty_m2
    px, py = x - paths.centre[0], y - paths.centre[1]
    for column, at in enumerate((px, py)):
        of_path = coarse[:, :, column] / -2
        low, high = of_path.min(axis=1)[:, None], of_path.max(axis=1)[:, None]
        near = near & (at >= low - reach) & (at <= high + reach)
    i, j = np.nonzero(near)
    place = np.arange(len(i)) - np.searchsorted(i, i)  # among the driver's points
    points = np.zeros((len(row), place.max(initial=0) + 1, 3))
    points[i, place] = np.stack([px[i, j], py[i, j], np.ones(len(i))], axis=1)
    cost = (points @ coarse.transpose(0, 2, 1))[i, place]
    best = np.argmin(cost, axis=1)
    square = cost[np.arange(len(i)), best] - penalty_m2[best] + px[i, j] ** 2 + py[i, j] ** 2
    close = square <= reach**2
    return i[close], j[close], (start[i] + best)[close] * spacing


class Everyone(NamedTuple):
    """Vehicles and obstacles of all futures; M = V + O columns."""

    states: States  # (C, M) now
    present: BoolArray
    length: FloatArray  # (M,) m
    width: FloatArray  # (M,) m
    obstacle: BoolArray  # (M,) or a person that takes part
    longest: float  # largest diagonal, m


@owner_cache
def everyone(history: SceneHistory) -> Everyone:
    """Join vehicles and obstacles."""
    scene, now = history.scene, history.now
    present, length, width = np.ones(now.shape, dtype=np.bool_), scene.length, scene.width
    obstacles = scene.obstacles
    if obstacles is not None:
        shape = (now.shape[0], len(obstacles.ids))
        states, there = obstacles.at(history.step)
        spread = states.map(lambda values: np.broadcast_to(values, shape))
        now = States.concatenate([now, spread], axis=1)
        present = np.concatenate([present, np.broadcast_to(there, shape)], axis=1)
        length, width = np.append(length, obstacles.length), np.append(width, obstacles.width)
    obstacle = np.arange(len(length)) >= scene.vehicles
    if scene.people is not None:
        obstacle[: scene.vehicles] = scene.people
    longest = float(np.sqrt(length**2 + width**2).max(initial=0.0))
    return Everyone(now, present, length, width, obstacle, longest)
