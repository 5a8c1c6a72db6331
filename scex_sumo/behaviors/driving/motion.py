"""Vehicle motion along a path: a kinematic bicycle with steering feedback.

The reference point is the rear axle. Each step is an arc.

Steering feeds back offset d, heading error e and curvature error k in arc length. Without limits the offset
decays like (A + Bs + Cs²)·exp(-ωs), ω = 1/max(3 m, v·0.67 s).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray, clipped
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.base import PLAN_STEPS, Driver, Sight
from scex_sumo.behaviors.driving.paths import DS_M, OnPath, PathChoice, SeedPaths, chosen_paths, expected_way
from scex_sumo.geometry.polylines import wrap
from scex_sumo.scene import STEP_S, Plan, SceneHistory, States, VehicleIndex

if TYPE_CHECKING:
    from scex_sumo.road import Road

REAR_AXLE_SHARE = 0.3  # of the length, behind the centre
CURVATURE_LIMIT = 0.2  # 1/m, a turning radius of 5 m
SHARPEST = 0.9  # 1/m, of a path's own bend, as SUMO's nets have it where vehicles turn round
JOIN_TIME_S = 0.67
JOIN_LENGTH_M = 3.0
JOIN_ANGLE_RAD = 0.5
JOIN_ACCELERATION = 3.2  # m/s² lateral, beyond that of the path; twice that at large heading errors
JOIN_HEADING_RAD = 0.18  # a heading error that is large
JOIN_JERK = 8.0  # m/s³ lateral; twice that at large heading errors
SLOPE_SPEED = 1.0  # m/s; slower vehicles steer as at this speed for a changing offset
CURVE_TIME_S = 0.8  # time constant of slowing down for a curve
CURVE_ACCELERATION = 4.05  # m/s² lateral, as ``calibrated_driver``
CURVE_DECELERATION = 2.18  # m/s² before a curve, as ``calibrated_driver``
CURVE_BRAKING = 6.0  # m/s² at most, for a vehicle that is too fast already
STEERING_RATE = 0.3  # 1/(m·s): 45 degrees/s at the wheels of a 2.7 m wheelbase

Lead: TypeAlias = tuple[FloatArray | float, FloatArray | float]
# (step, speed, arc length from the start of the plan, arc length on the table) -> m/s²
Accelerate: TypeAlias = Callable[[int, FloatArray, FloatArray, FloatArray], FloatArray]


def rear_axle(states: States, length: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return positions of rear axles, m."""
    back = REAR_AXLE_SHARE * length
    return states.x - back * np.cos(states.heading), states.y - back * np.sin(states.heading)


def _present_bend(
    on: OnPath, s: FloatArray, heading: FloatArray, v: FloatArray, aside: FloatArray | None
) -> FloatArray:
    """Return (n,) curvatures of the vehicles' motion minus those of their lines, 1/m."""
    history, vehicles, paths, row = on
    now = on.now
    before = history.states[vehicles.future, vehicles.vehicle, -2 if history.step > 0 else -6]
    length = history.scene.length[vehicles.vehicle]
    (x, y), (px, py) = rear_axle(now, length), rear_axle(before, length)
    chord, turned = np.sqrt((x - px) ** 2 + (y - py) ** 2), wrap(now.heading - before.heading)
    arc_length = chord * (1 + turned**2 / 24)  # arc over a chord
    then, _, _ = paths.refine(row, s - arc_length, px, py, 2)
    line = _bend_beside(paths.bend_at(row, then + arc_length / 2), aside, v)
    bend = turned / np.maximum(arc_length, 0.02) - line
    # A padded history is straight in a curve; a standing vehicle can turn its wheels first.
    most = _bend_limit(v, _urgency(wrap(now.heading - heading)))
    return np.where(arc_length > 0.02, clipped(bend, -most, most), 0.0)


