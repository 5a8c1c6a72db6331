"""Forecasts of positions after 1 to 8 s and of pairs, against the recording."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.extrapolation.loop.measure import measure_outcome, recorded_steps_of
from scex_sumo.extrapolation.loop.rollout import Rollout
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.metrics.events import MEASURED
from scex_sumo.metrics.registry import metric_of
from scex_sumo.results.tables.columns import schema
from scex_sumo.scene import STEP_S, SeedScene, States
from scex_sumo.studies.validate.scores import covered

SECONDS = (1, 2, 3, 5, 8)
MOVING_MPS = 0.5
_REPLAN = 5  # steps
ENCOUNTER_M = 10.0  # a pair that comes this near in some future is an encounter

_NUMBERS = ("error_of_mean_m", "mean_error_m", "least_error_m", "constant_velocity_error_m")
POSITIONS = schema("track_id moving second", _NUMBERS, "along_within across_within")
_OUTCOMES = [f"{event.name}_{what}" for event in MEASURED for what in ("happened", "straight")]
ENCOUNTERS = schema(
    "first second recorded_m",
    (f"{event.name}_forecast" for event in MEASURED),
    _OUTCOMES,
    **dict.fromkeys(_OUTCOMES, pa.bool_()),
)


def position_forecasts(scene: SeedScene, futures: States, straight: States, judged: BoolArray) -> pa.Table:
    """Return one row of `POSITIONS` for each ``judged`` (V,) vehicle, recorded to the end, and each second.

    States (C, T, V), of constant velocity (1, T, V); along and across the heading: whether the recorded place
    is within 5-95 % of the futures.
    """
    assert scene.future is not None
    rows = []
    for second in SECONDS:
        step = 10 * second - 1
        if step >= futures.shape[1]:
            continue
        for v in np.flatnonzero(judged).tolist():
            x, y, heading = (
                float(a[v, step]) for a in (scene.future.x, scene.future.y, scene.future.heading)
            )
            dx, dy = futures.x[:, step, v] - x, futures.y[:, step, v] - y
            off = np.hypot(dx, dy)
            cos, sin = np.cos(heading), np.sin(heading)
            rows.append(
                {
                    "track_id": int(scene.track_ids[v]),
                    "moving": bool(scene.now.speed[v] > MOVING_MPS),
                    "second": second,
                    "error_of_mean_m": float(np.hypot(dx.mean(), dy.mean())),
                    "mean_error_m": float(off.mean()),
                    "least_error_m": float(off.min()),
                    "constant_velocity_error_m": float(
                        np.hypot(straight.x[0, step, v] - x, straight.y[0, step, v] - y)
                    ),
                    "along_within": covered(cos * dx + sin * dy, 0.0),
                    "across_within": covered(cos * dy - sin * dx, 0.0),
                }
            )
    return pa.Table.from_pylist(rows, schema=POSITIONS)


def gap_forecasts(
    scene: SeedScene, futures: States, straight: States, recorded: States, judged: BoolArray
) -> pa.Table:
    """Return one row of `ENCOUNTERS` for each pair within 10 m in some future, with its recorded least gap.

    `MEASURED` events of the futures (share), the recording and constant velocity count along the driven
    tracks. Arguments as of `position_forecasts`; ``recorded`` (1, T, V).
    """
    first, second = near_pairs(futures, judged)
    forecast, happened, plain = (
        pair_events(scene, states, first, second) for states in (futures, recorded, straight)
    )
    gaps, real = (least_gap(scene, states, first, second) for states in (futures, recorded))
    rows = [
        {
            "first": int(scene.track_ids[first[k]]),
            "second": int(scene.track_ids[second[k]]),
            "recorded_m": float(real[0, k]),
            **{f"{name}_forecast": float(flags[:, k].mean()) for name, flags in forecast.items()},
            **{f"{name}_happened": bool(flags[0, k]) for name, flags in happened.items()},
            **{f"{name}_straight": bool(flags[0, k]) for name, flags in plain.items()},
        }
        for k in np.flatnonzero(gaps.min(axis=0, initial=np.inf) <= ENCOUNTER_M).tolist()
    ]
    return pa.Table.from_pylist(rows, schema=ENCOUNTERS)


def pair_events(scene: SeedScene, states: States, first: IntArray, second: IntArray) -> dict[str, BoolArray]:
    """Return by name (C, P) whether events happen; planned paths are the driven tracks, then straight on."""
    count, steps, _ = states.shape
    last = states[:, -1:]
    travelled_m = last.speed * STEP_S * np.arange(1, PLAN_STEPS + 1)[:, None]
    further = (last.x + travelled_m * np.cos(last.heading), last.y + travelled_m * np.sin(last.heading))
    at = np.arange(0, steps, _REPLAN)[:, None] + np.arange(PLAN_STEPS)  # (R, H)
    plan_x, plan_y = (
        np.concatenate(parts, axis=1)[:, at].swapaxes(2, 3)
        for parts in zip((states.x, states.y), further, strict=True)
    )
    along = Rollout(states=states, plan_x=plan_x, plan_y=plan_y, replan=_REPLAN)
    counted = recorded_steps_of(scene, steps)
    met = measure_outcome(scene, along, metrics=(metric_of("distance"),), counted=counted).encounters
    number = np.full((scene.vehicles, scene.vehicles), -1)
    number[first, second] = np.arange(len(first))
    pair = number[met.first, met.second]
    events = {}
    for event in MEASURED:
        events[event.name] = np.zeros((count, len(first)), dtype=bool)
        some = (pair >= 0) & met.happens(event)
        events[event.name][met.future[some], pair[some]] = True
    return events


def near_pairs(futures: States, judged: BoolArray) -> tuple[IntArray, IntArray]:
    """Return both vehicles of each judged pair whose centres come within 25 m in some future."""
    vehicles = np.flatnonzero(judged)
    a, b = np.triu_indices(len(vehicles), 1)
    first, second = vehicles[a], vehicles[b]
    near = np.zeros(len(first), dtype=bool)
    for k in range(0, len(first), 256):
        i, j = first[k : k + 256], second[k : k + 256]
        dx, dy = futures.x[:, ::5, i] - futures.x[:, ::5, j], futures.y[:, ::5, i] - futures.y[:, ::5, j]
        near[k : k + 256] = (np.hypot(dx, dy) < 25.0).any(axis=(0, 1))
    return first[near], second[near]


def least_gap(scene: SeedScene, states: States, first: IntArray, second: IntArray) -> FloatArray:
    """Return (C, P) least gaps between the bodies of pairs, m."""
    least = np.empty((states.shape[0], len(first)))
    for k, pair in enumerate(zip(first.tolist(), second.tolist(), strict=True)):
        one, two = (Rectangles.of(states[:, :, v], scene.length[v], scene.width[v]) for v in pair)
        least[:, k] = rectangle_distance(one, two).min(axis=1)
    return least
