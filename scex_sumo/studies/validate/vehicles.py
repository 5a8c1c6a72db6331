"""Forecasts of positions after 1 to 8 s and of pairs, against the recording."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import BoolArray, IntArray
from scex_sumo.metrics.encounters import Encounters
from scex_sumo.metrics.events import MEASURED
from scex_sumo.results.tables.columns import schema
from scex_sumo.scene import SeedScene, States
from scex_sumo.studies.validate.scores import covered

SECONDS = (1, 2, 3, 5, 8)
MOVING_MPS = 0.5

_NUMBERS = ("error_of_mean_m", "mean_error_m", "least_error_m", "constant_velocity_error_m")
POSITIONS = schema("track_id moving second", _NUMBERS, "along_within across_within")
_OUTCOMES = [f"{event.name}_{what}" for event in MEASURED for what in ("happened", "straight")]
ENCOUNTERS = schema(
    "first second",
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
            place, straight_on = scene.future[v, step], straight[0, step, v]
            dx, dy = futures.x[:, step, v] - place.x, futures.y[:, step, v] - place.y
            along, across = place.ahead_and_left(futures.x[:, step, v], futures.y[:, step, v])
            apart = np.hypot(dx, dy)
            rows.append(
                {
                    "track_id": int(scene.track_ids[v]),
                    "moving": bool(scene.now.speed[v] > MOVING_MPS),
                    "second": second,
                    "error_of_mean_m": float(np.hypot(dx.mean(), dy.mean())),
                    "mean_error_m": float(apart.mean()),
                    "least_error_m": float(apart.min()),
                    "constant_velocity_error_m": float(
                        np.hypot(straight_on.x - place.x, straight_on.y - place.y)
                    ),
                    "along_within": covered(along, 0.0),
                    "across_within": covered(across, 0.0),
                }
            )
    return pa.Table.from_pylist(rows, schema=POSITIONS)


def pair_forecasts(
    scene: SeedScene,
    driven: Encounters,
    straight: Encounters,
    recorded: Encounters,
    judged: BoolArray,
    *,
    futures: int,
) -> pa.Table:
    """Return one row of `ENCOUNTERS` for each pair of ``judged`` (V,) vehicles within 10 m in some future.

    `MEASURED` events: the share of the futures, and whether they happened and do at constant velocity. Pairs
    whose recorded boxes touch are left out: these boxes are inexact.

    Args:
        driven: of all futures; ``straight`` of constant velocity.
        futures: number of them.
    """

    def counted(encounters: Encounters, chosen: BoolArray) -> IntArray:
        """Return how often (V * V,) each pair is among the chosen encounters."""
        pair = encounters.first * scene.vehicles + encounters.second
        return np.asarray(np.bincount(pair[chosen], minlength=scene.vehicles**2))

    is_near = np.isfinite(driven.gap) & judged[driven.first] & judged[driven.second]
    touches = counted(recorded, recorded.gap <= 0) > 0
    pairs = np.flatnonzero((counted(driven, is_near) > 0) & ~touches)
    first, second = np.divmod(pairs, scene.vehicles)
    columns: dict[str, Any] = {"first": scene.track_ids[first], "second": scene.track_ids[second]}
    for event in MEASURED:
        forecast, happened, plain = (
            counted(encounters, encounters.happens(event))[pairs]
            for encounters in (driven, recorded, straight)
        )
        columns |= {
            f"{event.name}_forecast": forecast / futures,
            f"{event.name}_happened": happened > 0,
            f"{event.name}_straight": plain > 0,
        }
    return pa.table({name: columns[name] for name in ENCOUNTERS.names}).cast(ENCOUNTERS)