def drive(
    history: SceneHistory,
    vehicles: VehicleIndex,
    paths: SeedPaths,
    row: IntArray,
    accelerate: Accelerate,
    *,
    start: States | None = None,
    steps: int = PLAN_STEPS,
    aside: FloatArray | None = None,
    parallel: bool = False,
) -> Plan:
    """Drive n vehicles along their paths, as a car steers: a plan of H steps of 0.1 s.

    Args:
        row: (n,) path of each vehicle in ``paths``, see `chosen_paths`.
        accelerate: function of the step, and of speed, way travelled and arc length of the rear axle (n,)
            each, that returns accelerations (n,), m/s²; vehicles stop instead of reversing.
        aside: (n, H + 1) wanted offset now and after each step, m, left positive; None is 0.
        parallel: steer with the curvature of the line at that offset instead of that of the path.

    Example:
        >>> history = scex.SceneHistory.of_scene(scex.read_seed(scex.example_path("roundabout")))
        >>> vehicles = scex.VehicleIndex(future=np.array([0]), vehicle=np.array([3]))
        >>> paths, row = scex.chosen_paths(history, history.scene.road, vehicles, "straight")
        >>> braked = lambda step, speed, travelled, s: 0 * speed - 9.0
        >>> plan = scex.drive(history, vehicles, paths, row, braked)
        >>> plan.x.shape, float(plan.speed[0, -1])
        ((1, 30), 0.0)
    """
    length = history.scene.length[vehicles.vehicle]
    if paths.slow_in_curves:
        accelerate = _slowing_for_curves(accelerate, paths, row, REAR_AXLE_SHARE * length)
    on = OnPath(history, vehicles, paths, row)
    now = on.now
    begin = now if start is None else start
    x, y = rear_axle(begin, length)
    s, _, path_heading = paths.foot_points(row, x, y, expected_way(history, vehicles))
    heading = path_heading + wrap(begin.heading - path_heading)
    v = np.maximum(begin.speed, 0.0)
    # The steering angle is known for the present state only.
    there = (begin.x == now.x) & (begin.y == now.y)
    wanted = None if aside is None else np.ascontiguousarray(aside.T)
    beside = wanted[0] if wanted is not None and parallel else None
    bend = np.where(there, _present_bend(on, s, path_heading, v, beside), 0.0)
    s0, out = s, np.empty((4, steps, len(vehicles)))
    for step in range(steps):
        a = accelerate(step, v, s - s0, s)
        following = v + a * STEP_S
        stops_m = v**2 / np.maximum(-2 * a, 1e-9)
        moved = np.where(following >= 0, (v + following) * (STEP_S / 2), stops_m)
        px, py, cos, sin, path_heading, _ = paths.at(row, s)
        dx, dy = x - px, y - py
        s = s + (cos * dx + sin * dy)
        offset = cos * dy - sin * dx
        lead: Lead = (0.0, 0.0)
        if wanted is not None:
            offset, lead = offset - wanted[step], _lead(wanted, step, moved)
            beside = wanted[step] if parallel else None
        bend = _steer(bend, offset, heading - path_heading, v, moved, lead)
        curvature = _bend_beside(paths.bend_at(row, s + moved / 2), beside, v)
        most = np.maximum(np.abs(curvature), CURVATURE_LIMIT)
        turn = clipped(curvature + bend, -most, most)
        bend = turn - curvature
        angle = turn * moved
        z2, middle = (angle / 2) ** 2, heading + angle / 2
        chord = moved * (1 - z2 / 6 * (1 - z2 / 20))  # sin(z)/z of the half angle, below 0.5
        x, y, heading = x + chord * np.cos(middle), y + chord * np.sin(middle), heading + angle
        s, v = s + moved, np.maximum(following, 0.0)
        out[0, step], out[1, step], out[2, step], out[3, step] = x, y, heading, v
    x, y, heading, speed = np.ascontiguousarray(out.transpose(0, 2, 1))
    ahead = (REAR_AXLE_SHARE * length)[:, None]
    x, y = x + ahead * np.cos(heading), y + ahead * np.sin(heading)
    return Plan(x=x, y=y, heading=wrap(heading), speed=speed)


def drive_along(
    history: SceneHistory,
    road: Road,
    vehicles: VehicleIndex,
    path: PathChoice,
    accelerate: Accelerate = lambda _, v, *__: np.zeros_like(v),
    *,
    start: States | None = None,
) -> Plan:
    """Drive vehicles along chosen paths for 3 s, by default at their speed; see `drive`."""
    paths, row = chosen_paths(history, road, vehicles, path)
    return drive(history, vehicles, paths, row, accelerate, start=start)


