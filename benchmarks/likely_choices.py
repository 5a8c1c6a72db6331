"""Fits where drivers go: their place in the lane, lane changes, starts from standing, paths."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TypeAlias

import numpy as np
from calibrate import OFF_PATH_M
from likely_samples import HUMAN, STEPS, Samples
from scipy.optimize import minimize

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.behaviors.driving.paths import FIRST_HORIZON_S, seed_paths
from scex_sumo.humans.lines.driven_line import redrawn
from scex_sumo.humans.lines.lanes import change_features
from scex_sumo.humans.observed.observations import (
    keep_features,
    offset_limits,
    path_features,
    place_features,
    start_features,
)
from scex_sumo.humans.observed.seed_state import estimated_scene
from scex_sumo.humans.terms import DEGREES, lateral_offsets
from scex_sumo.scene import STEP_S, SeedScene

FAR_ASIDE_M = 0.3  # who is this far from where one expects it counts half
MOVED_M = (0.4, 1.3)  # who came near the middle of the next lane, and who only left its own, moved by this
NEAR_LANE_M = 1.3
HALF_WAY_M = 1.0
STRAIGHT_BEND = 0.02  # 1/m
WEAK = 1e-4  # a prior for weights of 0
QUARTILE = 0.741  # of the Student distribution of four degrees
NINE_IN_TEN = 2.132  # of its draws are within plus and minus this
STARTED_M = 0.7  # a standing vehicle that came this far has started; less is the boxes' jitter


def offsets_of(samples: Samples, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``keep_weights`` (5,), and scale and growth (4,) of who stays near its path.

    Least squares, with less weight for who is far from it; then the Student distribution of greatest
    likelihood of what is left, as wide as its 5-95 % must be for nine in ten.
    """
    left, right = offset_limits(samples.room[:, 1], HUMAN).T
    near = (samples.side < left) & (samples.side > -right) & ~changed(samples).any(axis=1)
    across, share = samples.lateral[near], weight[near] / weight[near].mean()
    shown = place_features(across, samples.bends[near], samples.room[near])
    features = keep_features(samples.speed[near], samples.bends[near], samples.room[near], HUMAN)
    none, one = np.zeros(len(across)), np.ones(len(across))
    end = np.array([HUMAN.lateral_s])
    by_then = lateral_offsets(0 * across, one, end, HUMAN)[:, 0]
    after = (samples.side[near] - lateral_offsets(across, none, end, HUMAN)[:, 0]) / by_then
    keeps, trust = np.zeros(shown.shape[1]), np.ones(len(after))
    for _ in range(10):
        w = (share * trust)[:, None]
        keeps = np.linalg.solve((shown * w).T @ shown, (shown * w).T @ after)
        trust = 1 / (1 + ((after - shown @ keeps) / FAR_ASIDE_M) ** 2)
    rest = after - shown @ keeps

    def cost(grows: FloatArray) -> float:
        scale = np.exp(grows[0] + features @ grows[1:])
        far = np.log1p((rest / scale) ** 2 / DEGREES)
        return float((share * (np.log(scale) + (DEGREES + 1) / 2 * far)).mean())

    limits = [(-4.0, 1.0), *[(-3.0, 3.0)] * 3]
    grows = minimize(cost, np.array([-1.2, 0.0, 0.0, 0.0]), method="L-BFGS-B", bounds=limits).x
    scale = np.exp(grows[0] + features @ grows[1:])
    far = np.abs(rest) / scale
    order = np.argsort(far)
    ninth = np.searchsorted(np.cumsum(share[order]), 0.9 * share.sum())
    grows[0] = np.exp(grows[0]) * far[order[ninth]] / NINE_IN_TEN
    print(f"offsets: keeps {keeps.round(2)}, rest {grows[0]:.3f} m, grows {grows[1:].round(2)}")
    return keeps, grows


def changed(samples: Samples) -> BoolArray:
    """(n, 2) who has moved to the lane on its left, and on its right, or is on its way.

    In curves of wide lanes people move as far without changing lanes.
    """
    sign = np.array([1.0, -1.0])
    side, offset = samples.side[:, None] * sign, samples.lateral[:, :1] * sign
    far = np.where(np.isinf(samples.beside), HUMAN.lane_width_m, samples.beside)
    moved = side - offset
    there = (moved > MOVED_M[0]) & (side > np.maximum(far - NEAR_LANE_M, HALF_WAY_M))
    half = np.where(np.isinf(samples.beside), HUMAN.lane_width_m / 2, HALF_WAY_M)
    straight = np.abs(samples.bends).max(axis=1) < STRAIGHT_BEND
    return np.asarray(straight[:, None] & (there | (moved > MOVED_M[1]) & (side > half)))


