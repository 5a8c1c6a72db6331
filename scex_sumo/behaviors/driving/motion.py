"""Motion of a car along its path: a kinematic bicycle that joins the path and keeps to it.

The reference point of the bicycle is the rear axle, `REAR_AXLE_SHARE` of the vehicle's length behind its
centre. Each step is an arc of constant curvature, so that the heading follows the motion of the rear axle
exactly.

Steering is a state feedback on offset d, heading error e and curvature error k in arc length with nested
limits: the heading error aims at -ω/3·d, the curvature error at ω·(aim - e), and moves there at rate 3ω.
Without limits the offset decays like (A + Bs + Cs²)·exp(-ωs), so it does not oscillate. ω = 1/max(3 m,
v·0.67 s). The state follows from the pose and the last step's motion alone, so a plan made halfway through
another continues it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.driving.paths import DS_M, PathChoice, SeedPaths, chosen_paths
from scex_sumo.behaviors.driving.projection import (
    bend_at,
    clipped,
    expected_way,
    foot_points,
    refine,
    sample_paths,
)
from scex_sumo.derived import derived
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, States, Who

REAR_AXLE_SHARE = 0.3  # of the length, behind the centre; a 4.5 m car has it 1.35 m behind
CURVATURE_LIMIT = 0.2  # 1/m, a turning radius of 5 m
JOIN_TIME_S = 0.67
JOIN_LENGTH_M = 3.0
JOIN_ANGLE_RAD = 0.5
JOIN_ACCELERATION = 3.2  # m/s² lateral, on top of what the path asks for, up to twice that where
JOIN_HEADING_RAD = 0.18  # the heading is further off than this
JOIN_JERK = 8.0  # m/s³ lateral, likewise
SLOPE_SPEED = 1.0  # m/s; a slower vehicle does not turn further for an offset that changes
STEERING_RATE = 0.3  # 1/(m·s): 45 degrees/s at the wheels of a 2.7 m wheelbase

# (step, speed, arc length on the path from the start of the plan, arc length on the table) -> m/s²
Accelerate: TypeAlias = Callable[[int, FloatArray, FloatArray, FloatArray], FloatArray]


def rear_axle(states: States, length: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions of rear axles, m."""
    back = REAR_AXLE_SHARE * length
    return states.x - back * np.cos(states.heading), states.y - back * np.sin(states.heading)


def _present_bend(
    history: SceneHistory,
    who: Who,
    paths: SeedPaths,
    row: IntArray,
    s: FloatArray,
    heading: FloatArray,
    v: FloatArray,
) -> FloatArray:
    """(n,) by how much vehicles turn more than their path does at the moment, 1/m.

    From the last step, or the last half second where the history was recorded rather than driven by us,
    since recorded headings are noisy.
    """
    steps = 1 if history.step > 0 else 5
    length = history.scene.length[who.vehicle]
    now = history.states[who.child, who.vehicle, -1]
    before = history.states[who.child, who.vehicle, -1 - steps]
    x, y = rear_axle(now, length)
    px, py = rear_axle(before, length)
    chord = np.sqrt((x - px) ** 2 + (y - py) ** 2)
    turned = wrap(now.heading - before.heading)
    way = chord * (1 + turned**2 / 24)  # arc over a chord
    then, _, _ = refine(paths, row, s - way, px, py, 2)
    bend = turned / np.maximum(way, 0.02) - bend_at(paths, row, then + way / 2)
    # Recorded headings are noisy, a padded history is straight in a curve: never off by more than a
    # driver's own correction could be. One who stands can turn the wheel first.
    most = _bend_limit(v, _urgency(wrap(now.heading - heading)))
    return np.where(way > 0.02, clipped(bend, -most, most), 0.0)


def drive(
    history: SceneHistory,
    who: Who,
    paths: SeedPaths,
    row: IntArray,
    accelerate: Accelerate,
    *,
    start: States | None = None,
    steps: int = PLAN_STEPS,
    aside: FloatArray | None = None,
) -> Plan:
    """Drive vehicles along their paths.

    Args:
        row: (n,) path of each.
        accelerate: gives (n,) accelerations for a step; a vehicle whose speed would fall below zero stops
            within the step and stays.
        start: (n,) states to start from, the present ones by default.
        aside: (n, H + 1) wanted offset from the path now and after each step, m, left positive; None is on
            the path. Offsets that change evenly are followed without lag, see `_steer`.

    Returns:
        (n, H).
    """
    length = history.scene.length[who.vehicle]
    now = history.now[who.child, who.vehicle]
    begin = now if start is None else start
    x, y = rear_axle(begin, length)
    s, _, path_heading = foot_points(paths, row, x, y, expected_way(history, who))
    heading = path_heading + wrap(begin.heading - path_heading)
    v = np.maximum(begin.speed, 0.0)
    # How the wheels stand is known where the vehicle is now, not where it shall start later.
    there = (begin.x == now.x) & (begin.y == now.y)
    bend = np.where(there, _present_bend(history, who, paths, row, s, path_heading, v), 0.0)
    s0, out = s, np.empty((4, steps, len(who)))
    wanted = None if aside is None else np.ascontiguousarray(aside.T)
    for step in range(steps):
        a = accelerate(step, v, s - s0, s)
        following = v + a * STEP_S
        moved = np.where(
            following >= 0, (v + following) * (STEP_S / 2), v**2 / np.maximum(-2 * a, 1e-9)
        )  # fmt: skip
        px, py, cos, sin, path_heading, _ = sample_paths(paths, row, s)
        dx, dy = x - px, y - py
        s = s + (cos * dx + sin * dy)
        offset, lead = cos * dy - sin * dx, None
        if wanted is not None:
            offset = offset - wanted[step]
            lead = _lead(wanted, step, moved)
        bend = _steer(bend, offset, heading - path_heading, v, moved, lead)
        curvature = bend_at(paths, row, s + moved / 2)
        turn = clipped(curvature + bend, -CURVATURE_LIMIT, CURVATURE_LIMIT)
        bend = turn - curvature
        x, y, heading = _along_arc(x, y, heading, turn * moved, moved)
        s, v = s + moved, np.maximum(following, 0.0)
        out[0, step], out[1, step], out[2, step], out[3, step] = x, y, heading, v
    return _centres(out, length)


