"""Vehicles of recorded seed scenes on the paths that they took: what likely_driver is fitted to."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from calibrate import AHEAD, OFF_PATH_M, path_taken, present

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.driving.motion import rear_axle
from scex_sumo.behaviors.driving.paths import DS_M, FIRST_HORIZON_S, SeedPaths, expected_way, seed_paths
from scex_sumo.humans.lines.driven_line import redrawn
from scex_sumo.humans.lines.lanes import lanes_beside, lanes_occupied
from scex_sumo.humans.observed.observations import (
    View,
    behind_a_wave,
    last_second,
    leaders_of,
    observations_of,
    queue_leaders,
)
from scex_sumo.humans.observed.seed_state import estimated_scene
from scex_sumo.humans.parameters import HumanParameters, human_parameters
from scex_sumo.scene import STEP_S, SeedScene, VehicleIndex

HUMAN = human_parameters()  # what is fitted here is not read from it
STEPS = 30
OFF_ROAD_M = 5.0  # who is further from all its paths took none of them, nor a lane beside


def headways(shown: FloatArray, known: HumanParameters, draw: FloatArray) -> FloatArray:
    """(n,) s, as `LikelyDriver` draws them, by the headways shown (n,) and normal numbers (n,)."""
    headway = np.exp(known.headway_log[0] + known.headway_log[1] * draw)
    return np.asarray(np.minimum(np.minimum(headway, known.most_headway_s), shown))


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """n vehicles on the paths that they took.

    Attributes:
        speed: (n,) in the seed scene, m/s.
        acceleration: (n,) there, m/s².
        trust: (n,) see `LastSecond`; so ``sudden``.
        gap: (n, 31) to the leader if the vehicle stood where it is, now and after each step, m.
        leader_speed: (n, 31) m/s.
        headway: (n,) shown, s, as in `PathObservations`; so the next four.
        lateral: (n, 3).
        bends: (n, 2).
        room: (n, 2, 2).
        mean_features: (n, F).
        spread_features: (n, 3).
        limit: (n, AHEAD) m/s.
        curves: (n, AHEAD) speed that the curves ahead allow, m/s.
        way: (n, 30) that the vehicle really made, m.
        wave: (n,) see `behind_a_wave`.
        beside: (n, 2) see `lanes_beside`.
        occupied: (n, 2) see `lanes_occupied`.
        off: (n,) how far from its path the vehicle was at most, m.
        side: (n,) offset of its rear axle from the path after 3 s, m.
    """

    speed: FloatArray
    acceleration: FloatArray
    trust: FloatArray
    sudden: FloatArray
    gap: FloatArray
    leader_speed: FloatArray
    headway: FloatArray
    lateral: FloatArray
    bends: FloatArray
    room: FloatArray
    mean_features: FloatArray
    spread_features: FloatArray
    limit: FloatArray
    curves: FloatArray
    way: FloatArray
    wave: BoolArray
    beside: FloatArray
    occupied: BoolArray
    off: FloatArray
    side: FloatArray

    @classmethod
    def joined(cls, parts: Sequence[Samples]) -> Samples:
        names = [f.name for f in dataclasses.fields(cls)]
        return cls(**{name: np.concatenate([getattr(p, name) for p in parts]) for name in names})

    def part(self, chosen: IntArray | BoolArray) -> Samples:
        return Samples(**{f.name: getattr(self, f.name)[chosen] for f in dataclasses.fields(self)})


def samples_of(scene: SeedScene) -> Samples | None:
    """Vehicles with 3 s of recorded future on one of their paths."""
    assert scene.road is not None
    scene = estimated_scene(scene, scene.road)
    assert scene.road is not None and scene.future is not None and scene.future_valid is not None
    if scene.future_valid.shape[1] < STEPS:
        return None
    vehicle = np.flatnonzero(scene.future_valid[:, :STEPS].all(axis=1) & (scene.recorded_steps >= 5))
    if not len(vehicle):
        return None
    paths = seed_paths(scene, scene.road, FIRST_HORIZON_S, redrawn)
    row, off = path_taken(scene, paths, vehicle)
    good = (off <= OFF_ROAD_M) & paths.on_road[vehicle]
    vehicle, row, off = vehicle[good], row[good], off[good]
    if not len(vehicle):
        return None
    history, vehicles = present(scene), VehicleIndex(future=np.zeros_like(vehicle), vehicle=vehicle)
    now, future, seen = scene.now[vehicle], scene.future[vehicle], observations_of(scene, paths, HUMAN)
    s, _, _ = paths.foot_points(row, now.x, now.y, expected_way(history, vehicles))
    view = View(history=history, vehicles=vehicles, paths=paths, row=row, s=s, human=HUMAN)
    leaders = leaders_of(view, seen.lateral[row, 0])
    gap, leader_speed = _leader_ways(scene, paths, row, s, leaders.index, leaders.gap, leaders.speed)
    ways = [
        paths.foot_points(row, future.x[:, k], future.y[:, k], s + now.speed * (k + 1) * STEP_S)[0] - s
        for k in range(STEPS)
    ]
    at = np.clip((s / DS_M).astype(np.int64)[:, None] + np.arange(AHEAD), 0, paths.samples - 1)
    curvature = paths.curve_curvature[row[:, None], at]
    square = HUMAN.idm.curve_acceleration / np.maximum(curvature, 1e-6)
    slope = 2 * HUMAN.idm.curve_deceleration * DS_M * np.arange(AHEAD)
    curves = np.sqrt(np.minimum.accumulate((square + slope)[:, ::-1], axis=1)[:, ::-1] - slope)
    x, y = rear_axle(future[:, STEPS - 1], scene.length[vehicle])
    _, side, _ = paths.foot_points(row, x, y, s + ways[-1])
    shown = last_second(scene, HUMAN)
    return Samples(
        speed=shown.speed[vehicle],
        acceleration=shown.acceleration[vehicle],
        trust=shown.trust[vehicle],
        sudden=shown.sudden[vehicle],
        gap=gap,
        leader_speed=leader_speed,
        headway=seen.headway[row],
        lateral=seen.lateral[row],
        bends=seen.bends[row],
        room=seen.room[row],
        mean_features=seen.mean_features[row],
        spread_features=seen.spread_features[row],
        limit=paths.speed_limit[row[:, None], at],
        curves=curves,
        way=np.stack(ways, axis=1),
        wave=behind_a_wave(
            scene.now.speed[None], leaders, vehicles.future, queue_leaders(scene, paths, HUMAN), HUMAN
        ),
        beside=lanes_beside(scene, scene.road, paths, HUMAN)[row],
        occupied=lanes_occupied(scene, HUMAN)[vehicle],
        off=off,
        side=side,
    )


def joined(scenes: Iterable[SeedScene]) -> Samples:
    """The vehicles of seed scenes together."""
    return Samples.joined([found for found in map(samples_of, scenes) if found is not None])


def kept(samples: Samples) -> Samples:
    """Those of them who stayed near their path."""
    return samples.part(samples.off <= OFF_PATH_M)


def weighted(parts: Sequence[Samples]) -> tuple[Samples, FloatArray]:
    """Samples together, and the weight of each: a part counts as the square root of its number."""
    count = np.array([len(part.speed) for part in parts])
    return Samples.joined(parts), np.repeat(1 / np.sqrt(np.maximum(count, 1)), count)


def _leader_ways(
    scene: SeedScene,
    paths: SeedPaths,
    row: IntArray,
    s: FloatArray,
    index: IntArray,
    gap: FloatArray,
    speed: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """(n, 31) gap to where the leader really was after each step, and its speed; constant if unrecorded."""
    assert scene.future is not None and scene.future_valid is not None
    time = STEP_S * np.arange(STEPS + 1)
    gaps, speeds = gap[:, None] + speed[:, None] * time, np.repeat(speed[:, None], STEPS + 1, axis=1)
    known = np.flatnonzero((index >= 0) & (index < scene.vehicles))
    known = known[scene.future_valid[index[known], :STEPS].all(axis=1)]
    if len(known):
        leader = scene.future[index[known]]
        first = scene.now[index[known]]
        start = paths.foot_points(row[known], first.x, first.y, s[known] + np.minimum(gap[known], 100.0))[0]
        for k in range(STEPS):
            guess = start + speed[known] * time[k + 1]
            there = paths.foot_points(row[known], leader.x[:, k], leader.y[:, k], guess)[0]
            gaps[known, k + 1] = gap[known] + there - start
        speeds[known, 1:] = leader.speed[:, :STEPS]
    return gaps, speeds
