"""People of scenes without tracks: on footways and crossings, beside lanes, as cyclists at their edges."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import UsageError
from scex_sumo.converters.tracks.road_users import obstacle_size
from scex_sumo.geometry.polylines import arc_lengths, join, length_of, samples
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.road import Lane, Road
from scex_sumo.scene import HISTORY_STEPS, STEP_S, Obstacles, SeedScene, States

MAX_PEOPLE: Final = 500
KINDS: Final = ("pedestrian", "pedestrian", "pedestrian", "bicycle")
SPEEDS_MPS: Final = {"pedestrian": (1.34, 0.26, 0.5, 2.2), "bicycle": (5.0, 1.0, 2.5, 7.5)}
"""Mean, standard deviation and limits: of people on foot Weidmann 1993; of cyclists chosen."""
FOOTWAYS: Final = 0.7
"""Share of the pedestrians that is on footways and crossings if the map has some."""

_STEPS = 100  # of the future
_CHECKED_STEPS = 30  # in which people and vehicles do not touch
_CLEAR_M = 0.3
_FAST_MPS = 70 / 3.6  # nobody walks beside lanes with a higher limit
_WAY_M = 80.0
_MIN_LENGTH_M = 6.0  # of a way
_SAMPLE_M = 0.5
_BESIDE_M, _EDGE_M = 0.9, 0.6  # from the right bound, outside of the lane and inside
_TRIES = 50  # a person


def add_people(scene: SeedScene, people: int, *, seed: int = 0) -> SeedScene:
    """Return a scene with people at constant speeds, which touch no vehicle in the last 1 and the next 3 s.

    A note says how many found no place.

    Raises:
        UsageError: a number below 0 or above `MAX_PEOPLE`.
    """
    if not 0 <= people <= MAX_PEOPLE:
        raise UsageError(f"--people: got {people}, needs 0 to {MAX_PEOPLE}")
    if not people:
        return scene
    assert scene.road is not None
    rng, ways = np.random.default_rng([seed, people, scene.vehicles]), _Ways(scene.road)
    motion, length, width = _motion(scene), scene.length, scene.width
    kinds, placed = list[str](), list[States]()
    for k in range(people):
        kind = KINDS[k % len(KINDS)]
        for _ in range(_TRIES if ways.any else 0):
            one = _moving(ways.drawn(kind, rng), kind, rng)
            if one is not None and _free(one, kind, motion, length, width):
                size = obstacle_size(kind)
                motion = States.concatenate([motion, one[None]], axis=0)
                length, width = np.append(length, size[0]), np.append(width, size[1])
                kinds.append(kind)
                placed.append(one)
                break
    name, notes = f"{scene.name}_people{people}", scene.notes
    if len(placed) < people:
        slow = f"nobody walks beside motorways and lanes with a limit above {_FAST_MPS * 3.6:.0f} km/h"
        notes = (*notes, f"the map has a place for {len(placed)} of {people} people; {slow}")
    if not placed:
        return replace(scene, name=name, notes=notes)
    sizes = np.array([obstacle_size(kind) for kind in kinds])
    obstacles = Obstacles(
        ids=tuple(f"P{k + 1}" for k in range(len(kinds))),
        types=tuple(kinds),
        length=sizes[:, 0],
        width=sizes[:, 1],
        states=States.stack(placed, axis=0),
        present=np.ones((len(kinds), HISTORY_STEPS + 1 + _STEPS), dtype=np.bool_),
    )
    return replace(scene, name=name, notes=notes, obstacles=obstacles)


class _Ways:
    """Ways of people on a road, drawn one at a time."""

    def __init__(self, road: Road) -> None:
        self._lanes = road.lanes
        self._slow = [lane for lane in road.vehicle_lanes.values() if lane.beside[1] is None and _slow(lane)]
        self._walks = [lane for lane in road.lanes.values() if lane.kind == "pedestrian"]
        self._paths = [lane for lane in road.lanes.values() if lane.kind == "bicycle"]
        rings = [lane.outline for lane in road.vehicle_lanes.values()]
        self._area = shapely.STRtree([shapely.polygons(ring).buffer(0.0) for ring in rings])
        self.any = bool(self._slow or self._walks or self._paths)

    def drawn(self, kind: str, rng: np.random.Generator) -> FloatArray | None:
        """Return a way (N, 2); None if this draw has none."""
        walks = kind == "pedestrian"
        mapped = self._walks if walks else self._paths
        if mapped and (not self._slow or rng.random() < FOOTWAYS):
            line = self._chain(_one(mapped, rng), rng, 0.0)
        elif not self._slow:
            return None
        else:
            line = self._chain(_one(self._slow, rng), rng, _BESIDE_M if walks else -_EDGE_M)
            line = self._off_lanes(line) if walks else line
        if length_of(line) < _MIN_LENGTH_M:
            return None
        return line[::-1] if walks and rng.random() < 0.5 else line

    def _chain(self, lane: Lane, rng: np.random.Generator, aside: float) -> FloatArray:
        """Return the line of a lane and lanes after it; so far to the right of the right bound unless 0."""
        parts, length = list[FloatArray](), 0.0
        while length < _WAY_M:
            parts.append(lane.right_bound if aside else lane.centreline)
            length += length_of(parts[-1])
            after = [self._lanes[k] for k in lane.successors if self._lanes[k].kind == lane.kind]
            if not after:
                break
            lane = _one(after, rng)
        line = samples(join(parts), _SAMPLE_M)[1]
        step = np.gradient(line, axis=0)
        right = np.stack([step[:, 1], -step[:, 0]], axis=1) / np.hypot(*step.T).clip(1e-9)[:, None]
        return np.asarray(line + aside * right)

    def _off_lanes(self, line: FloatArray) -> FloatArray:
        """Return the part of a line before it first comes to a lane for vehicles, or its begin."""
        inside = np.zeros(len(line), dtype=np.bool_)
        inside[self._area.query(shapely.points(line), predicate="intersects")[0]] = True
        end = int(np.argmax(inside)) if inside.any() else len(line)
        return line[: max(end, 1)]


def _slow(lane: Lane) -> bool:
    return lane.subtype != "highway" and lane.speed_limit_mps <= _FAST_MPS


def _one(lanes: list[Lane], rng: np.random.Generator) -> Lane:
    """Draw a lane, long ones more often."""
    ends = np.cumsum([length_of(lane.centreline) for lane in lanes])
    return lanes[int(np.searchsorted(ends, rng.random() * ends[-1]))]


def _moving(line: FloatArray | None, kind: str, rng: np.random.Generator) -> States | None:
    """Return (11 + F,) states along a way at a drawn speed; those at its end stand."""
    if line is None:
        return None
    mean, spread, low, high = SPEEDS_MPS[kind]
    speed = float(np.clip(rng.normal(mean, spread), low, high))
    arc = arc_lengths(line)
    room = arc[-1] - speed * STEP_S * (HISTORY_STEPS + _CHECKED_STEPS)
    if room <= 0:
        return None
    s = rng.random() * room + speed * STEP_S * np.arange(HISTORY_STEPS + 1 + _STEPS)
    x, y = (np.interp(s, arc, line[:, axis]) for axis in (0, 1))
    ahead, behind = np.minimum(s, arc[-1]) + 0.5, np.minimum(s, arc[-1]) - 0.5
    dx, dy = (np.interp(ahead, arc, line[:, k]) - np.interp(behind, arc, line[:, k]) for k in (0, 1))
    return States(x=x, y=y, heading=np.arctan2(dy, dx), speed=np.where(s < arc[-1], speed, 0.0))


def _motion(scene: SeedScene) -> States:
    """Return (V, 11 + F) recorded states of vehicles; without a future they go straight on."""
    travelled_m = scene.now.speed[:, None] * (STEP_S * np.arange(1, _STEPS + 1))
    later = scene.now.ahead(travelled_m, np.repeat(scene.now.speed[:, None], _STEPS, axis=1))
    return States.concatenate([scene.history, later if scene.future is None else scene.future], axis=1)


def _free(one: States, kind: str, others: States, length: FloatArray, width: FloatArray) -> bool:
    steps = slice(0, HISTORY_STEPS + 1 + _CHECKED_STEPS, 2)
    own = Rectangles.of(one[None, steps], *(np.full((1, 1), side) for side in obstacle_size(kind)))
    boxes = Rectangles.of(others[:, steps], length[:, None], width[:, None])
    return bool((rectangle_distance(own, boxes) > _CLEAR_M).all())
