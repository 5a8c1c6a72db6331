"""Fits the population of likely_driver to recordings and writes ``behaviors/weights/likely_driver.json``.

    python benchmarks/calibrate_likely.py [--data FOLDER] [--without SET] [-o FILE]

From the training part by time of TAF-BW and MONA, and from the NGSIM files that are not kept for tests
(``benchmarks/driven.py`` and docs/validity.md name them). Every vehicle is put on the path that it took; what
it did beyond what `LikelyDriver` asks of it (its leader as it really drove) is written as an acceleration of
its own in each of three seconds, by least squares over the 30 steps. By class of speed these are regressed on
what the seed scene shows (ridge), and what is left gives the scale of a Student distribution of four degrees:
its quartiles' width by direction, so that a few mistracked vehicles do not set it. Headways, starts from
standing, offsets from the path and the choice of path are counted from the same vehicles.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from calibrate import AHEAD, OFF_PATH_M, path_taken, present
from recorded_scenes import EVERY_S, recorded_parts, smoothed
from scipy.optimize import minimize

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.driving.motion import rear_axle
from scex_sumo.behaviors.driving.paths import DS_M, SeedPaths, seed_paths
from scex_sumo.behaviors.driving.projection import expected_way, foot_points
from scex_sumo.behaviors.models.idm import (
    CALIBRATED,
    CURVE_TIME_S,
    IdmParameters,
    desired_speed,
)
from scex_sumo.behaviors.models.likely_driver import (
    BRAKING_MPS2,
    HARDEST_MPS2,
    HEADWAY_S,
    KEPT_SHARE,
    RELIEF_MPS2,
    STRONGEST_MPS2,
)
from scex_sumo.behaviors.models.likely_lanes import USUAL_M, change_features, lanes_beside, lanes_taken
from scex_sumo.behaviors.models.likely_seen import (
    STANDING_MPS,
    asked_acceleration,
    leaders_of,
    path_features,
    queue_place,
    seen_of,
    shown_by,
    side_shown,
)
from scex_sumo.behaviors.models.population import (
    ASIDE_S,
    DEGREES,
    MOST_ASIDE_M,
    MOST_OWN_MPS2,
    NODES_S,
    SHIPPED,
    Population,
    node_shares,
    population,
    spread_of,
    students,
    way_across,
)
from scex_sumo.scene import STEP_S, SeedScene, Who

STEPS = 30
NODES = len(NODES_S)
SPEED_EDGES = (STANDING_MPS, 3.0, 7.0, 12.0, 20.0)
HABIT_S = 2.0
BRAKING = (1.2, 0.4)  # mean and standard deviation of log deceleration towards a leader, m/s²

OFF_ROAD_M = 5.0  # who is further from all its paths took none of them, nor a lane beside
FAR_ASIDE_M = 0.3  # who is this far from where one expects it counts half
RIDGE = 20.0  # vehicles' worth of evidence for no dependence on what is shown
FOLLOWING = {"speed": 3.0, "opening": 1.0, "headway": 3.0}
DRAWS, TURNS = 40, 16  # of the settling
LEAST_CLASS = 60  # vehicles of a class that sets a scale of its own
STARTED_M = 0.7  # a standing vehicle that came this far has started; less is the boxes' jitter
NOISY_MPS2 = 0.1  # a set whose accelerations scatter by more is noisy
QUARTILE = 0.741  # of the Student distribution of four degrees
SMOOTH = 0.3  # m of way that a difference of 1 m/s² between two seconds must explain


@dataclass(frozen=True, kw_only=True, eq=False)
class Manner:
    """How n drivers come up to their leaders.

    Attributes:
        headway: (n,) s.
        braking: (n,) m/s².
    """

    headway: FloatArray
    braking: FloatArray

    @classmethod
    def of(cls, shown: FloatArray, known: Population, draw: FloatArray) -> Manner:
        """As `LikelyDriver` draws them, by the headways shown (n,) and normal numbers (n, 2)."""
        headway = np.exp(known.headway[0] + known.headway[1] * draw[:, 0])
        most = np.maximum(KEPT_SHARE * shown, HEADWAY_S[0])
        braking = np.exp(known.braking[0] + known.braking[1] * draw[:, 1])
        return cls(
            headway=np.clip(np.minimum(headway, most), *HEADWAY_S), braking=np.clip(braking, *BRAKING_MPS2)
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """n vehicles on the paths that they took.

    Attributes:
        speed: (n,) in the seed scene, m/s.
        acceleration: (n,) there, m/s².
        calm: (n,) see `LastSecond`.
        gap: (n, 31) to the leader if the vehicle stood where it is, now and after each step, m.
        leader_speed: (n, 31) m/s.
        headway: (n,) shown, s, as in `Seen`.
        across: (n, 3) likewise.
        features: (n, 7) shown, as in `Seen`.
        unsure: (n, 3) likewise.
        limit: (n, AHEAD) m/s.
        curves: (n, AHEAD) speed that the curves ahead allow, m/s.
        way: (n, 30) that the vehicle really made, m.
        side_shown: (n, 3) see there.
        beside: (n, 2) see `lanes_beside`.
        taken: (n, 2) see `lanes_taken`.
        off: (n,) how far from its path the vehicle was at most, m.
        side: (n,) offset of its rear axle from the path after 3 s, m.
    """

    speed: FloatArray
    acceleration: FloatArray
    calm: FloatArray
    gap: FloatArray
    leader_speed: FloatArray
    headway: FloatArray
    across: FloatArray
    features: FloatArray
    unsure: FloatArray
    limit: FloatArray
    curves: FloatArray
    way: FloatArray
    side_shown: FloatArray
    beside: FloatArray
    taken: BoolArray
    off: FloatArray
    side: FloatArray

    @classmethod
    def joined(cls, parts: Sequence[Samples]) -> Samples:
        names = [f.name for f in dataclasses.fields(cls)]
        return cls(**{name: np.concatenate([getattr(p, name) for p in parts]) for name in names})

    def part(self, chosen: IntArray | BoolArray) -> Samples:
        return Samples(**{f.name: getattr(self, f.name)[chosen] for f in dataclasses.fields(self)})


def samples_of(scene: SeedScene) -> Samples | None:
    """Vehicles with 3 s of recorded future on one of their paths."""
    assert scene.road is not None and scene.future is not None and scene.future_valid is not None
    if scene.future_valid.shape[1] < STEPS:
        return None
    vehicle = np.flatnonzero(scene.future_valid[:, :STEPS].all(axis=1) & (scene.recorded_steps >= 5))
    if not len(vehicle):
        return None
    paths = seed_paths(scene, scene.road)
    row, off = path_taken(scene, paths, vehicle)
    good = (off <= OFF_ROAD_M) & paths.on_road[vehicle]
    vehicle, row, off = vehicle[good], row[good], off[good]
    if not len(vehicle):
        return None
    history, who = present(scene), Who(child=np.zeros_like(vehicle), vehicle=vehicle)
    now, future, seen = scene.now[vehicle], scene.future[vehicle], seen_of(scene, paths)
    s, _, _ = foot_points(paths, row, now.x, now.y, expected_way(history, who))
    leaders = leaders_of(history, who, paths, row, s, seen.across[row, 0])
    away = leaders.gap + seen.slack[row]
    gap, leader_speed = _leader_ways(scene, paths, row, s, leaders.index, away, leaders.speed)
    ways = [
        foot_points(paths, row, future.x[:, k], future.y[:, k], s + now.speed * (k + 1) * STEP_S)[0] - s
        for k in range(STEPS)
    ]
    at = np.clip((s / DS_M).astype(np.int64)[:, None] + np.arange(AHEAD), 0, paths.samples - 1)
    curvature = paths.curve_curvature[row[:, None], at]
    square = CALIBRATED.curve_acceleration / np.maximum(curvature, 1e-6)
    slope = 2 * CALIBRATED.curve_deceleration * DS_M * np.arange(AHEAD)
    curves = np.sqrt(np.minimum.accumulate((square + slope)[:, ::-1], axis=1)[:, ::-1] - slope)
    x, y = rear_axle(future[:, STEPS - 1], scene.length[vehicle])
    _, side, _ = foot_points(paths, row, x, y, s + ways[-1])
    shown = shown_by(scene)
    return Samples(
        speed=shown.speed[vehicle],
        acceleration=shown.acceleration[vehicle],
        calm=shown.calm[vehicle],
        gap=gap,
        leader_speed=leader_speed,
        headway=seen.headway[row],
        across=seen.across[row],
        features=seen.features[row],
        unsure=seen.unsure[row],
        limit=paths.speed_limit[row[:, None], at],
        curves=curves,
        way=np.stack(ways, axis=1),
        side_shown=side_shown(scene)[vehicle],
        beside=lanes_beside(scene, scene.road, paths)[row],
        taken=lanes_taken(scene)[vehicle],
        off=off,
        side=side,
    )


def joined(scenes: Iterable[SeedScene]) -> Samples:
    """The vehicles of seed scenes together."""
    return Samples.joined([found for found in map(samples_of, scenes) if found is not None])


def kept(scenes: Iterable[SeedScene]) -> Samples:
    """Likewise those who stayed near their path."""
    samples = joined(scenes)
    return samples.part(samples.off <= OFF_PATH_M)


def weighted(parts: Sequence[Samples]) -> tuple[Samples, FloatArray]:
    """Samples together, and the weight of each: a part counts as the square root of its number."""
    count = np.array([len(part.speed) for part in parts])
    return Samples.joined(parts), np.repeat(1 / np.sqrt(np.maximum(count, 1)), count)


def _leader_ways(
    scene: SeedScene,
    paths: SeedPaths,
    row: IntArray,
    s: FloatArray,
    index: IntArray,
    gap: FloatArray,
    speed: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """(n, 31) gap to where the leader really was after each step, and its speed; constant if unrecorded."""
    assert scene.future is not None and scene.future_valid is not None
    time = STEP_S * np.arange(STEPS + 1)
    gaps, speeds = gap[:, None] + speed[:, None] * time, np.repeat(speed[:, None], STEPS + 1, axis=1)
    known = np.flatnonzero((index >= 0) & (index < scene.vehicles))
    known = known[scene.future_valid[index[known], :STEPS].all(axis=1)]
    if len(known):
        leader = scene.future[index[known]]
        first = scene.now[index[known]]
        start = foot_points(paths, row[known], first.x, first.y, s[known] + np.minimum(gap[known], 100.0))[0]
        for k in range(STEPS):
            guess = start + speed[known] * time[k + 1]
            there = foot_points(paths, row[known], leader.x[:, k], leader.y[:, k], guess)[0]
            gaps[known, k + 1] = gap[known] + there - start
        speeds[known, 1:] = leader.speed[:, :STEPS]
    return gaps, speeds


def drive(samples: Samples, manner: Manner, own: FloatArray, habit_s: float = HABIT_S) -> FloatArray:
    """(n, 30) way of `LikelyDriver` along the path taken, without steering, behind the leader as it drove."""
    profile = IdmParameters.of(CALIBRATED, time_headway=manner.headway, comfort_deceleration=manner.braking)
    i, v, x = np.arange(len(samples.speed)), samples.speed, np.zeros_like(samples.speed)
    ways = np.empty((len(v), STEPS))
    for step in range(STEPS):
        at = np.clip(x / DS_M, 0, AHEAD - 1).astype(np.int64)
        habit = (samples.speed, samples.acceleration, step * STEP_S)
        desired = desired_speed(CALIBRATED, samples.limit[i, at], v, *habit)
        soon = np.clip((x + v * CURVE_TIME_S) / DS_M, 0, AHEAD - 1).astype(np.int64)
        gap, leader_speed = samples.gap[:, step] - x, samples.leader_speed[:, step]
        a = asked_acceleration(profile, v, desired, gap, leader_speed, samples.curves[i, soon])
        if step == 0:
            beside = samples.acceleration - samples.calm * np.clip(a, HARDEST_MPS2, STRONGEST_MPS2)
            beside = np.where(v < STANDING_MPS, 0.0, beside)
        more = own @ node_shares(step * STEP_S)
        more = np.where(more > 0, more * np.clip(1 + a / RELIEF_MPS2, 0.0, 1.0), more)
        a = np.clip(a + beside * np.exp(-step * STEP_S / habit_s) + more, HARDEST_MPS2, STRONGEST_MPS2)
        following = v + a * STEP_S
        x = x + np.where(following >= 0, (v + following) * (STEP_S / 2), v**2 / np.maximum(-2 * a, 1e-9))
        v = np.maximum(following, 0.0)
        ways[:, step] = x
    return ways


def own_accelerations(samples: Samples, manner: Manner) -> FloatArray:
    """(n, 3) accelerations of its own with which each vehicle goes the way that it went, m/s²."""
    shares = np.array([node_shares(step * STEP_S) for step in range(STEPS)]).T
    v = np.concatenate([np.zeros((NODES, 1)), np.cumsum(shares * STEP_S, axis=1)], axis=1)
    one = np.cumsum((v[:, :-1] + v[:, 1:]) * STEP_S / 2, axis=1)
    # Where the three seconds are told apart by noise alone they shall be alike.
    smooth = SMOOTH * np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
    response = np.linalg.inv(one @ one.T + smooth.T @ smooth)
    own = np.zeros((len(samples.speed), NODES))
    for _ in range(6):
        missing = samples.way - drive(samples, manner, own)
        own = np.clip(
            own + (missing @ one.T - own @ (smooth.T @ smooth)) @ response, -MOST_OWN_MPS2, MOST_OWN_MPS2
        )
    return own


def headway_of(samples: Samples) -> tuple[float, float]:
    """Mean and standard deviation of log T over vehicles that follow steadily."""
    opening = np.abs(samples.leader_speed[:, 0] - samples.speed)
    steady = (samples.speed > FOLLOWING["speed"]) & (opening < FOLLOWING["opening"])
    steady &= samples.headway < FOLLOWING["headway"]
    log = np.log(np.maximum(samples.headway[steady], 0.1))
    print(f"headway: {steady.sum()} steady followers, median {np.exp(np.median(log)):.2f} s")
    return float(np.median(log)), float(1.4826 * np.median(np.abs(log - np.median(log))))


def accelerations_of(
    samples: Samples, manner: Manner, importance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means (K, 3, 7) and roots (K, 3, 3) of what drivers add, by class of speed, and (3,) what spreads it.

    Expectation and maximisation of a Student distribution: means, scale matrices and spreads in turn.
    """
    own = own_accelerations(samples, manner)
    left = samples.way - drive(samples, manner, own)
    print(f"own accelerations leave {np.abs(left[:, -1]).mean():.2f} m of the way after 3 s")
    k = np.searchsorted(SPEED_EDGES, samples.speed, side="right")
    classes = range(1, len(SPEED_EDGES) + 1)
    members: list[IntArray] = []
    for c in classes:
        mine = np.flatnonzero(k == c)
        members.append(mine if len(mine) >= LEAST_CLASS else members[-1])  # as the class below
    grows, weight = np.array([*[1.0] * NODES, 0.0, 0.0]), np.ones(len(own))
    for _ in range(12):
        spread = spread_of(samples.unsure, grows[:NODES], grows[NODES:])
        means, roots, rested, inverse = [], [], np.zeros_like(own), np.zeros((len(own), NODES, NODES))
        for mine in members:
            x, y, trust = (
                samples.features[mine],
                own[mine],
                (importance * weight)[mine, None] / spread[mine] ** 2,
            )
            penalty = RIDGE * np.diag([0.0, *np.ones(x.shape[1] - 1)])
            each_node = [
                np.linalg.solve((x * w).T @ x + penalty, (x * w).T @ y[:, node])
                for node, w in enumerate((trust / trust.mean(axis=0)).T[:, :, None])
            ]
            b = np.stack(each_node, axis=1)
            rest = (y - x @ b) / spread[mine]
            each = importance[mine] / importance[mine].mean()
            scale = (rest * (each * weight[mine])[:, None]).T @ rest / len(mine) + 1e-4 * np.eye(NODES)
            means.append(b.T)
            roots.append(np.linalg.cholesky(scale))
            rested[mine], inverse[mine] = rest, np.linalg.inv(scale)

        def square_of(rest: FloatArray, inverse: FloatArray = inverse) -> FloatArray:
            return np.asarray(np.einsum("ni,nij,nj->n", rest, inverse, rest))

        def cost(grows: FloatArray, rest: FloatArray = rested * spread) -> float:
            spread = spread_of(samples.unsure, grows[:NODES], grows[NODES:])
            far = np.log1p(square_of(rest / spread) / DEGREES)
            return float((importance * (np.log(spread).sum(axis=1) + (DEGREES + NODES) / 2 * far)).mean())

        weight = (DEGREES + NODES) / (DEGREES + square_of(rested))
        limits = [(0.0, 20.0)] * NODES + [(-3.0, 3.0)] * 2
        grows = minimize(cost, grows, method="L-BFGS-B", bounds=limits).x
    for c, mine, b, root in zip(classes, members, means, roots, strict=True):
        scale = np.sqrt(np.diag(root @ root.T)).round(2)
        print(f"class {c}: {len(mine)} vehicles, scale {scale}, mean\n{b.round(2)}")
    print(f"spread grows by {grows.round(2)} of scatter (in three nodes), acceleration, leader")
    # Who stands adds nothing until it drives, and then as the slow ones do.
    return np.array([np.zeros_like(means[0]), *means]), np.array([roots[0], *roots]), grows


