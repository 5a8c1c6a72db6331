"""What a seed scene shows of its drivers: what `LikelyDriver` conditions its draws on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.behaviors.driving.leaders import Leaders, find_leaders
from scex_sumo.behaviors.driving.motion import rear_axle
from scex_sumo.behaviors.driving.paths import BEHIND_M, DS_M, SeedPaths
from scex_sumo.behaviors.driving.projection import project
from scex_sumo.behaviors.models.idm import (
    CALIBRATED,
    CURVE_TIME_S,
    IdmParameters,
    curve_speeds,
    idm_acceleration,
    seed_motion,
)
from scex_sumo.behaviors.models.population import FAR_M, MOST_ASIDE_M, Population
from scex_sumo.derived import derived
from scex_sumo.geometry.polylines import wrap
from scex_sumo.scene import SceneHistory, SeedScene, Who

STANDING_MPS = 0.5
QUEUE_M = 15.0  # a leader nearer than this holds a standing vehicle


def queue_place(gap_m: FloatArray, leader_speed_mps: FloatArray) -> IntArray:
    """(n,) 0 behind a standing leader, 1 behind one that moves, 2 where no leader is near."""
    near = gap_m < QUEUE_M
    return np.where(near, np.where(np.abs(leader_speed_mps) < STANDING_MPS, 0, 1), 2)


def leaders_of(history: SceneHistory, who: Who, paths: SeedPaths, row: IntArray, s: FloatArray) -> Leaders:
    """Leaders along paths, as ``calibrated_driver`` sees them; see `find_leaders`."""
    return find_leaders(
        history,
        who,
        paths,
        row,
        s,
        clearance=CALIBRATED.clearance,
        radius=CALIBRATED.radius,
        obstacle_clearance=CALIBRATED.obstacle_clearance,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """What the seed scene shows, by vehicle (V,) or by path (P,).

    Attributes:
        speed: (V,) m/s.
        headway: (P,) time headway to the leader on that path, s; inf without one.
        offset: (P,) of the rear axle from the path, left positive, m, within `MOST_ASIDE_M`.
        features: (P, 4) see `scex_sumo.behaviors.models.population.FEATURES`.
    """

    speed: FloatArray
    headway: FloatArray
    offset: FloatArray
    features: FloatArray


def asked_acceleration(
    profile: IdmParameters,
    speed: FloatArray,
    desired_speed: FloatArray,
    gap: FloatArray,
    leader_speed: FloatArray,
    curve_speed: FloatArray,
) -> FloatArray:
    """(n,) acceleration that the situation asks of a driver: the least of free road, leader and curve.

    The sum of the first two, as in the Intelligent Driver Model, makes who keeps to its speed behind a leader
    fall back from it; people keep their distance.

    Args:
        profile: the drivers.
        speed: (n,) m/s.
        desired_speed: (n,) m/s.
        gap: (n,) to the leader, bumper to bumper, m.
        leader_speed: (n,) m/s along the path.
        curve_speed: (n,) what the curves ahead allow where the vehicle will be in a moment, m/s.

    Source: the least of both, Treiber and Kesting 2013, section 11.3.
    """
    free = idm_acceleration(profile, speed, desired_speed, np.full_like(gap, np.inf), leader_speed)
    following = idm_acceleration(profile, speed, np.full_like(gap, np.inf), gap, leader_speed)
    slowing = np.maximum((curve_speed - speed) / CURVE_TIME_S, -profile.comfort_deceleration)
    return np.minimum(np.minimum(free, following), slowing)


def features_of(acceleration: FloatArray, following: FloatArray, opening: FloatArray) -> FloatArray:
    """(n, 4) `FEATURES` of the population.

    Args:
        acceleration: (n,) over the last half second, m/s².
        following: (n,) what the Intelligent Driver Model does for the leader alone, m/s².
        opening: (n,) speed difference to the leader, m/s; 0 where none is near.
    """
    limits = ((acceleration, -4.0, 4.0), (following, -4.0, 0.5), (opening, -8.0, 8.0))
    return np.column_stack([np.ones_like(acceleration), *(np.clip(*values) for values in limits)])


@derived
def seen_of(scene: SeedScene, paths: SeedPaths) -> Seen:
    """What a seed scene shows of every vehicle along each of its paths."""
    history = SceneHistory.of_scene(scene)
    vehicle = np.repeat(np.arange(scene.vehicles), paths.count)
    row = np.arange(len(vehicle))
    who = Who(child=np.zeros_like(vehicle), vehicle=vehicle)
    now = scene.now[vehicle]
    s, _, _ = project(paths, row, now.x, now.y, np.full(len(row), BEHIND_M))
    leaders = leaders_of(history, who, paths, row, s)
    speed, acceleration = seed_motion(history, who)
    following = idm_acceleration(CALIBRATED, speed, np.full_like(speed, np.inf), leaders.gap, leaders.speed)
    x, y = rear_axle(now, scene.length[vehicle])
    _, offset, _ = project(paths, row, x, y, np.full(len(row), BEHIND_M))
    opening = np.where(leaders.gap < FAR_M, leaders.speed - speed, 0.0)
    return Seen(
        speed=np.maximum(scene.now.speed, 0.0),
        headway=leaders.gap / np.maximum(speed, 1.0),
        offset=np.clip(offset, -MOST_ASIDE_M, MOST_ASIDE_M),
        features=features_of(acceleration, following, opening),
    )


def path_features(scene: SeedScene, paths: SeedPaths) -> FloatArray:
    """(P, 4) how each path fits what the seed scene shows of its vehicle.

    Speed above that from which the path's curves are comfortable, m/s; offset of the centre, m; heading off
    the path, rad; and 1 where it is not the straight one.
    """
    vehicle = np.repeat(np.arange(scene.vehicles), paths.count)
    row = np.arange(len(vehicle))
    now = scene.now[vehicle]
    s, offset, heading = project(paths, row, now.x, now.y, np.full(len(row), BEHIND_M))
    calm = curve_speeds(paths, CALIBRATED.curve_acceleration, CALIBRATED.curve_deceleration)
    at = row * paths.samples + np.clip(s / DS_M, 0, paths.samples - 1).astype(np.int64)
    excess = np.maximum(now.speed - calm[at], 0.0)
    across = np.abs(wrap(now.heading - heading))
    other = row != paths.first[vehicle] + paths.straight[vehicle]
    return np.column_stack([excess, np.abs(offset), across, other.astype(np.float64)])


@derived
def path_edges(scene: SeedScene, paths: SeedPaths, known: Population) -> FloatArray:
    """(P,) upper edge in [0, 1] of each path's share of a vehicle's draw."""
    share = np.diff(paths.draw_edges, prepend=0.0)
    share[paths.first] = paths.draw_edges[paths.first]
    weight = np.maximum(share, 1e-9) * np.exp(-path_features(scene, paths) @ known.path) + 1e-12
    edges = np.empty_like(weight)
    for first, count in zip(paths.first, paths.count, strict=True):
        part = slice(first, first + count)
        edges[part] = np.cumsum(weight[part]) / weight[part].sum()
    return edges


