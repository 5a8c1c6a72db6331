"""Paths of a seed scene: candidate paths of all vehicles, smoothed and sampled; places of vehicles on them.

A path depends on the vehicle's pose in the seed scene and is the same in all futures.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import chain
from math import ceil
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, least_of
from scex_sumo.base.owned import owner_cache, recent
from scex_sumo.geometry.polylines import Feet, Paths, along, arc_lengths, curvature, length_of, wrap
from scex_sumo.scene import STEP_S, SceneHistory, SeedScene, States, VehicleIndex

if TYPE_CHECKING:
    from scex_sumo.road import Road
    from scex_sumo.roads.routes import CandidatePath

DS_M = 0.5
BEHIND_M = 20.0  # behind the centre, for the rear axle and vehicles behind
FIRST_HORIZON_S = 8.0  # 3 s of a future, 3 s of a plan, and some acceleration
LONGER_S = 5.0  # longer futures get tables that are longer by 1, 3, 7, ... times this
OTHER_PATH = 1.0  # a vehicle is on another path if that fits better than the straightest by this
OFFSET_SIGMA_M, HEADING_SIGMA_RAD = 0.8, 0.15
_RECENT = 4  # sets of lines of a road: with recorded and with estimated headings, smoothed and driven
PathChoice: TypeAlias = int | Literal["straight", "random"]
Redraw: TypeAlias = "Callable[[Road, SeedPaths], FloatArray]"
BASE_SIGMA_M = 1.5  # a turn of 8 m radius moves inwards by 0.14 m
CURVATURES = (0.33, 0.25, 0.195, 0.165)  # 1/m, tried in this order; the last leaves room to correct


@dataclass(frozen=True, kw_only=True, eq=False)
class SeedPaths(Paths):
    """All candidate paths of all vehicles of a seed scene, sampled every `DS_M`."""

    first: IntArray  # (V,) row of the first path; paths of a vehicle are consecutive, left to right
    count: IntArray  # (V,) number of paths, at least 1
    straight: IntArray  # (V,) index of the straightest path from the most probable lane
    draw_edges: FloatArray  # (P,) upper edge in [0, 1] of the path's share of `SceneHistory.route_draw`
    lanes: tuple[tuple[int, ...], ...]  # (P) lane ids; empty off the mapped lanes
    on_road: BoolArray  # (V,) False off the mapped lanes, where the path is a straight line
    speed_limit: FloatArray  # (P, N) m/s; off the lanes, the vehicle's own speed
    slow_in_curves: bool  # every model slows down for curves; False on the maps that the models come with
    # (P) centreline (M, 2) of each path, m, and (M,) the lane under each point; None off the lanes
    centrelines: tuple[tuple[FloatArray, IntArray] | None, ...]
    raw: FloatArray  # (P, N, 2) the same every `DS_M`, m
    smooth: FloatArray  # (P, N, 2) as a car can drive them

    def choose(self, path: PathChoice, vehicle: IntArray, draw: FloatArray) -> IntArray:
        """Return (n,) path rows of vehicles (n,), by draws (n,) in [0, 1) if random; see `chosen_paths`."""
        first, count = self.first[vehicle], self.count[vehicle]
        if path == "random":
            return self.drawn(vehicle, draw, self.draw_edges)
        if path == "straight":
            return np.asarray(first + self.straight[vehicle])
        index = path if path >= 0 else count + path
        return np.asarray(first + np.clip(index, 0, count - 1))

    def drawn(self, vehicle: IntArray, draw: FloatArray, edges: FloatArray) -> IntArray:
        """Return (n,) path rows of vehicles (n,), by draws (n,) and the `upper_edges` (P,) of all paths."""
        row: IntArray = self.first[vehicle]
        last = row + self.count[vehicle] - 1
        for _ in range(int(self.count.max(initial=1)) - 1):
            row = row + ((row < last) & (draw >= edges[row]))
        return row

    @cached_property
    def curve_curvature(self) -> FloatArray:
        """(P, N) |curvature| averaged over 3 m, 1/m, for curve speeds."""
        k, reach = np.abs(self.bend[0].reshape(self.x.shape)), int(1.5 / DS_M)
        padded, width = np.pad(k, ((0, 0), (reach, reach)), mode="edge"), 2 * reach + 1
        total = np.cumsum(np.pad(padded, ((0, 0), (1, 0))), axis=1)
        return np.asarray((total[:, width:] - total[:, :-width]) / width)


class OnPath(NamedTuple):
    """n vehicles, each on a path."""

    history: SceneHistory
    vehicles: VehicleIndex
    paths: SeedPaths
    row: IntArray  # (n,) path of each vehicle in ``paths``

    @property
    def now(self) -> States:
        """(n,) present states."""
        return self.history.now[self.vehicles.future, self.vehicles.vehicle]


def chosen_paths(
    history: SceneHistory,
    road: Road,
    vehicles: VehicleIndex,
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
        >>> vehicles = scex.VehicleIndex(future=np.array([0, 0]), vehicle=np.array([0, 1]))
        >>> paths, row = scex.chosen_paths(history, history.scene.road, vehicles, "straight")
        >>> row.shape, len(paths.lanes) >= history.scene.vehicles
        ((2,), True)
    """
    # The length depends on the step alone, not on the batch. It doubles, so that all tables of a future
    # together need memory in proportion to its steps.
    further = max(0, ceil((history.step * STEP_S - 3.0) / LONGER_S))
    horizon = FIRST_HORIZON_S + LONGER_S * (2 ** further.bit_length() - 1)
    paths = seed_paths(history.scene, road, horizon, redraw)
    return paths, paths.choose(path, vehicles.vehicle, history.route_draw[vehicles.future, vehicles.vehicle])


