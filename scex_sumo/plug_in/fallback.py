"""Fallback planner: replaces unusable plans of learned and users' models."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.blame import own_error_reason
from scex_sumo.base.errors import OutOfTimeError, ScexError
from scex_sumo.behaviors.base import (
    BY_ITSELF,
    PLAN_STEPS,
    BatchBehavior,
    Driver,
    Sight,
    clear_of_others,
    declared,
)
from scex_sumo.behaviors.driving.motion import Intent, driven
from scex_sumo.behaviors.driving.paths import chosen_paths, expected_way, nearest_paths
from scex_sumo.behaviors.models.idm import CALIBRATED, IdmDriver
from scex_sumo.geometry.polylines import wrap
from scex_sumo.plug_in.time_limit import time_limit
from scex_sumo.plug_in.user_model import SingleVehicle
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, States, VehicleIndex

MAX_CALL_S, MAX_VEHICLE_S = 60.0, 0.1  # of a call, and of each of its vehicles in addition
MAX_NAME = 80  # characters of a model's name in an error
OFF_PATH_M = 5.0  # a vehicle further from all its paths goes straight on
AGAINST_PATH_RAD = np.pi / 2  # as does one with a larger heading error
JUMP_M = 5.0  # from the straight motion within one step: 500 m/s², beyond any vehicle
SHARE = 0.5  # of its way by which speed and heading of a plan may contradict its positions, beyond 5 m
RANGES = {"speed": (-20.0, 120.0), "heading": (-1e4, 1e4)}  # m/s, below 0 in reverse; rad
STATES = ("x", "y", "heading", "speed")

Rngs: TypeAlias = Sequence[np.random.Generator]  # by future
Answer: TypeAlias = tuple[
    Plan, list[str], BoolArray
]  # plans, why each fell back, whether it must be replaced


class Fallible(Driver):
    """A model with a fallback: the path-following driver plans for vehicles without a usable plan.

    A call that raises is repeated future by future, then vehicle by vehicle.
    """

    def __init__(self, model: BatchBehavior, name: str) -> None:
        self.inner, self.name, self.source_file = model, name, source_file(model)

    @property
    def sight(self) -> Sight | None:
        """What a plan depends on."""
        return declared(self.inner).sight

    def clear_of_others(self) -> Fallible:
        """Return a copy whose model steers away from vehicles beside it."""
        return Fallible(clear_of_others(self.inner), self.name)

    def intend(self, history: SceneHistory, road: Road, vehicles: VehicleIndex) -> Intent | None:
        """Return the drive of a model of this package along paths; None if it may need a fallback."""
        intent: Intent | None = None
        with suppress(Exception):  # `plan` meets it again
            intent = declared(self.inner).intend(history, road, vehicles)
        return intent

    def plan(self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Rngs) -> Plan:
        """Return the plan with `Plan.fallback` and `Plan.reasons`; see `BatchBehavior.plan`."""
        plan, reasons, bad = self._ask(history, road, vehicles, rng)
        if bad.any():
            plan.assign(bad, follow_path(history, road, vehicles[bad]))
        return replace(plan, fallback=np.array([r != "" for r in reasons], bool), reasons=tuple(reasons))

    def try_on(self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Rngs) -> None:
        """Raise a `ScexError` if the model has no usable plan for any of these vehicles."""
        plan = self.plan(history, road, vehicles, rng)
        if len(vehicles) == 0 or plan.fallback is None or not plan.fallback.all():
            return
        none = f"no usable plan for any of {len(vehicles)} vehicles of the seed scene"
        why = f"{self._short_name()}: {none}: {plan.reasons[0]}"
        if not is_ours(self.inner):
            why += f"; it is {describe_source(self.inner)}; a Plan has x, y, heading, speed, each (n, "
            why += f"{PLAN_STEPS}) or more steps, finite, in m and rad of the map, starting at the vehicle"
        raise ScexError(why)

    def _short_name(self) -> str:
        return self.name if len(self.name) <= MAX_NAME else f"{self.name[:MAX_NAME]}..."

    def _limited(self, vehicles: int) -> AbstractContextManager[None]:
        if is_ours(self.inner):  # programs have limits of their own
            return nullcontext()
        return time_limit(f"the driver {self._short_name()}", MAX_CALL_S + MAX_VEHICLE_S * vehicles)

    def _ask(self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Rngs) -> Answer:
        if isinstance(self.inner, SingleVehicle) and len(vehicles) > 1:  # one vehicle at a time anyway
            return self._ask_each(history, road, vehicles, np.arange(len(vehicles)), rng)
        futures = np.unique(vehicles.future).tolist() if len(vehicles) > 1 else []
        before = [rng[future].bit_generator.state for future in futures]
        try:
            with self._limited(len(vehicles)):
                planned = self.inner.plan(history, road, vehicles, rng)
            plan = plan_arrays(planned, len(vehicles))
            defects = plan_defects(plan, history, vehicles)
        except OutOfTimeError:
            raise
        except (Exception, SystemExit) as error:  # of a user's code
            if len(vehicles) == 1:
                return _blank(1), [own_error_reason(error)], np.ones(1, dtype=np.bool_)
            for future, state in zip(futures, before, strict=True):
                rng[future].bit_generator.state = state
            of_future = np.searchsorted(futures, vehicles.future)
            groups = of_future if len(futures) > 1 else np.arange(len(vehicles))
            return self._ask_each(history, road, vehicles, groups, rng)
        said = plan.reasons or (BY_ITSELF,) * len(vehicles)
        fell = np.zeros(len(vehicles), bool) if plan.fallback is None else plan.fallback
        reasons = [d or (s if f else "") for d, s, f in zip(defects, said, fell, strict=True)]
        return plan, reasons, np.array([d != "" for d in defects], bool)

    def _ask_each(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, group: IntArray, rng: Rngs
    ) -> Answer:
        count = len(vehicles)
        whole, reasons, bad = _blank(count), np.full(count, "", dtype=object), np.zeros(count, dtype=np.bool_)
        for number in range(int(group.max()) + 1):
            members = np.flatnonzero(group == number)
            plan, reasons[members], bad[members] = self._ask(history, road, vehicles[members], rng)
            whole.assign(members, plan)
        return whole, reasons.tolist(), bad


def follow_path(history: SceneHistory, road: Road, vehicles: VehicleIndex) -> Plan:
    """Plan 3 s for vehicles without a plan: ``calibrated_driver`` on the nearest path, or straight on."""
    paths, straight = chosen_paths(history, road, vehicles, "straight")
    now, arc_length = history.now[vehicles.future, vehicles.vehicle], expected_way(history, vehicles)
    path, (_, offset, heading) = nearest_paths(
        paths, straight, vehicles.vehicle, arc_length, now.x, now.y, now.heading
    )
    off = (np.abs(offset) > OFF_PATH_M) | (np.abs(wrap(now.heading - heading)) > AGAINST_PATH_RAD)
    plan = driven(history, [IdmDriver(CALIBRATED).follow(history, vehicles, paths, path)])[0]
    speed = np.maximum(now.speed[off], 0.0)[:, None] * np.ones(PLAN_STEPS)
    plan.assign(off, now[off].ahead(speed * STEP_S * np.arange(1, PLAN_STEPS + 1), speed))
    return plan


def _blank(count: int) -> Plan:
    return Plan(**vars(States.empty((count, PLAN_STEPS)).map(np.zeros_like)))


def plan_arrays(plan: Any, count: int) -> Plan:
    """Copy the first 30 steps of a model's plan; raise a `ScexError` if it is none."""
    parts = {}
    for key in STATES:
        if not hasattr(plan, key):
            raise ScexError(f"returned {type(plan).__name__}, which has no {key}; needs a scex_sumo.Plan")
        values = np.asarray(getattr(plan, key), dtype=np.float64)
        if values.ndim != 2 or values.shape[0] != count or values.shape[1] < PLAN_STEPS:
            needs = f"needs ({count}, {PLAN_STEPS}) or more steps"
            raise ScexError(f"plan.{key} has shape {values.shape}, {needs}")
        parts[key] = values[:, :PLAN_STEPS].copy()
    return Plan(**parts, fallback=getattr(plan, "fallback", None), reasons=getattr(plan, "reasons", ()))