def _bend_beside(bend: FloatArray, aside: FloatArray | None, v: FloatArray) -> FloatArray:
    """Return (n,) curvatures of lines at constant offsets from paths with curvatures (n,), 1/m.

    At most those that vehicles can drive; slow vehicles turn as sharply as the lane does, else they leave it.
    """
    line = bend if aside is None else bend / np.maximum(1 - bend * aside, 0.5)
    most = np.minimum(CURVE_ACCELERATION / np.maximum(v * v, 1.0), SHARPEST)
    most = np.maximum(most, CURVATURE_LIMIT)
    return clipped(line, -most, most)


def _lead(wanted: FloatArray, step: int, moved: FloatArray) -> tuple[FloatArray, FloatArray]:
    distance_m = np.maximum(moved, SLOPE_SPEED * STEP_S)
    change = wanted[step + 1] - wanted[step]
    further = wanted[min(step + 2, len(wanted) - 1)] - wanted[step + 1]
    bend = (further - change) / distance_m**2 if step + 2 < len(wanted) else np.zeros_like(distance_m)
    return change / distance_m, bend


def _steer(
    bend: FloatArray, offset: FloatArray, error: FloatArray, v: FloatArray, moved: FloatArray, lead: Lead
) -> FloatArray:
    """Return the curvature error after one step.

    ``offset``: (n,) present minus wanted offset, m; ``lead``: derivatives of the latter, to remove the lag.
    """
    omega = 1 / np.maximum(JOIN_LENGTH_M, JOIN_TIME_S * v)
    urgency = _urgency(error)
    most = _bend_limit(v, urgency)
    aim = -clipped(omega / 3 * offset, -JOIN_ANGLE_RAD, JOIN_ANGLE_RAD)
    aim = clipped(aim + lead[0], -JOIN_ANGLE_RAD, JOIN_ANGLE_RAD)
    wanted = clipped(omega * (aim - error) + lead[1], -most, most)
    rate = np.minimum(STEERING_RATE, urgency * JOIN_JERK / np.maximum(v * v, 1.0)) * STEP_S
    change = (3 * omega * moved) * (wanted - bend)
    return bend + clipped(change, -rate, rate)


def _urgency(error: FloatArray) -> FloatArray:
    return clipped(np.abs(error) / JOIN_HEADING_RAD, 1.0, 2.0)


def _bend_limit(v: FloatArray, urgency: FloatArray) -> FloatArray:
    return np.minimum(0.75 * CURVATURE_LIMIT, urgency * JOIN_ACCELERATION / np.maximum(v * v, 1.0))


@owner_cache
def curve_speeds(paths: SeedPaths, lateral: float, deceleration: float) -> FloatArray:
    """Return (P * N,) highest speeds along all paths that respect every curve ahead, m/s."""
    square = lateral / np.maximum(paths.curve_curvature, 1e-6)
    # v² may fall by 2·b·ds per sample: a running minimum of v² + 2·b·s from the far end.
    slope = 2 * deceleration * DS_M * np.arange(paths.samples)
    reachable = np.minimum.accumulate((square + slope)[:, ::-1], axis=1)[:, ::-1] - slope
    return np.asarray(np.sqrt(reachable).ravel())


def _slowing_for_curves(
    accelerate: Accelerate, paths: SeedPaths, row: IntArray, ahead: FloatArray
) -> Accelerate:
    speeds = curve_speeds(paths, CURVE_ACCELERATION, CURVE_DECELERATION)

    def limited(step: int, v: FloatArray, travelled: FloatArray, s: FloatArray) -> FloatArray:
        # A moment ahead too, so that the car does not lag behind.
        here, soon = (speeds[paths.sample_at(row, arc + ahead)] for arc in (s, s + v * CURVE_TIME_S))
        slowing = (np.minimum(here, soon) - v) / CURVE_TIME_S
        return np.minimum(accelerate(step, v, travelled, s), np.maximum(slowing, -CURVE_BRAKING))

    return limited


def own_motion(history: SceneHistory, vehicles: VehicleIndex) -> FloatArray:
    """Return (n, 45) index and last second of each vehicle."""
    past = history.states[vehicles.future, vehicles.vehicle]
    return np.concatenate([vehicles.vehicle[:, None], past.x, past.y, past.heading, past.speed], axis=1)


