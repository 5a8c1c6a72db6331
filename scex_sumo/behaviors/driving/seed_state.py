"""Seed state: heading and speed of each vehicle at the seed moment, estimated from the last second alone.

Recorded headings and speeds jitter: a driver that starts 8° off its course hits its neighbour. Drivers plan
from these estimates; tracks keep the recorded poses.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.cache import owner_cache
from scex_sumo.behaviors.driving.beside import box_distances
from scex_sumo.behaviors.driving.motion import rear_axle
from scex_sumo.geometry.polylines import wrap
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SceneHistory, SeedScene

STANDING_MPS = 0.5
COURSE_MPS = 3.0  # slower vehicles show no course
# A course further off the heading is an error of positions, or reverse driving.
MAX_OFF_RAD = np.deg2rad(45.0)
STEADY_RAD = np.deg2rad(0.7)  # noise of headings at which their change counts by half
SHARP_RAD = np.deg2rad(1.0)  # noise of the course at which it counts by half against the box
COURSE_SHARE = 0.4  # weight of a noisy course against the box
NEAR_M = 0.15  # distance of two boxes
PEDAL_MPS = 0.3  # error of a straight line through the speeds of a second, without noise
OUTLIER_MPS = 2.0  # from that line
_HALF = HISTORY_STEPS // 2
_TIME = STEP_S * np.arange(-HISTORY_STEPS, 1)
# (11, 3) polynomials up to the second degree, orthonormal over the last second.
_BASIS = np.linalg.qr(np.vander(_TIME, 3, increasing=True))[0]


@owner_cache
def estimated_scene(scene: SeedScene) -> SeedScene:
    """Return a seed scene with the estimated headings of the last second and the estimated present speed."""
    past = scene.history
    raw = np.unwrap(past.heading, axis=1)
    mean, slope = _line(raw)
    steady = 1 / (1 + (_scatter(raw) / STEADY_RAD) ** 2)
    boxes = mean - steady * slope * _TIME.mean()
    line = mean[:, None] + slope[:, None] * (_TIME - _TIME.mean())
    heading = boxes + _course_error(scene, boxes, line, slope)
    stands = past.speed.max(axis=1) < STANDING_MPS
    heading = np.where(stands, np.median(raw, axis=1), heading)
    steady = np.where(stands, 0.0, steady)[:, None]
    turned = steady * (raw - raw[:, -1:] + (1 - steady) * slope[:, None] * _TIME)
    speed = past.speed.copy()
    speed[:, -1] = np.where(stands, speed[:, -1], _present_speed(speed))
    turned = wrap(heading[:, None] + turned)
    corrected = replace(scene, history=replace(past, heading=turned, speed=speed))
    # A correction shall not bring long vehicles nearer that almost touch.
    after, before = box_distances(corrected), box_distances(scene)
    touch = ((after < NEAR_M) & (after < before)).any(axis=1, keepdims=True)
    turned = np.where(touch, past.heading, turned)
    return replace(scene, history=replace(past, heading=turned, speed=speed))


def estimated_history(history: SceneHistory) -> SceneHistory:
    """Return a history whose seed scene, and whose states up to the seed moment, are estimated."""
    scene, old = estimated_scene(history.scene), HISTORY_STEPS + 1 - history.step
    states = history.states
    if old > 0:
        states = states.map(np.copy)
        states.assign((slice(None), slice(None), slice(0, old)), scene.history[None, :, -old:])
    return replace(history, scene=scene, states=states)


def _course_error(scene: SeedScene, heading: FloatArray, line: FloatArray, slope: FloatArray) -> FloatArray:
    """(V,) correction of headings, rad, by the course of the rear axle, which does not slip.

    Args:
        heading: (V,) by the boxes, rad.
        line: (V, 11) straight line through the headings, rad: jitter would shift the axle.
        slope: (V,) yaw rate, rad/s.
    """
    past = scene.history
    x, y = rear_axle(replace(past, heading=line), scene.length[:, None])
    speed = past.speed[:, -1]
    noise = np.hypot(_scatter(x), _scatter(y)) / np.sqrt(2)
    # Of a clean recording the last half second is best, else the whole one.
    late = np.arctan2(y[:, -1] - y[:, _HALF], x[:, -1] - x[:, _HALF]) - slope * _TIME[_HALF] / 2
    whole = np.arctan2(_line(y)[1], _line(x)[1]) - slope * _TIME.mean() / 2
    sharp = 1 / (1 + (np.sqrt(2) * noise / (-_TIME[_HALF] * np.maximum(speed, COURSE_MPS) * SHARP_RAD)) ** 2)
    off = sharp * wrap(late - heading) + (1 - sharp) * COURSE_SHARE * wrap(whole - heading)
    return np.where((speed > COURSE_MPS) & (np.abs(off) < MAX_OFF_RAD), off, 0.0)


def _present_speed(speed: FloatArray) -> FloatArray:
    """(V,) present speed, m/s: the recorded one, drawn towards a straight line by its white noise."""
    mean, slope = _line(speed)
    line = mean - slope * _TIME.mean()
    noise = np.median(np.abs(np.diff(speed, n=2, axis=1)), axis=1) / (0.6745 * np.sqrt(6.0))
    off = np.clip(speed[:, -1] - line, -OUTLIER_MPS, OUTLIER_MPS)
    present: FloatArray = np.maximum(line + off / (1 + (noise / PEDAL_MPS) ** 2), 0.0)
    return present


def _line(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean (V,) and the slope (V,) 1/s of values (V, 11) of the last second."""
    time = _TIME - _TIME.mean()
    slope: FloatArray = values @ time / (time @ time)
    return values.mean(axis=1), slope


def _scatter(values: FloatArray) -> FloatArray:
    """(V,) standard deviation of values (V, 11) from a parabola."""
    left = values - (values @ _BASIS) @ _BASIS.T
    scatter: FloatArray = np.sqrt((left**2).sum(axis=1) / (values.shape[1] - _BASIS.shape[1]))
    return scatter