def settled(known: Population, samples: Samples, weight: FloatArray) -> Population:
    """Shift, spread and skew of each class, until the way after 3 s is where its draws say it is.

    As often above as below their median, within their quartiles one time in two, and outside 5-95 % as often
    above as below: what a driver adds acts through a leader, a limit and a standstill, which the regression
    does not see. Quartiles, for the few who do something else shall not make all others uncertain.
    """
    rng, y = np.random.default_rng(0), samples.way[:, -1]
    draws = [students(rng.random((len(y), NODES + 2))) for _ in range(DRAWS)]
    drivers = [Manner.of(samples.headway, known, rng.standard_normal((len(y), 2))) for _ in range(DRAWS)]
    mean, root, skew = known.mean.copy(), known.root.copy(), known.skew.copy()
    k = known.speed_class(samples.speed)
    for turn in range(TURNS):
        now = dataclasses.replace(known, mean=mean, root=root, skew=skew)
        own = (now.own_acceleration(samples.speed, samples.features, samples.unsure, d) for d in draws)
        ways = np.stack([drive(samples, m, a)[:, -1] for m, a in zip(drivers, own, strict=True)])
        low, left, middle, right, high = np.quantile(ways, [0.05, 0.25, 0.5, 0.75, 0.95], axis=0)
        gain = 1.0 / (1 + turn / 4)
        for c in np.unique(k):
            w = weight[k == c] / weight[k == c].sum()
            above, below = float(w @ (y > high)[k == c]), float(w @ (y < low)[k == c])
            lift = float(w @ (y > middle)[k == c]) - 0.5
            mean[c, :, 0] += gain * lift * np.sqrt(np.diag(root[c] @ root[c].T))
            inner = float(w @ ((y > left) & (y < right))[k == c])
            root[c] *= np.exp(np.clip(gain * 1.5 * (0.5 - inner), -0.3, 0.3))
            skew[c] = np.clip(skew[c] + gain * (above - below), -0.7, 0.7)
            if turn == TURNS - 1:
                print(
                    f"class {c}: within quartiles {inner:.2f}, above {above:.2f}, below {below:.2f}, "
                    f"lift {lift:+.2f}, skew {skew[c]:+.2f}"
                )
    root[0] = root[1]
    return dataclasses.replace(known, mean=mean, root=root, skew=skew)