def changes_of(samples: Samples) -> tuple[FloatArray, FloatArray, float]:
    """``change_weights`` (7,), ``change_target`` (3,) and ``change_scale_m`` of `HumanParameters`."""
    x = change_features(
        samples.lateral, samples.beside, samples.occupied, samples.spread_features[:, 0], HUMAN
    )
    y = changed(samples).astype(np.float64)

    def cost(values: FloatArray) -> float:
        score = x @ values
        total = np.log1p(np.exp(np.minimum(score, 30.0)).sum(axis=1)) - (y * score).sum(axis=1)
        return float(total.mean() + WEAK * values @ values)

    change = minimize(cost, np.zeros(x.shape[2]), method="L-BFGS-B").x
    who, right = np.nonzero(y)
    sign = np.where(right == 0, 1.0, -1.0)
    far = np.where(np.isinf(samples.beside), HUMAN.lane_width_m, samples.beside)[who, right]
    seen = np.column_stack([sign * far, samples.lateral[who, :2]])
    to = np.linalg.lstsq(seen, samples.side[who], rcond=None)[0]
    rest = samples.side[who] - seen @ to
    scale = float(np.subtract(*np.quantile(rest, [0.75, 0.25])) / 2 / QUARTILE)
    print(f"changes: {len(who)} of {len(x)}, weights {change.round(2)}, to {to.round(2)}, rest {scale:.2f} m")
    return change, to, scale


def starts_of(samples: Samples, weight: FloatArray) -> FloatArray:
    """Weights of `start_features` for the log rate of starting, 1/s: Poisson regression with exposure."""
    stands = samples.speed < HUMAN.standing_mps
    x = start_features(samples.speed, samples.gap[:, 0], samples.leader_speed[:, 0], samples.wave, HUMAN)[
        stands
    ]
    started = samples.way[stands] > STARTED_M
    went = started.any(axis=1)
    # A vehicle needs about a second for the first metre.
    waited = np.maximum(np.where(went, STEP_S * (1 + np.argmax(started, axis=1)) - 1.0, 3.0), 0.3)
    each = weight[stands] / weight[stands].mean()
    penalty = np.array([0.0, *np.ones(x.shape[1] - 1)]) / 10

    def cost(w: FloatArray) -> float:
        log = x @ w
        return float((each * (np.exp(log) * waited - went * log)).sum() + penalty @ w**2)

    w = minimize(cost, np.array([-3.0, *np.zeros(x.shape[1] - 1)]), method="BFGS").x
    print(f"standing: {len(x)} vehicles, {went.sum()} start, log rates {w.round(2)}")
    return np.asarray(w)


Choice: TypeAlias = tuple[FloatArray, FloatArray, BoolArray]  # log shares (k,), features (k, 5), taken (k,)


def choices_of(recorded: SeedScene) -> Iterator[Choice]:
    """Choices of path that the future of a scene shows, with all paths that were as near to it."""
    assert recorded.road is not None
    scene = estimated_scene(recorded, recorded.road)
    assert scene.road is not None and scene.future is not None and scene.future_valid is not None
    if scene.future_valid.shape[1] < STEPS:
        return
    vehicle = np.flatnonzero(scene.future_valid[:, :STEPS].all(axis=1))
    paths = seed_paths(scene, scene.road, FIRST_HORIZON_S, redrawn)
    vehicle = vehicle[paths.count[vehicle] > 1]
    if not len(vehicle):
        return
    features = path_features(scene, paths, HUMAN)
    later = scene.future[vehicle, STEPS - 1]
    for j, v in enumerate(vehicle):
        rows = paths.first[v] + np.arange(paths.count[v])
        whole = np.full(len(rows), 1.0)
        way = 20.0 + 3.0 * scene.now.speed[v]
        off = np.abs(paths.foot_points(rows, later.x[j] * whole, later.y[j] * whole, way * whole)[1])
        if off.min() > OFF_PATH_M or off.max() < off.min() + 1.5:
            continue
        share = np.diff(paths.draw_edges[rows], prepend=0.0)
        near = off < off.min() + 0.75  # paths that part only later
        yield np.log(np.maximum(share, 1e-9)), features[rows], near


def paths_of(sets: Iterable[Sequence[Choice]]) -> FloatArray:
    """(5,) weights with the greatest likelihood of the paths taken; a set counts as the root of its choices.

    One choice in fifty is taken for none that shows.
    """
    parts = [part for part in sets if part]
    found = [choice for part in parts for choice in part]
    count = np.array([len(part) for part in parts])
    each = np.repeat(1 / np.sqrt(count), count)
    each /= each.mean()
    print(f"paths: {len(found)} choices")

    def cost(weight: FloatArray) -> float:
        total = 0.5 * 0.01 * float(weight @ weight)
        for importance, (share, features, taken) in zip(each, found, strict=True):
            score = share - features @ weight
            score = np.exp(score - score.max())
            total -= importance * float(np.log(0.98 * score[taken].sum() / score.sum() + 0.01))
        return total

    result = minimize(cost, np.full(5, 0.5), method="L-BFGS-B", bounds=[(0.0, 20.0)] * 5)
    n = max(len(found), 1)
    print(
        f"  log loss {cost(np.zeros(5)) / n:.3f} by shares, {result.fun / n:.3f} fitted: {result.x.round(2)}"
    )
    return np.asarray(result.x)
