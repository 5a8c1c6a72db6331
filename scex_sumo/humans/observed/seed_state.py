"""Seed state: heading and speed of each vehicle at the seed moment, estimated from the last second alone.

Recorded headings and speeds jitter: a driver that starts 8° off its course hits its neighbour. Drivers plan
from these estimates, which follow the course where positions are clean; tracks keep the recorded poses.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.driving.motion import REAR_AXLE_SHARE
from scex_sumo.behaviors.driving.paths import BEHIND_M, seed_paths
from scex_sumo.geometry.polylines import wrap
from scex_sumo.humans.guard.side_clearance import box_distances
from scex_sumo.road import Road
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SceneHistory, SeedScene

STANDING_MPS = 0.5
STEADY_RAD = np.deg2rad(2.0)  # scatter of headings at which their change counts by half
STEERING_RAD = np.deg2rad(1.0)  # error of a straight line through the headings of a second, without noise
OUTLIER_RAD = np.deg2rad(3.0)  # from that line
PEDAL_MPS, OUTLIER_MPS = 0.3, 2.0  # the last two for speeds
NEAR_M = 0.15  # distance of two boxes
BOX_RAD = np.deg2rad(2.0)  # error of the heading of a box
DRIFT_MPS, DRIFT_PER_S = 0.07, 16.0  # error of the speed across: constant, and over the scatter of positions
LARGEST_TURN_RAD = np.deg2rad(30.0)  # vehicles at a larger angle to their course roll back
_TIME = STEP_S * np.arange(-HISTORY_STEPS, 1)
_POWERS = np.vander(_TIME, 3, increasing=True)  # (11, 3) up to the second degree
_BASIS = np.linalg.qr(_POWERS)[0]  # the same, orthonormal over the last second


@owner_cache
def estimated_scene(scene: SeedScene, road: Road) -> SeedScene:
    """Return a scene with estimated headings of the last second, relative to the paths, and present speed."""
    past = scene.history
    stands = (past.speed.max(axis=1) < STANDING_MPS)[:, None]
    path, raw = _path_headings(scene, road), np.unwrap(past.heading, axis=1, period=np.pi)
    raw += (past.heading - raw)[:, -1:]  # boxes that were the wrong way round are turned
    path = np.where((_scatter(raw - path, 2) < _scatter(raw, 2))[:, None], path, 0.0)
    steady = 1 / (1 + (_scatter(raw - path) / STEADY_RAD) ** 2)
    smooth = path + _smoothed(raw - path, steady, STEERING_RAD, OUTLIER_RAD)
    smooth += _to_course(smooth[:, -1], scene)[:, None]
    turned = wrap(np.where(stands, np.median(raw, axis=1, keepdims=True), smooth))
    speed = past.speed.copy()
    present = _smoothed(speed, np.ones(len(speed)), PEDAL_MPS, OUTLIER_MPS)[:, -1]
    speed[:, -1] = np.where(stands[:, 0], speed[:, -1], np.maximum(present, 0.0))
    corrected = replace(scene, history=replace(past, heading=turned, speed=speed))
    # A correction shall not bring long vehicles nearer that almost touch.
    after, before = box_distances(corrected), box_distances(scene)
    touch = ((after < NEAR_M) & (after < before)).any(axis=1, keepdims=True)
    turned = wrap(np.where(touch, turned + past.heading[:, -1:] - turned[:, -1:], turned))
    return replace(scene, history=replace(past, heading=turned, speed=speed))


def estimated_history(history: SceneHistory, road: Road) -> SceneHistory:
    """Return a history whose seed scene, and whose states up to the seed moment, are estimated."""
    scene, old = estimated_scene(history.scene, road), HISTORY_STEPS + 1 - history.step
    states = history.states
    if old > 0:
        states = states.map(np.copy)
        states.assign((slice(None), slice(None), slice(0, old)), scene.history[None, :, -old:])
    return replace(history, scene=scene, states=states)


def _to_course(heading: FloatArray, scene: SeedScene) -> FloatArray:
    """(V,) turns from the present headings (V,) towards the course of the rear axles, rad.

    The course is that of polynomials of the second degree through the positions of the last second. It
    counts the more, the less positions scatter and the faster the vehicle is.
    """
    past, fit = scene.history, np.linalg.pinv(_POWERS)
    (_, vx, ax), (_, vy, ay) = fit @ past.x.T, fit @ past.y.T
    speed = np.maximum(np.hypot(vx, vy), STANDING_MPS)
    slip = np.arctan(REAR_AXLE_SHARE * scene.length * 2 * (vx * ay - vy * ax) / speed**3)
    scatter = np.hypot(_scatter(past.x), _scatter(past.y))
    error = ((DRIFT_MPS + DRIFT_PER_S * scatter) / speed) ** 2
    share = BOX_RAD**2 / (BOX_RAD**2 + error)
    turn: FloatArray = share * wrap(np.arctan2(vy, vx) - slip - heading)
    return np.where(np.abs(turn) < LARGEST_TURN_RAD, turn, 0.0)


def _path_headings(scene: SeedScene, road: Road) -> FloatArray:
    """(V, 11) headings of the straightest paths beside the vehicles in the last second, rad, unwrapped."""
    paths, past = seed_paths(scene, road), scene.history
    row, steps = np.repeat(paths.first + paths.straight, past.shape[1]), past.map(np.ravel)
    distance_m = np.repeat(np.maximum(scene.now.speed, 0.0), past.shape[1]) * np.tile(_TIME, scene.vehicles)
    return paths.foot_points(row, steps.x, steps.y, BEHIND_M + distance_m)[2].reshape(past.shape)


def _smoothed(values: FloatArray, steady: FloatArray, usual: float, outlier: float) -> FloatArray:
    """(V, 11) values drawn towards a straight line by their white noise.

    ``steady``: (V,) trust in its slope; ``usual``: deviation without noise; ``outlier``: larger ones are
    errors.
    """
    time = _TIME - _TIME.mean()
    line = values.mean(axis=1, keepdims=True) + (steady * (values @ time) / (time @ time))[:, None] * time
    noise = np.median(np.abs(np.diff(values, n=2, axis=1)), axis=1, keepdims=True) / (0.6745 * np.sqrt(6.0))
    return np.asarray(line + np.clip(values - line, -outlier, outlier) / (1 + (noise / usual) ** 2))


def _scatter(values: FloatArray, terms: int = 3) -> FloatArray:
    """(V,) standard deviation of values (V, 11) from a polynomial with so many terms."""
    basis = _BASIS[:, :terms]
    left = values - (values @ basis) @ basis.T
    return np.asarray(np.sqrt((left**2).sum(axis=1) / (values.shape[1] - terms)))