def map_plan(now: States, own: States) -> Plan:
    """Transform states (n, H) from the frames of vehicles (n,) to the map."""
    now = now[:, None]
    cos, sin = np.cos(now.heading), np.sin(now.heading)
    x, y = now.x + cos * own.x - sin * own.y, now.y + sin * own.x + cos * own.y
    return Plan(x=x, y=y, heading=wrap(now.heading + own.heading), speed=own.speed)


def handed_out(plan: Plan, kind: IntArray) -> Plan:
    """Expand k distinct plans to n vehicles; `kind` (n,) is the plan of each."""
    fallback = None if plan.fallback is None else plan.fallback[kind]
    reasons = tuple(plan.reasons[k] for k in kind.tolist()) if plan.reasons else ()
    return Plan(**vars(plan[kind]), fallback=fallback, reasons=reasons)


@dataclass(frozen=True, eq=False)
class Intent:
    """Arguments of `drive` for n distinct situations; ``aside`` as there."""

    vehicles: VehicleIndex
    paths: SeedPaths
    row: IntArray
    accelerate: Accelerate
    # (m,) situation of each of the m vehicles; None if each has its own
    kind: IntArray | None = None
    aside: FloatArray | None = None

    def of(self, kind: IntArray) -> Intent:
        """Return the intent for (k,) of the m vehicles."""
        return replace(self, kind=kind if self.kind is None else self.kind[kind])


class DrivesAlong(Driver, ABC):
    """Base of models whose plan is a drive along a path; ``profile`` has a ``path``."""

    sees: ClassVar[Sight] = "itself"  # what a plan depends on if the path is not drawn

    def __init__(self, profile: Any) -> None:
        self.profile = profile

    @property
    def sight(self) -> Sight | None:
        """What a plan depends on; a drawn path differs between futures."""
        return None if self.profile.path == "random" else self.sees

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Plan 3 s; see `BatchBehavior.plan`."""
        return driven(history, [self.intend(history, road, vehicles)])[0]

    @abstractmethod
    def intend(self, history: SceneHistory, road: Road, vehicles: VehicleIndex) -> Intent:
        """Return the drive of these vehicles."""

    @property
    def looks(self) -> Hashable:
        """Key of drivers that look around together; its own: alone."""
        return self

    @staticmethod
    def intend_together(
        drivers: Sequence[Any], history: SceneHistory, road: Road, groups: Sequence[VehicleIndex]
    ) -> list[Intent]:
        """Return the intents of drivers with one key, each for its vehicles."""
        return [driver.intend(history, road, mine) for driver, mine in zip(drivers, groups, strict=True)]


def driven(history: SceneHistory, intents: Sequence[Intent], steps: int = PLAN_STEPS) -> list[Plan]:
    """Drive the vehicles of several models in one call; return a plan per model."""
    plans: dict[int, Plan] = {}
    for paths in {id(intent.paths): intent.paths for intent in intents}.values():
        mine = [index for index, intent in enumerate(intents) if intent.paths is paths]
        plans |= zip(mine, _side_by_side(history, [intents[k] for k in mine], steps), strict=True)
    return [plans[index] for index in range(len(intents))]


def _side_by_side(history: SceneHistory, intents: Sequence[Intent], steps: int) -> list[Plan]:
    counts = [len(intent.vehicles) for intent in intents]
    ends = [0, *accumulate(counts)]
    parts = [
        (intent.accelerate, slice(*batch)) for intent, batch in zip(intents, pairwise(ends), strict=True)
    ]

    def accelerate(step: int, v: FloatArray, travelled: FloatArray, s: FloatArray) -> FloatArray:
        return np.concatenate([model(step, v[k], travelled[k], s[k]) for model, k in parts])

    vehicles = VehicleIndex.join([intent.vehicles for intent in intents])
    row, aside = np.concatenate([intent.row for intent in intents]), None
    if any(intent.aside is not None for intent in intents):
        given = ((intent.aside, count) for intent, count in zip(intents, counts, strict=True))
        aside = np.vstack([np.zeros((n, PLAN_STEPS + 1)) if a is None else a for a, n in given])
    plan = drive(history, vehicles, intents[0].paths, row, accelerate, steps=steps, aside=aside)
    kinds = [np.arange(n) if i.kind is None else i.kind for i, n in zip(intents, counts, strict=True)]
    return [handed_out(plan, begin + kind) for begin, kind in zip(ends, kinds, strict=False)]
