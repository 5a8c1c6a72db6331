"""Path tables of a seed scene: candidate paths of all vehicles, smoothed and sampled.

A path depends on the vehicle's pose in the seed scene and is the same in all futures.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain
from math import ceil
from typing import Any, Literal, TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.owned import owner_cache, recent
from scex_sumo.behaviors.driving.smoothing import drivable, resample
from scex_sumo.geometry.polylines import arc_lengths
from scex_sumo.road import Road
from scex_sumo.roads.routes import CandidatePath, candidate_paths, centreline, extended
from scex_sumo.scene import STEP_S, SceneHistory, SeedScene, VehicleIndex

DS_M = 0.5
BEHIND_M = 20.0  # behind the centre, for the rear axle and vehicles behind
FIRST_HORIZON_S = 8.0  # 3 s of a future, 3 s of a plan, and some acceleration
LONGER_S = 5.0  # longer futures get tables that are longer by 1, 3, 7, ... times this
ROUTE_M = 500.0  # of the routes for SUMO
_RECENT = 4  # sets of lines of a road: with recorded and with estimated headings, smoothed and driven
COARSE = 8  # for the first step of a projection
COLUMNS = ("x", "y", "cos", "sin", "heading", "curvature")
OFF_ROAD = CandidatePath(lanes=(), s=0.0, probability=1.0, angle=0.0)
PathChoice: TypeAlias = int | Literal["straight", "random"]
Redraw: TypeAlias = Callable[[Road, Sequence["PathLine"], FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True, eq=False)
class SeedPaths:
    """All candidate paths of all vehicles of a seed scene."""

    first: IntArray  # (V,) row of the first path; paths of a vehicle are consecutive, left to right
    count: IntArray  # (V,) number of paths, at least 1
    straight: IntArray  # (V,) index of the straightest path from the most probable lane
    draw_edges: FloatArray  # (P,) upper edge in [0, 1] of the path's share of `SceneHistory.route_draw`
    lanes: tuple[tuple[int, ...], ...]  # (P) lane ids; empty off the mapped lanes
    on_road: BoolArray  # (V,) False off the mapped lanes, where the path is a straight line
    # (P * N, 12) per sample: each of `COLUMNS`, then its change to the next sample
    table: FloatArray
    samples: int  # N, samples per path, `DS_M` apart
    speed_limit: FloatArray  # (P, N) m/s; off the lanes, the vehicle's own speed
    # (P, 3, M) every `COARSE`-th sample as -2x, -2y, x² + y², relative to `centre` (2,), m
    coarse: FloatArray
    centre: FloatArray
    slow_in_curves: bool  # every model slows down for curves; False on the maps that the models come with

    def choose(self, path: PathChoice, vehicle: IntArray, draw: FloatArray) -> IntArray:
        """Return (n,) path rows.

        Args:
            path: index from left to right, clamped to the vehicle's last path (-1 is the rightmost);
                ``straight``; ``random``, by `draw`.
            vehicle: (n,) index into the seed scene.
            draw: (n,) in [0, 1).
        """
        first: IntArray = self.first[vehicle]
        count: IntArray = self.count[vehicle]
        if path == "random":
            passed = np.zeros(len(vehicle), dtype=np.int64)
            for k in range(int(self.count.max()) - 1):
                row = first + np.minimum(k, count - 1)
                passed += (k < count - 1) & (draw >= self.draw_edges[row])
            return np.asarray(first + passed)
        if path == "straight":
            return np.asarray(first + self.straight[vehicle])
        index = path if path >= 0 else count + path
        return np.asarray(first + np.clip(index, 0, count - 1))

    @cached_property
    def bend(self) -> tuple[FloatArray, FloatArray]:
        """(P * N,) curvature and its change to the next sample, 1/m, each contiguous."""
        return np.ascontiguousarray(self.table[:, 5]), np.ascontiguousarray(self.table[:, 11])

    @cached_property
    def curve_curvature(self) -> FloatArray:
        """(P, N) |curvature| averaged over 3 m, 1/m, for curve speeds."""
        k = np.abs(self.table.reshape(len(self.lanes), self.samples, -1)[:, :, 5])
        reach = int(1.5 / DS_M)
        padded = np.pad(k, ((0, 0), (reach, reach)), mode="edge")
        width = 2 * reach + 1
        total = np.cumsum(np.pad(padded, ((0, 0), (1, 0))), axis=1)
        mean: FloatArray = (total[:, width:] - total[:, :-width]) / width
        return mean


def chosen_paths(
    history: SceneHistory,
    road: Road,
    who: VehicleIndex,
    path: PathChoice,
    *,
    redraw: Redraw | None = None,
) -> tuple[SeedPaths, IntArray]:
    """Return smooth paths of all vehicles, long enough for the present step, and the (n,) rows to follow.

    Args:
        path: index from left to right, ``straight`` or ``random`` (by the future's draw).
        redraw: as in `seed_paths`.

    Example:
        >>> history = scex.SceneHistory.of_scene(scex.read_seed(scex.example_path("roundabout")))
        >>> who = scex.VehicleIndex(future=np.array([0, 0]), vehicle=np.array([0, 1]))
        >>> paths, row = scex.chosen_paths(history, history.scene.road, who, "straight")
        >>> row.shape, len(paths.lanes) >= history.scene.vehicles
        ((2,), True)
    """
    # The length depends on the step alone, not on the batch. It doubles, so that all tables of a future
    # together need memory in proportion to its steps.
    further = max(0, ceil((history.step * STEP_S - 3.0) / LONGER_S))
    horizon = FIRST_HORIZON_S + LONGER_S * (2 ** further.bit_length() - 1)
    paths = seed_paths(history.scene, road, horizon, redraw)
    return paths, paths.choose(path, who.vehicle, history.route_draw[who.future, who.vehicle])


@owner_cache
def seed_paths(
    scene: SeedScene,
    road: Road,
    horizon_s: float = FIRST_HORIZON_S,
    redraw: Redraw | None = None,
) -> SeedPaths:
    """Tabulate the candidate paths of a seed scene.

    Args:
        horizon_s: time for which the fastest vehicle stays on its table, s.
        redraw: makes other lines of (P, N, 2) smoothed and raw centrelines, e.g. those that people drive.
    """
    smooth = _smooth_lines(scene, road, horizon_s)
    paths = _tabulate(road, smooth, redraw)
    if not scene.intentions:
        return paths
    factor = [1.0 if known is None else known.speed_factor for known in scene.intentions]
    on_road = np.array([line.on_road for line in smooth.lines])
    factors = np.where(on_road, np.repeat(factor, smooth.count), 1.0)
    return replace(paths, speed_limit=paths.speed_limit * factors[:, None])


@owner_cache
def _smooth_lines(
    scene: SeedScene,
    road: Road,
    horizon_s: float,
) -> _SmoothLines:
    """Return the smoothed candidate paths of a seed scene, arguments as of `seed_paths`."""
    now = scene.now
    ahead = max(15.0 * horizon_s, horizon_s * float(now.speed.max(initial=0.0)) + 40.0)
    lines: list[list[PathLine]] = []
    for v, routes in enumerate(candidate_paths(road, scene)):
        options = [PathLine(*centreline(road, p.lanes, p.s, BEHIND_M, ahead), p) for p in routes]
        lines.append(options or [_straight(scene, v, ahead)])
    every, count = list(chain.from_iterable(lines)), np.array([len(some) for some in lines], dtype=np.int64)
    raw = np.stack([resample(line.points, int((BEHIND_M + ahead) / DS_M) + 1, DS_M) for line in every])
    own_speed = np.repeat(now.speed, count)
    width, limit = np.full(raw.shape[:2], 3.5), np.repeat(own_speed[:, None], raw.shape[1], axis=1)
    for k, line in enumerate(every):
        if line.owner is not None:
            width[k], limit[k] = _of_lanes(road, line.points, line.owner, raw.shape[1])
    smooth = drivable(raw, np.maximum(width, 1.0) / 2, DS_M)
    return _SmoothLines(lines=every, count=count, raw=raw, smooth=smooth, limit=limit)


@owner_cache
def _recent_lines(road: Road) -> dict[tuple[Any, ...], FloatArray]:
    return {}


@dataclass(frozen=True)
class PathLine:
    """Centreline (P, 2) of a path before it is smoothed, m, and the lane under each of its points."""

    points: FloatArray
    owner: IntArray | None = None
    route: CandidatePath = OFF_ROAD

    @property
    def on_road(self) -> bool:
        """False for a straight line off the mapped lanes."""
        return bool(self.route.lanes)


@dataclass(frozen=True, kw_only=True, eq=False)
class _SmoothLines:
    """Lines of all vehicles, ``count`` (V,) of each; ``limit`` (K, N) of the speed, m/s.

    ``raw``, ``smooth`` are (K, N, 2), m.
    """

    lines: list[PathLine]
    count: IntArray
    raw: FloatArray
    smooth: FloatArray
    limit: FloatArray


def _straight(scene: SeedScene, v: int, ahead: float) -> PathLine:
    x, y, heading = (float(values[v]) for values in (scene.now.x, scene.now.y, scene.now.heading))
    s = np.array([-BEHIND_M, ahead])
    return PathLine(np.column_stack([x + s * np.cos(heading), y + s * np.sin(heading)]))


def _tabulate(road: Road, smooth_lines: _SmoothLines, redraw: Redraw | None) -> SeedPaths:
    lines, count, samples = smooth_lines.lines, smooth_lines.count, smooth_lines.raw.shape[1]
    known = _recent_lines(road)
    key = (redraw, *(line.route.lanes for line in lines), smooth_lines.raw.tobytes())
    even = recent(known, key, _RECENT, partial(_evenly, road, smooth_lines, redraw))
    centre = even.reshape(-1, 2).mean(axis=0)
    some = even[:, ::COARSE] - centre
    first = np.cumsum(count) - count
    parts = [slice(f, f + n) for f, n in zip(first, count, strict=True)]
    shares = np.concatenate([_shares(lines[part]) for part in parts])
    return SeedPaths(
        first=first,
        count=count,
        straight=np.array([_straightest(lines[part]) for part in parts]),
        draw_edges=np.concatenate([np.cumsum(shares[part]) / shares[part].sum() for part in parts]),
        lanes=tuple(line.route.lanes for line in lines),
        on_road=np.array([line.on_road for line in lines])[first],
        table=_columns(even).reshape(-1, 2 * len(COLUMNS)),
        samples=samples,
        speed_limit=smooth_lines.limit,
        coarse=np.stack([-2 * some[..., 0], -2 * some[..., 1], (some**2).sum(-1)], 1),
        centre=centre,
        slow_in_curves=road.sumo_lanes,
    )


def _evenly(road: Road, given: _SmoothLines, redraw: Redraw | None) -> FloatArray:
    """Return the lines (K, N, 2) that are driven, every `DS_M`."""
    smooth = given.smooth
    if redraw is not None:
        smooth = redraw(road, given.lines, smooth.copy(), given.raw)
    return np.stack([resample(line, given.raw.shape[1], DS_M) for line in smooth])


def _shares(lines: list[PathLine]) -> FloatArray:
    """Return the share of each path of a vehicle in random draws: an intended one has all."""
    intended = np.array([float(line.route.intended) for line in lines])
    return intended if intended.any() else np.array([line.route.probability for line in lines])


def _straightest(lines: list[PathLine]) -> int:
    """Return the index of the intended path, else of the straightest from the most probable lane."""
    routes = [line.route for line in lines]
    if any(route.intended for route in routes):
        return next(k for k, route in enumerate(routes) if route.intended)
    by_lane: dict[tuple[int, ...], float] = {}
    for route in routes:
        by_lane[route.lanes[:1]] = by_lane.get(route.lanes[:1], 0.0) + route.probability
    likeliest = max(by_lane, key=lambda lane: by_lane[lane])
    some = [k for k, route in enumerate(routes) if route.lanes[:1] == likeliest and route.straight_on]
    return min((abs(routes[k].angle), k) for k in some)[1]


def _of_lanes(road: Road, points: FloatArray, owner: IntArray, samples: int) -> tuple[FloatArray, FloatArray]:
    ids, inverse = np.unique(owner, return_inverse=True)
    at = np.searchsorted(arc_lengths(points), DS_M * np.arange(samples), side="right") - 1
    at = inverse[np.clip(at, 0, len(owner) - 1)]
    lanes = [road.lanes[int(i)] for i in ids]
    width = np.array([lane.width_m for lane in lanes])
    return width[at], np.array([lane.speed_limit_mps for lane in lanes])[at]


def _columns(even: FloatArray) -> FloatArray:
    step = np.gradient(even, axis=1)
    heading = np.unwrap(np.arctan2(step[..., 1], step[..., 0]), axis=1)  # without jumps of 2 pi
    curvature = np.gradient(heading, DS_M, axis=1)
    columns = np.stack([even[..., 0], even[..., 1], np.cos(heading), np.sin(heading), heading, curvature], -1)
    slope = np.diff(columns, axis=1, append=columns[:, -1:])
    # The last step goes on straight, for positions past the end.
    slope[:, -1, :2] = DS_M * columns[:, -1, 2:4]
    return np.concatenate([columns, slope], -1)


def planned_lanes(
    scene: SeedScene, road: Road, path: PathChoice, vehicle: IntArray, draw: FloatArray
) -> list[tuple[int, ...]]:
    """Return (n) lane ids of paths, extended by 500 m; empty off the mapped lanes."""
    paths = seed_paths(scene, road)
    rows = paths.choose(path, vehicle, draw).tolist()
    whole = {row: extended(road, paths.lanes[row], ROUTE_M) if paths.lanes[row] else () for row in {*rows}}
    return [whole[row] for row in rows]