def seed_paths(
    scene: SeedScene, road: Road, horizon_s: float = FIRST_HORIZON_S, redraw: Redraw | None = None
) -> SeedPaths:
    """Tabulate the candidate paths of a seed scene, on which the fastest vehicle stays for the horizon.

    ``redraw`` makes other lines (P, N, 2) of the paths, e.g. those that people drive.
    """
    return _smoothed(scene, road, horizon_s) if redraw is None else _redrawn(scene, road, horizon_s, redraw)


@owner_cache
def _redrawn(scene: SeedScene, road: Road, horizon_s: float, redraw: Redraw) -> SeedPaths:
    paths = _smoothed(scene, road, horizon_s)
    x, y, heading = _table(road, paths.lanes, paths.raw, lambda: redraw(road, paths), redraw)
    return replace(paths, x=x, y=y, heading=heading)


@owner_cache
def _smoothed(scene: SeedScene, road: Road, horizon_s: float) -> SeedPaths:
    # Models drive along paths without knowing how routes are found.
    from scex_sumo.roads.routes import OFF_ROAD, candidate_paths, centreline

    now = scene.now
    ahead = max(15.0 * horizon_s, horizon_s * float(now.speed.max(initial=0.0)) + 40.0)
    choices = [routes or [OFF_ROAD] for routes in candidate_paths(road, scene)]
    routes, count = list(chain.from_iterable(choices)), np.array([len(some) for some in choices], np.int64)
    vehicle, first = np.repeat(np.arange(len(count)), count), np.cumsum(count) - count
    known = tuple(centreline(road, r.lanes, r.s, BEHIND_M, ahead) if r.lanes else None for r in routes)
    lines = [
        _straight(scene, v, ahead) if line is None else line[0]
        for v, line in zip(vehicle.tolist(), known, strict=True)
    ]
    raw = np.stack([resample(line, int((BEHIND_M + ahead) / DS_M) + 1, DS_M) for line in lines])
    width, limit = np.full(raw.shape[:2], 3.5), np.repeat(now.speed[vehicle, None], raw.shape[1], axis=1)
    factor = np.ones(scene.vehicles)
    if scene.intentions:
        factor = np.array([1.0 if one is None else one.speed_factor for one in scene.intentions])
    for k, line in enumerate(known):
        if line is not None:
            width[k], limit[k] = _of_lanes(road, *line, raw.shape[1])
            limit[k] *= factor[vehicle[k]]
    smooth, lanes = drivable(raw, np.maximum(width, 1.0) / 2, DS_M), tuple(route.lanes for route in routes)
    x, y, heading = _table(road, lanes, raw, lambda: smooth)
    return SeedPaths(
        spacing=np.full(len(raw), DS_M),
        x=x,
        y=y,
        heading=heading,
        first=first,
        count=count,
        straight=np.array([_straightest(some) for some in choices]),
        draw_edges=upper_edges(np.concatenate([_shares(some) for some in choices]), first, count),
        lanes=lanes,
        on_road=np.array([bool(some[0].lanes) for some in choices]),
        speed_limit=limit,
        slow_in_curves=road.sumo_lanes,
        centrelines=known,
        raw=raw,
        smooth=smooth,
    )


