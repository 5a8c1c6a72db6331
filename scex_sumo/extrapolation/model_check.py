"""Check of a driver on the example roundabout: shapes, finite plans, the same plans in any batch, seconds."""

from __future__ import annotations

import time

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.blame import own_error_reason
from scex_sumo.base.errors import ScexError, UsageError
from scex_sumo.behaviors.base import BatchBehavior, driven_by_sumo
from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.extrapolation.assignments import future_generator, route_draws
from scex_sumo.extrapolation.loop.rollout import history_at
from scex_sumo.plug_in.fallback import STATES, plan_arrays, plan_defects
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed
from scex_sumo.scene import Plan, SceneHistory, VehicleIndex

FUTURES, OTHER_BATCH = 6, (4, 1, 3)
"""Futures of the check, and those that plan again in another batch and order."""


def check_model(text: str) -> tuple[list[str], int, tuple[float, float]]:
    """Let a driver plan for all vehicles of the example roundabout: twice, then in another batch and order.

    Returns:
        A sentence for each fault; the plans of a call; seconds of one in the first call and in the second.

    Raises:
        UsageError: it is not one driver that plans.
        ScexError: it raises, or returns no plan; with the line of its code.
    """
    specs = parse_models(text)
    model = build(specs[0])
    if len(specs) > 1 or driven_by_sumo(model):
        raise UsageError(f"--check {text}: give one driver; SUMO's own and mixes have no plans to check")
    name, scene = str(specs[0]), read_seed(example_path("roundabout"))
    futures = np.arange(FUTURES)
    draw = route_draws(futures, scene.vehicles, seed=0)
    history = history_at(scene, scene.history.repeat(FUTURES), futures, draw, step=0)
    first, vehicles, seconds = _planned(model, name, history)
    again, _, shifted = _planned(model, name, history)
    faults = _defects(first, history, vehicles)
    if (different := ~_same(first, again)).any():
        faults.append(
            f"{_share(different)} differ when the same is asked again: draw from rng, and keep nothing"
        )
    else:
        other_futures = np.array(OTHER_BATCH)
        other, _, _ = _planned(model, name, history.part(other_futures))
        rows = [np.flatnonzero(vehicles.future == future) for future in other_futures]
        if (different := ~_same(first[np.concatenate(rows)], other)).any():
            faults.append(
                f"{_share(different)} differ in a batch of {len(other_futures)} other futures: draw for a "
                "vehicle from its own future's rng alone, and compute row by row"
            )
    return faults, len(vehicles), (seconds, shifted)


def _planned(
    model: BatchBehavior, name: str, history: SceneHistory
) -> tuple[FloatArray, VehicleIndex, float]:
    """Return plans (n, 4, 30), whose they are, and the seconds that one takes."""
    count, columns = history.now.shape
    future, vehicle = np.indices((count, columns)).reshape(2, -1)
    vehicles = VehicleIndex(future=future, vehicle=vehicle)
    rng = [future_generator(0, number) for number in history.futures.tolist()]
    road, began = history.scene.road, time.perf_counter()
    assert road is not None
    try:
        plan = plan_arrays(model.plan(history, road, vehicles, rng), len(vehicles))
    except (Exception, SystemExit) as error:  # whatever a user's driver raises
        raise ScexError(f"{name}: {own_error_reason(error)}") from error
    seconds = (time.perf_counter() - began) / len(vehicles)
    return np.stack([getattr(plan, key) for key in STATES], axis=1), vehicles, seconds


def _defects(plans: FloatArray, history: SceneHistory, vehicles: VehicleIndex) -> list[str]:
    x, y, heading, speed = plans.transpose(1, 0, 2)
    plan = Plan(x=x, y=y, heading=heading, speed=speed)
    defects = [defect for defect in plan_defects(plan, history, vehicles) if defect]
    return [f"{len(defects)} of {len(vehicles)} plans are unusable: {defects[0]}"] if defects else []


def _same(plans: FloatArray, others: FloatArray) -> BoolArray:
    """Return (n,) whether two plans are equal; NaN is like NaN."""
    same: BoolArray = ((plans == others) | (np.isnan(plans) & np.isnan(others))).all(axis=(1, 2))
    return same


def _share(different: BoolArray) -> str:
    return f"{int(np.sum(different))} of {len(different)} plans"
