"""Realism: how probable the recorded motion is among the futures, feature by feature.

After the Waymo Open Sim Agents Challenge (Montali et al. 2023), histograms and weights of 2025. Without
traffic lights and for 3 s, not 8, the numbers are not comparable with that leaderboard.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.geometry.polylines import wrap
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.learned.inputs.surface import surface_of
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, States
from scex_sumo.studies.validate.scores import histogram_log_likelihood

MAX_TTC_S = 5.0
MAX_TURN_RAD = np.deg2rad(75.0)  # a vehicle that heads elsewhere is no leader
BERNOULLI_PSEUDOCOUNT = 0.001


@dataclass(frozen=True, kw_only=True)
class Feature:
    """Histogram of a feature from ``low`` to ``high``, and its weight before renormalisation.

    An event of a vehicle's whole future has 2 bins from -0.5 to 1.5.
    """

    low: float
    high: float
    bins: int
    weight: float


FEATURES = {
    "linear_speed": Feature(low=0.0, high=25.0, bins=10, weight=0.05),
    "linear_acceleration": Feature(low=-12.0, high=12.0, bins=11, weight=0.05),
    "angular_speed": Feature(low=-0.628, high=0.628, bins=11, weight=0.05),
    "angular_acceleration": Feature(low=-3.14, high=3.14, bins=11, weight=0.05),
    "distance_to_nearest_object": Feature(low=-5.0, high=40.0, bins=10, weight=0.1),
    "collision_indication": Feature(low=-0.5, high=1.5, bins=2, weight=0.25),
    "time_to_collision": Feature(low=0.0, high=MAX_TTC_S, bins=10, weight=0.1),
    "distance_to_road_edge": Feature(low=-20.0, high=40.0, bins=10, weight=0.05),
    "offroad_indication": Feature(low=-0.5, high=1.5, bins=2, weight=0.25),
}


def realism(
    futures: States, recorded: States, length: FloatArray, width: FloatArray, judged: BoolArray, road: Road
) -> dict[str, float]:
    """Return the likelihood of the recorded future by feature: exp of the mean log, in (0, 1].

    Args:
        futures: (C, T, V).
        recorded: (1, T, V).
        length: (V,) m.
        width: (V,) m.
        judged: (V,) vehicles recorded to the end; others are ignored, and without any the result is empty.
    """
    if not judged.any():
        return {}
    sizes = length[judged], width[judged]
    simulated = _features(futures[:, :, judged], *sizes, road)
    real = _features(recorded[:, :, judged], *sizes, road)
    likelihood = {}
    for name, feature in FEATURES.items():
        event = feature.bins == 2
        flat = (len(simulated[name]), -1)
        log = histogram_log_likelihood(
            simulated[name].reshape(flat),
            real[name].reshape(-1),
            low=feature.low,
            high=feature.high,
            bins=feature.bins,
            pseudocount=BERNOULLI_PSEUDOCOUNT if event else 0.1,
        )
        likelihood[name] = float(np.exp(log.mean()))
    return likelihood


def realism_score(likelihood: dict[str, float]) -> float:
    """Return the weighted mean of the likelihoods of `realism`; NaN without any."""
    if not likelihood:
        return float("nan")
    weights = {name: FEATURES[name].weight for name in likelihood}
    return sum(weights[name] * value for name, value in likelihood.items()) / sum(weights.values())


def _features(states: States, length: FloatArray, width: FloatArray, road: Road) -> dict[str, FloatArray]:
    turn = wrap(np.diff(states.heading, axis=1)) / STEP_S
    gap, ttc = _nearest(states, length, width)
    depth = _least_depth(states, length, width, road)
    return {
        "linear_speed": states.speed,
        "linear_acceleration": np.diff(states.speed, axis=1) / STEP_S,
        "angular_speed": turn,
        "angular_acceleration": np.diff(turn, axis=1) / STEP_S,
        "distance_to_nearest_object": gap,
        "collision_indication": (gap <= 0).any(axis=1).astype(np.float64),
        "time_to_collision": ttc,
        "distance_to_road_edge": -depth,
        "offroad_indication": (depth < 0).any(axis=1).astype(np.float64),
    }


def _least_depth(states: States, length: FloatArray, width: FloatArray, road: Road) -> FloatArray:
    cos, sin = np.cos(states.heading), np.sin(states.heading)
    surface, least = surface_of(road), np.full(states.shape, np.inf)
    for along in (-0.5, 0.5):
        for across in (-0.5, 0.5):
            dx, dy = along * length, across * width
            depth = surface.at(states.x + dx * cos - dy * sin, states.y + dx * sin + dy * cos)
            least = np.minimum(least, depth)
    return least


def _nearest(states: States, length: FloatArray, width: FloatArray) -> tuple[FloatArray, FloatArray]:
    vehicles = states.shape[2]
    gap, ttc = np.full(states.shape, np.inf), np.full(states.shape, MAX_TTC_S)
    ahead = np.full(states.shape, np.inf)
    cos, sin = np.cos(states.heading), np.sin(states.heading)
    others = np.arange(vehicles)
    for v in range(vehicles):
        rest = others != v
        if not rest.any():
            break
        own = (slice(None), slice(None), slice(v, v + 1))
        one = Rectangles.of(states[own], length[v], width[v])
        others_at = Rectangles.of(states[:, :, rest], length[rest], width[rest])
        gap[:, :, v] = rectangle_distance(one, others_at).min(axis=2)
        dx, dy = others_at.x - one.x, others_at.y - one.y
        way = cos[own] * dx + sin[own] * dy - (length[v] + length[rest]) / 2
        beside = np.abs(cos[own] * dy - sin[own] * dx) - (width[v] + width[rest]) / 2
        turned = np.abs(wrap(states.heading[:, :, rest] - states.heading[own]))
        leads = (way > 0) & (beside < 0) & (turned < MAX_TURN_RAD)
        room = np.where(leads, way, np.inf)
        first = room.argmin(axis=2)[:, :, None]
        ahead[:, :, v] = np.take_along_axis(room, first, axis=2)[:, :, 0]
        leader = np.take_along_axis(states.speed[:, :, rest], first, axis=2)[:, :, 0]
        closing = np.maximum(states.speed[:, :, v] - leader, 1e-6)
        ttc[:, :, v] = np.minimum(
            np.where(np.isfinite(ahead[:, :, v]), ahead[:, :, v] / closing, MAX_TTC_S), MAX_TTC_S
        )
    return np.where(np.isfinite(gap), gap, 100.0), ttc