@owner_cache
def _recent_lines(road: Road) -> dict[tuple[Any, ...], FloatArray]:
    return {}


def _table(
    road: Road,
    lanes: tuple[tuple[int, ...], ...],
    raw: FloatArray,
    draw: Callable[[], FloatArray],
    redraw: Redraw | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x, y and heading (P, N) of drawn lines (P, N, 2), at equal distances.

    Lines of the same lanes and centrelines are drawn once for each ``redraw``.
    """

    def evenly() -> FloatArray:
        return np.stack([resample(line, raw.shape[1], DS_M) for line in draw()])

    even = recent(_recent_lines(road), (redraw, *lanes, raw.tobytes()), _RECENT, evenly)
    step = np.gradient(even, axis=1)
    heading = np.unwrap(np.arctan2(step[..., 1], step[..., 0]), axis=1)
    return np.ascontiguousarray(even[..., 0]), np.ascontiguousarray(even[..., 1]), heading


def upper_edges(weight: FloatArray, first: IntArray, count: IntArray) -> FloatArray:
    """Return (P,) upper edges in [0, 1] of paths' shares of a vehicle's draw, by their weights (P,)."""
    parts = (weight[begin : begin + n] for begin, n in zip(first, count, strict=True))
    return np.concatenate([np.cumsum(weights) / weights.sum() for weights in parts])


def _straight(scene: SeedScene, v: int, ahead: float) -> FloatArray:
    x, y, heading = (float(values[v]) for values in (scene.now.x, scene.now.y, scene.now.heading))
    s = np.array([-BEHIND_M, ahead])
    return np.column_stack([x + s * np.cos(heading), y + s * np.sin(heading)])


def _shares(routes: Sequence[CandidatePath]) -> FloatArray:
    """Return the share of each path of a vehicle in random draws: an intended one has all."""
    intended = np.array([float(route.intended) for route in routes])
    return intended if intended.any() else np.array([route.probability for route in routes])


def _straightest(routes: Sequence[CandidatePath]) -> int:
    """Return the index of the intended path, else of the straightest from the most probable lane."""
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
    owner_index = np.searchsorted(arc_lengths(points), DS_M * np.arange(samples), side="right") - 1
    owner_index = inverse[np.clip(owner_index, 0, len(owner) - 1)]
    lanes = [road.lanes[int(i)] for i in ids]
    width = np.array([lane.width_m for lane in lanes])
    return width[owner_index], np.array([lane.speed_limit_mps for lane in lanes])[owner_index]


def expected_way(history: SceneHistory, vehicles: VehicleIndex) -> FloatArray:
    """Return (n,) rough arc lengths, m, from the mean of first and present speed, to distinguish laps."""
    first = history.scene.now.speed[vehicles.vehicle]
    now = history.now.speed[vehicles.future, vehicles.vehicle]
    return BEHIND_M + history.step * STEP_S * (first + now) / 2


def path_positions(
    history: SceneHistory, vehicles: VehicleIndex, paths: SeedPaths, row: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return where vehicles are now on rows of paths.

    Returns:
        (n,) arc length of the centre, m; (n,) distance from the path, m, left positive; (n,) heading of the
        path there, rad, unwrapped.

    Example:
        >>> history = scex.SceneHistory.of_scene(scex.read_seed(scex.example_path("roundabout")))
        >>> vehicles = scex.VehicleIndex(future=np.array([0]), vehicle=np.array([3]))
        >>> paths, row = scex.chosen_paths(history, history.scene.road, vehicles, "straight")
        >>> s, offset, heading = scex.path_positions(history, vehicles, paths, row)
        >>> s.shape, bool(abs(offset[0]) < 2.0)
        ((1,), True)
    """
    now = history.now[vehicles.future, vehicles.vehicle]
    return paths.foot_points(row, now.x, now.y, expected_way(history, vehicles))


def nearest_paths(
    paths: SeedPaths,
    straight: IntArray,
    vehicle: IntArray,
    expected: FloatArray,
    x: FloatArray,
    y: FloatArray,
    heading: FloatArray,
) -> tuple[IntArray, Feet]:
    """Return paths (n,) that vehicles are on, the straightest in doubt, and their `Paths.foot_points`."""
    row = straight.copy()
    feet = paths.foot_points(row, x, y, expected)
    best = _misfit(feet, heading)
    doubt = np.flatnonzero((best > OTHER_PATH) & (paths.count[vehicle] > 1))
    if not len(doubt):
        return row, feet
    count = paths.count[vehicle[doubt]]
    i = np.repeat(doubt, count)
    candidate = np.repeat(paths.first[vehicle[doubt]] - (np.cumsum(count) - count), count) + np.arange(len(i))
    others = paths.foot_points(candidate, x[i], y[i], expected[i])
    misfit = _misfit(others, heading[i])
    chosen = least_of(i, misfit, candidate)
    chosen = chosen[misfit[chosen] < best[i[chosen]] - OTHER_PATH]
    row[i[chosen]] = candidate[chosen]
    for values, better in zip(feet, others, strict=True):
        values[i[chosen]] = better[chosen]
    return row, feet


def _misfit(feet: Feet, heading: FloatArray) -> FloatArray:
    _, offset, path_heading = feet
    error = wrap(heading - path_heading)
    return np.asarray((offset / OFFSET_SIGMA_M) ** 2 + (error / HEADING_SIGMA_RAD) ** 2)


def drivable(points: FloatArray, half_width: FloatArray, ds: float) -> FloatArray:
    """Smooth paths (K, N, 2) of points every ``ds`` m; none moves over 0.95 of ``half_width`` (K, N), m.

    A Gaussian filter, then rounding of corners that are too tight for a car. ``half_width``: of the lane.
    Return them with the smallest limit of `CURVATURES` that keeps the path in the lane; read-only.
    """
    return _drivable(points.tobytes(), half_width.tobytes(), points.shape, ds)


@lru_cache(maxsize=1)  # a scene and the same scene with estimated headings have the same paths
def _drivable(raw: bytes, widths: bytes, shape: tuple[int, ...], ds: float) -> FloatArray:
    points = np.frombuffer(raw).reshape(shape)
    bound = 0.95 * np.frombuffer(widths).reshape(shape[:2])
    smooth = _within(gaussian(points, BASE_SIGMA_M / ds), points, bound)
    for limit in CURVATURES:
        rows = np.flatnonzero((np.abs(curvature(smooth)) > 1.02 * limit).any(axis=1))
        if len(rows):
            from scex_sumo.behaviors.driving.corners import rounded

            smooth[rows] = rounded(smooth[rows], points[rows], bound[rows], limit, ds)
    smooth.flags.writeable = False
    return smooth


def gaussian(values: FloatArray, sigma: float) -> FloatArray:
    """Filter axis 1 of (K, N, F), `sigma` in samples; the ends go on straight."""
    reach = max(1, int(np.ceil(3 * sigma)))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    before = 2 * values[:, :1] - values[:, reach:0:-1]
    after = 2 * values[:, -1:] - values[:, -2 : -reach - 2 : -1]
    wide = np.concatenate([before, values, after], axis=1)
    n = values.shape[1]
    result: FloatArray = kernel[reach] * values
    for i in range(reach):  # symmetric taps together
        result += kernel[i] * (wide[:, i : i + n] + wide[:, 2 * reach - i : 2 * reach - i + n])
    return result


def _within(moved: FloatArray, points: FloatArray, bound: FloatArray) -> FloatArray:
    shift = moved - points
    size = np.hypot(shift[..., 0], shift[..., 1]) / bound
    # x / (1 + x^8)^(1/8) is x for small x and 1 for large x.
    return np.asarray(points + shift / (1 + np.minimum(size, 1e6)[..., None] ** 8) ** 0.125)


def resample(points: FloatArray, count: int, ds: float) -> FloatArray:
    """Return (count, 2) points of a polyline every `ds` m, straight on past its end."""
    s: FloatArray = ds * np.arange(count, dtype=np.float64)
    past = np.maximum(s - length_of(points), 0.0)
    tail = points[-1] - points[-2]
    tail = tail / max(float(np.hypot(*tail)), 1e-9)
    return np.asarray(along(points, s) + past[:, None] * tail)