def offsets_of(samples: Samples, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``keeps_side`` (3,) and scale, noise and unsure (4,) of `Population`, of who stays near its path.

    Least squares, with less weight for who is far from it; then the Student distribution of greatest
    likelihood of what is left.
    """
    near = (np.abs(samples.side) < MOST_ASIDE_M) & ~changed(samples).any(axis=1)
    across, share = samples.across[near], weight[near] / weight[near].mean()
    none, one = np.zeros(len(across)), np.ones(len(across))
    end = np.array([ASIDE_S])
    by_then = way_across(0 * across, one, end)[:, 0]
    after = (samples.side[near] - way_across(across, none, end)[:, 0]) / by_then
    keeps, trust = np.zeros(3), np.ones(len(after))
    for _ in range(10):
        w = (share * trust)[:, None]
        keeps = np.linalg.solve((across * w).T @ across, (across * w).T @ after)
        trust = 1 / (1 + ((after - across @ keeps) / FAR_ASIDE_M) ** 2)
    rest = after - across @ keeps

    def cost(grows: FloatArray) -> float:
        scale = np.exp(grows[0]) * spread_of(samples.side_shown[near], grows[1:2], grows[2:])[:, 0]
        far = np.log1p((rest / scale) ** 2 / DEGREES)
        return float((share * (np.log(scale) + (DEGREES + 1) / 2 * far)).mean())

    limits = [(-4.0, 1.0), (0.0, 20.0), (-3.0, 3.0), (-3.0, 3.0)]
    grows = minimize(cost, np.array([-1.2, 1.0, 0.0, 0.0]), method="L-BFGS-B", bounds=limits).x
    grows[0] = np.exp(grows[0])
    print(f"offsets: keeps {keeps.round(2)}, rest {grows[0]:.3f} m, grows {grows[1:].round(2)}")
    return keeps, grows


def changed(samples: Samples) -> BoolArray:
    """(n, 2) who has moved to the lane on its left, and on its right, or is on its way."""
    sign = np.array([1.0, -1.0])
    side, offset = samples.side[:, None] * sign, samples.across[:, :1] * sign
    far = np.where(np.isinf(samples.beside), USUAL_M, samples.beside)
    moved = side - offset
    return ((moved > 0.4) & (side > far - 1.3)) | ((moved > 1.3) & (side > 1.0))


def changes_of(samples: Samples, weight: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """``change`` (7,), ``change_to`` (3,) and ``change_m`` of `Population`."""
    x = change_features(samples.across, samples.beside, samples.taken, samples.unsure[:, 0])
    y = changed(samples).astype(np.float64)
    share = weight / weight.mean()

    def cost(values: FloatArray) -> float:
        score = x @ values
        total = np.log1p(np.exp(np.minimum(score, 30.0)).sum(axis=1)) - (y * score).sum(axis=1)
        return float((share * total).mean() + 1e-4 * values @ values)

    change = minimize(cost, np.zeros(x.shape[2]), method="L-BFGS-B").x
    who, left = np.nonzero(y)
    sign = np.where(left == 0, 1.0, -1.0)
    far = np.where(np.isinf(samples.beside), USUAL_M, samples.beside)[who, left]
    seen = np.column_stack([sign * far, samples.across[who, :2]])
    to = np.linalg.lstsq(seen, samples.side[who], rcond=None)[0]
    rest = samples.side[who] - seen @ to
    scale = float(np.subtract(*np.quantile(rest, [0.75, 0.25])) / 2 / QUARTILE)
    print(f"changes: {len(who)} of {len(x)}, weights {change.round(2)}, to {to.round(2)}, rest {scale:.2f} m")
    return change, to, scale


def starts_of(samples: Samples) -> list[float]:
    """Rate of starting, 1/s, behind a standing leader, a moving one, and alone."""
    stands = samples.speed < STANDING_MPS
    place = queue_place(samples.gap[:, 0], samples.leader_speed[:, 0])
    rates = []
    for p in range(3):
        mine = stands & (place == p)
        started = samples.way[mine] > STARTED_M
        went = started.any(axis=1)
        waited = np.where(went, STEP_S * (1 + np.argmax(started, axis=1)) - 1.0, 3.0)
        rates.append(float((went.sum() + 0.1) / (np.maximum(waited, 0.3).sum() + 1.0)))
        print(f"standing, place {p}: {mine.sum()} vehicles, {went.sum()} start, rate {rates[-1]:.3f} 1/s")
    return rates


def choices_of(scenes: Iterable[SeedScene]) -> Iterator[tuple[FloatArray, FloatArray, int]]:
    """Log shares (k,), features (k, 4) and which path was taken, where vehicles show which."""
    for scene in scenes:
        assert scene.road is not None and scene.future is not None and scene.future_valid is not None
        if scene.future_valid.shape[1] < STEPS:
            continue
        vehicle = np.flatnonzero(scene.future_valid[:, :STEPS].all(axis=1))
        paths = seed_paths(scene, scene.road)
        vehicle = vehicle[paths.count[vehicle] > 1]
        if not len(vehicle):
            continue
        features = path_features(scene, paths)
        later = scene.future[vehicle, STEPS - 1]
        for j, v in enumerate(vehicle):
            rows = paths.first[v] + np.arange(paths.count[v])
            whole = np.full(len(rows), 1.0)
            way = 20.0 + 3.0 * scene.now.speed[v]
            off = np.abs(foot_points(paths, rows, later.x[j] * whole, later.y[j] * whole, way * whole)[1])
            if off.min() > OFF_PATH_M or off.max() < off.min() + 1.5:
                continue
            share = np.diff(paths.draw_edges[rows], prepend=0.0)
            near = off < off.min() + 0.75  # paths that part only later
            yield np.log(np.maximum(share, 1e-9)), features[rows], near


def paths_of(scenes: Sequence[SeedScene]) -> FloatArray:
    """(4,) weights with the greatest likelihood of the paths taken."""
    found = list(choices_of(scenes))
    print(f"paths: {len(found)} choices")

    def cost(weight: FloatArray) -> float:
        total = 0.5 * 0.01 * float(weight @ weight)
        for share, features, taken in found:
            score = share - features @ weight
            score = np.exp(score - score.max())
            total -= float(np.log(score[taken].sum() / score.sum() + 1e-9))
        return total

    result = minimize(cost, np.array([0.2, 0.5, 2.0, 0.2]), method="L-BFGS-B", bounds=[(0.0, 20.0)] * 4)
    n = max(len(found), 1)
    print(
        f"  log loss {cost(np.zeros(4)) / n:.3f} by shares, {result.fun / n:.3f} fitted: {result.x.round(2)}"
    )
    return np.asarray(result.x)


def fit(sets: Mapping[str, Sequence[SeedScene]]) -> dict[str, object]:
    """The population, as in `scex_sumo.behaviors.models.population.Population`.

    A data set counts as the square root of its vehicles: the largest shall not decide alone. Accelerations of
    noisy sets are fitted to their smoothed recordings, too: so does noise show, which the same people made
    neither more nor less.
    """
    scenes = [scene for part in sets.values() for scene in part]
    every, even = weighted([joined(part) for part in sets.values()])
    drives = every.speed >= STANDING_MPS
    change, change_to, change_m = changes_of(every.part(drives), even[drives])
    found = [kept(part) for part in sets.values()]
    samples, weight = weighted(found)
    print(f"{len(scenes)} moments, {len(samples.speed)} vehicles")
    log_headway = headway_of(samples)
    moving = samples.speed >= STANDING_MPS
    keeps_side, side = offsets_of(samples.part(moving), weight[moving])
    noisy = [np.median(part.unsure[part.speed >= STANDING_MPS, 0]) > NOISY_MPS2 for part in found]
    calm = [
        kept(map(smoothed, part)) if noise else same
        for part, noise, same in zip(sets.values(), noisy, found, strict=True)
    ]
    both, share = weighted([*found, *calm])
    moving = both.speed >= STANDING_MPS
    driving, share = both.part(moving), share[moving]
    begun = dataclasses.replace(population(), headway=log_headway, braking=BRAKING, habit_s=HABIT_S)
    manner = Manner.of(driving.headway, begun, np.zeros((len(driving.speed), 2)))
    mean, root, grows = accelerations_of(driving, manner, share / share.mean())
    regressed = dataclasses.replace(
        begun,
        speed_edges=np.array(SPEED_EDGES),
        mean=mean,
        root=root,
        noise=grows[:NODES],
        unsure=grows[NODES:],
        skew=np.zeros(len(mean)),
    )
    known = settled(regressed, driving, share)
    return {
        "speed_edges": SPEED_EDGES,
        "mean": known.mean.round(4).tolist(),
        "root": known.root.round(4).tolist(),
        "noise": grows[:NODES].round(4).tolist(),
        "unsure": grows[NODES:].round(4).tolist(),
        "skew": known.skew.round(4).tolist(),
        "headway": [round(v, 4) for v in log_headway],
        "start_rate": [round(v, 4) for v in starts_of(samples)],
        "habit_s": HABIT_S,
        "braking": [round(v, 4) for v in BRAKING],
        "keeps_side": keeps_side.round(4).tolist(),
        "side_m": round(side[0], 4),
        "side_noise": side[1:2].round(4).tolist(),
        "side_unsure": side[2:].round(4).tolist(),
        "change": change.round(4).tolist(),
        "change_to": change_to.round(4).tolist(),
        "change_m": round(change_m, 4),
        "path": paths_of(scenes).round(4).tolist(),
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("SCEX_DATA", "../shared/data")))
    parser.add_argument("-o", "--out", type=Path, default=SHIPPED)
    parser.add_argument("--without", choices=list(EVERY_S), help="data set to leave out")
    arguments = parser.parse_args()
    names = [name for name in EVERY_S if name != arguments.without]
    sets = {name: list(recorded_parts(arguments.data, name, "train")) for name in names}
    arguments.out.write_text(json.dumps(fit(sets), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