def plan_defects(plan: Plan, history: SceneHistory, vehicles: VehicleIndex) -> list[str]:
    """Return why each plan is unusable; an empty text for a usable plan.

    A plan must be finite, in what a vehicle can do (`RANGES`), and no state more than 5 m from the straight
    continuation of the motion before it. Positions, speed and heading must tell roughly the same motion.
    """
    reasons = [""] * len(vehicles)
    for key in STATES:
        values, (least, most) = getattr(plan, key), RANGES.get(key, (-np.inf, np.inf))
        finite = np.isfinite(values)
        for vehicle, step in _first(~(finite & (values >= least) & (values <= most)), reasons):
            needs = f"{values[vehicle, step]:g} at step {step + 1}; needs {least:g} to {most:g}"
            reasons[vehicle] = f"plan.{key} is {needs if finite[vehicle, step] else 'not finite'}"
    off, moved, led_m = _motion(plan, history, vehicles)
    for vehicle, step in _first(off > JUMP_M, reasons):
        where = "starts" if step == 0 else f"jumps at step {step + 1} to"
        reasons[vehicle] = f"plan {where} {off[vehicle, step]:.1f} m from where the vehicle's motion leads"
    apart = np.abs(moved - led_m) > np.maximum(JUMP_M, SHARE * np.maximum(np.abs(moved), np.abs(led_m)))
    for vehicle, _ in _first(apart[:, None], reasons):
        led = f"leads {led_m[vehicle]:.1f} m ahead, its positions {moved[vehicle]:.1f} m along plan.heading"
        reasons[vehicle] = f"plan.speed {led}; needs m/s, and rad, 0 along x"
    return reasons


