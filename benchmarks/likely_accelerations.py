"""Fits what drivers add to the acceleration that is asked of them, and at which headways they follow."""

from __future__ import annotations

import dataclasses

import numpy as np
from calibrate import AHEAD
from likely_samples import HUMAN, STEPS, Manner, Samples
from scipy.optimize import minimize

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.behaviors.driving.motion import CURVE_TIME_S
from scex_sumo.behaviors.driving.paths import DS_M
from scex_sumo.humans.parameters import HumanParameters
from scex_sumo.humans.population import (
    DEGREES,
    drawn_variation,
    node_weights,
    spread_factor,
    students,
)
from scex_sumo.humans.terms import Drivers, Expectation, Situation, demanded, relieved
from scex_sumo.scene import STEP_S

NODES = len(HUMAN.variation_times_s)
SPEED_EDGES = (HUMAN.standing_mps, 3.0, 7.0, 12.0, 20.0)
HABIT_S = 2.0  # for how long what is done beside what is asked lasts: set by CRPS, as the next line is
BRAKING = (1.2, 0.4)  # mean and standard deviation of log deceleration towards a leader, m/s²
RIDGE = 20.0  # vehicles' worth of evidence for no dependence on what is shown
FOLLOWING = {"speed": 3.0, "opening": 1.0, "headway": 3.0}
DRAWS = 24  # of the settling
TURNS = 12
MIN_CLASS = 60  # vehicles of a class that sets a scale of its own
SMOOTH = 0.3  # m of way that a difference of 1 m/s² between two seconds must explain


def drive(samples: Samples, manner: Manner, own: FloatArray) -> FloatArray:
    """(n, 30) way of `LikelyDriver` along the path taken, without steering, behind the leader as it drove."""
    i, v, x = np.arange(len(samples.speed)), samples.speed, np.zeros_like(samples.speed)
    ways = np.empty((len(v), STEPS))
    drivers = Drivers(
        speed=v, acceleration=samples.acceleration, headway=manner.headway, braking=manner.braking
    )
    for step in range(STEPS):
        at = np.clip(x / DS_M, 0, AHEAD - 1).astype(np.int64)
        soon = np.clip((x + v * CURVE_TIME_S) / DS_M, 0, AHEAD - 1).astype(np.int64)
        now = Situation(
            driver=drivers,
            expects=Expectation(headway=manner.headway),
            speed=v,
            limit=samples.limit[i, at],
            curve_speed=samples.curves[i, soon],
            gap=samples.gap[:, step] - x,
            leader_speed=samples.leader_speed[:, step],
            step=step,
        )
        a = demanded(now, HUMAN)
        least, most = -HUMAN.max_braking_mps2, HUMAN.max_acceleration_mps2
        if step == 0:
            beside = samples.acceleration - samples.trust * np.clip(a, least, most)
            beside = np.where(v < HUMAN.standing_mps, 0.0, beside)
        more = relieved(own @ node_weights(now.time_s, HUMAN), a, HUMAN)
        a = np.clip(a + beside * np.exp(-now.time_s / HABIT_S) + more, least, most)
        following = v + a * STEP_S
        x = x + np.where(following >= 0, (v + following) * (STEP_S / 2), v**2 / np.maximum(-2 * a, 1e-9))
        v = np.maximum(following, 0.0)
        ways[:, step] = x
    return ways


