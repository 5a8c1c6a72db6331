"""Fits what drivers add to the acceleration that is asked of them, and at which headways they follow."""

from __future__ import annotations

import numpy as np
from calibrate import AHEAD
from likely_samples import HUMAN, STEPS, Samples
from scipy.optimize import minimize

from scex_sumo.base.arrays import FloatArray
from scex_sumo.behaviors.driving.motion import CURVE_TIME_S
from scex_sumo.behaviors.driving.paths import DS_M
from scex_sumo.humans.terms import (
    DEGREES,
    Drivers,
    Situation,
    demanded,
    node_weights,
    relieved,
    spread_factor,
)
from scex_sumo.scene import STEP_S

NODES = len(HUMAN.variation_times_s)
RIDGE = 20.0  # vehicles' worth of evidence for no dependence on what is shown
FOLLOWING = {"speed": 3.0, "opening": 1.0, "headway": 3.0}
SMOOTH = 0.3  # m of way that a difference of 1 m/s² between two times must explain


def drive(samples: Samples, headway: FloatArray, own: FloatArray) -> FloatArray:
    """(n, 30) way of `LikelyDriver` along the path taken, without steering, behind the leader as it drove."""
    i, v, x = np.arange(len(samples.speed)), samples.speed, np.zeros_like(samples.speed)
    ways = np.empty((len(v), STEPS))
    drivers = Drivers(
        speed=v,
        acceleration=samples.acceleration,
        headway=headway,
        rest=np.clip(samples.gap[:, 0], 0.0, HUMAN.rest_m),
    )
    least, most = -HUMAN.max_braking_mps2, HUMAN.max_acceleration_mps2
    for step in range(STEPS):
        at = np.clip(x / DS_M, 0, AHEAD - 1).astype(np.int64)
        soon = np.clip((x + v * CURVE_TIME_S) / DS_M, 0, AHEAD - 1).astype(np.int64)
        now = Situation(
            driver=drivers,
            speed=v,
            limit=samples.limit[i, at],
            headway=headway,
            curve_speed=samples.curves[i, soon],
            gap=samples.gap[:, step] - x,
            leader_speed=samples.leader_speed[:, step],
            time_s=step * STEP_S,
        )
        a = demanded(now, HUMAN)
        if step == 0:
            beside = samples.acceleration - samples.trust * np.clip(a, least, most)
        a = (
            a
            + beside * np.exp(-now.time_s / HUMAN.habit_s)
            + samples.sudden * np.exp(-now.time_s / HUMAN.sudden_s)
        )
        a = np.clip(a + relieved(own @ node_weights(now.time_s, HUMAN), a, HUMAN), least, most)
        following = v + a * STEP_S
        x = x + np.where(following >= 0, (v + following) * (STEP_S / 2), v**2 / np.maximum(-2 * a, 1e-9))
        v = np.maximum(following, 0.0)
        ways[:, step] = x
    return ways


def own_accelerations(samples: Samples, headway: FloatArray) -> FloatArray:
    """(n, 2) accelerations of its own with which each vehicle goes the way that it went, m/s²."""
    shares = np.array([node_weights(step * STEP_S, HUMAN) for step in range(STEPS)]).T
    v = np.concatenate([np.zeros((NODES, 1)), np.cumsum(shares * STEP_S, axis=1)], axis=1)
    one = np.cumsum((v[:, :-1] + v[:, 1:]) * STEP_S / 2, axis=1)
    # Where the times are told apart by noise alone they shall be alike.
    smooth = SMOOTH * np.diff(np.eye(NODES), axis=0)
    response = np.linalg.inv(one @ one.T + smooth.T @ smooth)
    own = np.zeros((len(samples.speed), NODES))
    for _ in range(6):
        missing = samples.way - drive(samples, headway, own)
        own = own + (missing @ one.T - own @ (smooth.T @ smooth)) @ response
        own = np.clip(own, -HUMAN.max_variation_mps2, HUMAN.max_variation_mps2)
    return own


def headway_of(samples: Samples) -> tuple[float, float]:
    """Mean and standard deviation of log T over vehicles that follow steadily."""
    opening = np.abs(samples.leader_speed[:, 0] - samples.speed)
    shown = samples.headway / HUMAN.headway_kept
    steady = (samples.speed > FOLLOWING["speed"]) & (opening < FOLLOWING["opening"])
    steady &= shown < FOLLOWING["headway"]
    log = np.log(np.maximum(shown[steady], 0.1))
    print(f"headway: {steady.sum()} steady followers, median {np.exp(np.median(log)):.2f} s")
    return float(np.median(log)), float(1.4826 * np.median(np.abs(log - np.median(log))))


def accelerations_of(
    samples: Samples, headway: FloatArray, importance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means (2, 2, F) and roots (2, 2, 2) of what drivers add, by class of speed, and (4,) what spreads it.

    Expectation and maximisation of a Student distribution: means, scale matrices and spreads in turn.
    """
    own = own_accelerations(samples, headway)
    left = samples.way - drive(samples, headway, own)
    print(f"own accelerations leave {np.abs(left[:, -1]).mean():.2f} m of the way after 3 s")
    fast = samples.speed >= HUMAN.fast_mps
    grows, weight = np.array([*[1.0] * NODES, 0.0, 0.0]), np.ones(len(own))
    for _ in range(12):
        spread = spread_factor(samples.spread_features, grows[:NODES], grows[NODES:])
        means, roots, rested, inverse = [], [], np.zeros_like(own), np.zeros((len(own), NODES, NODES))
        for mine in (np.flatnonzero(~fast), np.flatnonzero(fast)):
            x, y = samples.mean_features[mine], own[mine]
            trust = (importance * weight)[mine, None] / spread[mine] ** 2
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
    for name, b, root in zip(("slow", "fast"), means, roots, strict=True):
        scale = np.sqrt(np.diag(root @ root.T)).round(2)
        print(f"{name} vehicles: scale {scale}, mean\n{b.round(2)}")
    print(f"spread grows by {grows.round(2)} of scatter (at two times), acceleration, leader")
    return np.array(means), np.array(roots), grows