def _first(bad: BoolArray, reasons: Sequence[str]) -> list[tuple[int, int]]:
    """Return the first bad step of each plan (n, H) that has no reason yet."""
    vehicles = np.flatnonzero(bad.any(axis=1) & np.array([reason == "" for reason in reasons], bool))
    return [(vehicle, int(np.argmax(bad[vehicle]))) for vehicle in vehicles.tolist()]


def _motion(plan: Plan, history: SceneHistory, vehicles: VehicleIndex) -> tuple[FloatArray, ...]:
    """Return deviations (n, H) from the straight motion, and ways ahead (n,) by positions and by speed, m."""
    now = history.now[vehicles.future, vehicles.vehicle]
    step = now.speed * STEP_S
    x = np.concatenate([(now.x - step * np.cos(now.heading))[:, None], now.x[:, None], plan.x], axis=1)
    y = np.concatenate([(now.y - step * np.sin(now.heading))[:, None], now.y[:, None], plan.y], axis=1)
    with np.errstate(invalid="ignore", over="ignore"):
        off = np.hypot(np.diff(x, 2, axis=1), np.diff(y, 2, axis=1))
        dx, dy, heading = np.diff(plan.x, axis=1), np.diff(plan.y, axis=1), plan.heading[:, :-1]
        moved = (dx * np.cos(heading) + dy * np.sin(heading)).sum(axis=1)
        return off, moved, plan.speed[:, :-1].sum(axis=1) * STEP_S


def describe_source(model: Any) -> str:
    """Return where a model is, e.g. ``class Driver of /path/driver.py``."""
    source = _unwrapped(model)
    if hasattr(source, "file"):
        return f"the file {source.file}"
    kind = "function" if inspect.isfunction(source) else "class"
    file = source_file(model)
    return f"{kind} {source.__qualname__} of {source.__module__ if file is None else file}"


def is_ours(model: Any) -> bool:
    """Return whether a model's class is of this package, as that of a program is."""
    source = _unwrapped(model)
    return not hasattr(source, "file") and source.__module__.partition(".")[0] == __name__.partition(".")[0]


def source_file(model: Any) -> Path | None:
    """Return the file of a model, its class or its function; None if there is none."""
    source = _unwrapped(model)
    with suppress(OSError, TypeError):
        return Path(source.file if hasattr(source, "file") else inspect.getfile(source))
    return None


def _unwrapped(model: Any) -> Any:
    inner = getattr(model, "function", model.model if isinstance(model, SingleVehicle) else model)
    inner = inner.func if isinstance(inner, partial) else inner
    return inner if inspect.isfunction(inner) or hasattr(inner, "file") else type(inner)