def own_accelerations(samples: Samples, manner: Manner) -> FloatArray:
    """(n, 3) accelerations of its own with which each vehicle goes the way that it went, m/s²."""
    shares = np.array([node_weights(step * STEP_S, HUMAN) for step in range(STEPS)]).T
    v = np.concatenate([np.zeros((NODES, 1)), np.cumsum(shares * STEP_S, axis=1)], axis=1)
    one = np.cumsum((v[:, :-1] + v[:, 1:]) * STEP_S / 2, axis=1)
    # Where the three seconds are told apart by noise alone they shall be alike.
    smooth = SMOOTH * np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
    response = np.linalg.inv(one @ one.T + smooth.T @ smooth)
    own = np.zeros((len(samples.speed), NODES))
    for _ in range(6):
        missing = samples.way - drive(samples, manner, own)
        own = own + (missing @ one.T - own @ (smooth.T @ smooth)) @ response
        own = np.clip(own, -HUMAN.max_variation_mps2, HUMAN.max_variation_mps2)
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
    """Means (K, 3, 9) and roots (K, 3, 3) of what drivers add, by class of speed, and (3,) what spreads it.

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
        members.append(mine if len(mine) >= MIN_CLASS else members[-1])  # as the class below
    grows, weight = np.array([*[1.0] * NODES, 0.0, 0.0]), np.ones(len(own))
    for _ in range(12):
        spread = spread_factor(samples.spread_features, grows[:NODES], grows[NODES:])
        means, roots, rested, inverse = [], [], np.zeros_like(own), np.zeros((len(own), NODES, NODES))
        for mine in members:
            x, y, trust = (
                samples.mean_features[mine],
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
            spread = spread_factor(samples.spread_features, grows[:NODES], grows[NODES:])
            far = np.log1p(square_of(rest / spread) / DEGREES)
            return float((importance * (np.log(spread).sum(axis=1) + (DEGREES + NODES) / 2 * far)).mean())

        weight = (DEGREES + NODES) / (DEGREES + square_of(rested))
        limits = [(0.0, 20.0)] * NODES + [(-3.0, 3.0)] * 2
        grows = minimize(cost, grows, method="L-BFGS-B", bounds=limits).x
    for c, mine, b, root in zip(classes, members, means, roots, strict=True):
        scale = np.sqrt(np.diag(root @ root.T)).round(2)
        print(f"class {c}: {len(mine)} vehicles, scale {scale}, mean\n{b.round(2)}")
    print(f"spread grows by {grows.round(2)} of scatter (in three nodes), acceleration, leader")
    # A standing vehicle adds nothing until it drives, and then as slow vehicles do.
    return np.array([np.zeros_like(means[0]), *means]), np.array([roots[0], *roots]), grows


def settled(known: HumanParameters, samples: Samples, weight: FloatArray) -> HumanParameters:
    """Shift, spread and skew of each class, until the way after 3 s is where its draws say it is.

    As often above as below their median, between quartiles and 5-95 % nearly as often as these say, and
    outside 5-95 % as often above as below: what a driver adds acts through a leader, a limit and a
    standstill, which the regression does not see.
    """
    rng, y = np.random.default_rng(0), samples.way[:, -1]
    draws = [students(rng.random((len(y), NODES + 2))) for _ in range(DRAWS)]
    drivers = [Manner.of(samples.headway, known, rng.standard_normal((len(y), 2))) for _ in range(DRAWS)]
    mean, root, skew = (a.copy() for a in (known.variation_mean, known.variation_root, known.variation_skew))
    k = np.searchsorted(known.speed_edges, samples.speed, side="right")
    for turn in range(TURNS):
        now = dataclasses.replace(known, variation_mean=mean, variation_root=root, variation_skew=skew)
        own = (
            drawn_variation(samples.speed, samples.mean_features, samples.spread_features, d, now)
            for d in draws
        )
        ways = np.stack([drive(samples, m, a)[:, -1] for m, a in zip(drivers, own, strict=True)])
        low, left, middle, right, high = np.quantile(ways, [0.05, 0.25, 0.5, 0.75, 0.95], axis=0)
        gain = 1.0 / (1 + turn / 4)
        for c in np.unique(k):
            w = weight[k == c] / weight[k == c].sum()
            above, below = float(w @ (y > high)[k == c]), float(w @ (y < low)[k == c])
            lift = float(w @ (y > middle)[k == c]) - 0.5
            mean[c, :, 0] += gain * lift * np.sqrt(np.diag(root[c] @ root[c].T))
            inner = float(w @ ((y > left) & (y < right))[k == c])
            wider = 0.5 * (0.5 - inner) + 2.0 * (above + below - 0.1)
            root[c] *= np.exp(np.clip(gain * wider, -0.3, 0.3))
            skew[c] = np.clip(skew[c] + gain * (above - below), -0.7, 0.7)
            if turn == TURNS - 1:
                print(
                    f"class {c}: within quartiles {inner:.2f}, above {above:.2f}, below {below:.2f}, "
                    f"lift {lift:+.2f}, skew {skew[c]:+.2f}"
                )
    root[0] = root[1]
    return dataclasses.replace(known, variation_mean=mean, variation_root=root, variation_skew=skew)