def drive_along(
    history: SceneHistory,
    road: Road,
    who: Who,
    path: PathChoice,
    accelerate: Accelerate | None = None,
    *,
    start: States | None = None,
) -> Plan:
    """Drive vehicles along the paths that they choose; see `drive`.

    Args:
        path: the choice, as in `SeedPaths.choose`.
        accelerate: gives (n,) accelerations for a step; None keeps the speed.
        start: (n,) states to start from, the present ones by default.

    Returns:
        (n, 30).
    """
    paths, row = chosen_paths(history, road, who, path)
    return drive(history, who, paths, row, accelerate or (lambda _, v, *__: np.zeros_like(v)), start=start)


def _along_arc(
    x: FloatArray, y: FloatArray, heading: FloatArray, angle: FloatArray, moved: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pose after an arc of a length that turns by an angle."""
    # sin(z)/z of the half angle, which is below 0.5: the chord of the arc.
    z2 = (angle / 2) ** 2
    chord = moved * (1 - z2 / 6 * (1 - z2 / 20))
    middle = heading + angle / 2
    return x + chord * np.cos(middle), y + chord * np.sin(middle), heading + angle


def _lead(wanted: FloatArray, step: int, moved: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First and second derivative of wanted offsets (H + 1, n) in arc length, over one and two steps."""
    way = np.maximum(moved, SLOPE_SPEED * STEP_S)
    change = wanted[step + 1] - wanted[step]
    further = wanted[min(step + 2, len(wanted) - 1)] - wanted[step + 1]
    return change / way, (further - change) / way**2 if step + 2 < len(wanted) else np.zeros_like(way)


def _steer(
    bend: FloatArray,
    offset: FloatArray,
    error: FloatArray,
    v: FloatArray,
    moved: FloatArray,
    lead: tuple[FloatArray, FloatArray] | None = None,
) -> FloatArray:
    """New curvature error against the path after one step.

    With a wanted offset that changes with arc length, `offset` is what is left to it and `lead` its first and
    second derivative. Heading and curvature error then aim at those, which takes away the lag: in arc length
    the offset follows the wanted one through (3ωp² + 3ω²p + ω³)/(p + ω)³, which is 1 up to the second order.
    """
    omega = 1 / np.maximum(JOIN_LENGTH_M, JOIN_TIME_S * v)
    urgency = _urgency(error)
    most = _bend_limit(v, urgency)
    aim = -clipped(omega / 3 * offset, -JOIN_ANGLE_RAD, JOIN_ANGLE_RAD)
    if lead is None:
        wanted = clipped(omega * (aim - error), -most, most)
    else:
        aim = clipped(aim + lead[0], -JOIN_ANGLE_RAD, JOIN_ANGLE_RAD)
        wanted = clipped(omega * (aim - error) + lead[1], -most, most)
    rate = np.minimum(STEERING_RATE, urgency * JOIN_JERK / np.maximum(v * v, 1.0)) * STEP_S
    change = (3 * omega * moved) * (wanted - bend)
    return bend + clipped(change, -rate, rate)


def _urgency(error: FloatArray) -> FloatArray:
    """(n,) 1 to 2, by the heading error."""
    return clipped(np.abs(error) / JOIN_HEADING_RAD, 1.0, 2.0)


def _bend_limit(v: FloatArray, urgency: FloatArray) -> FloatArray:
    """(n,) largest curvature error against the path, 1/m."""
    return np.minimum(0.75 * CURVATURE_LIMIT, urgency * JOIN_ACCELERATION / np.maximum(v * v, 1.0))


def _centres(out: FloatArray, length: FloatArray) -> Plan:
    x, y, heading, speed = np.ascontiguousarray(out.transpose(0, 2, 1))
    ahead = (REAR_AXLE_SHARE * length)[:, None]
    return Plan(
        x=x + ahead * np.cos(heading), y=y + ahead * np.sin(heading), heading=wrap(heading), speed=speed
    )


@derived
def curve_speeds(paths: SeedPaths, lateral: float, deceleration: float) -> FloatArray:
    """(P * N,) highest speed along all paths, m/s, from which the driver comes through every curve ahead.

    √(lateral / curvature) in the curve; before it, what braking at `deceleration` brings down to that.
    """
    square = lateral / np.maximum(paths.curve_curvature, 1e-6)
    # v² may fall by 2·b·ds per sample: a running minimum of v² + 2·b·s from the far end.
    slope = 2 * deceleration * DS_M * np.arange(paths.samples)
    reachable = np.minimum.accumulate((square + slope)[:, ::-1], axis=1)[:, ::-1] - slope
    speeds: FloatArray = np.sqrt(reachable).ravel()
    return speeds
