"""Predictor inputs: last second of a vehicle and its neighbours, and the lanes, in the vehicle's frame.

Origin: the vehicle's present centre; x ahead, y to the left; angles relative to its heading.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.base import check_positive
from scex_sumo.converters.tracks.road_users import MOTOR_TYPES, obstacle_kinds, road_user
from scex_sumo.geometry.polylines import along, length_of
from scex_sumo.geometry.rectangles import seen_from
from scex_sumo.road import Road
from scex_sumo.scene import HISTORY_STEPS, REPLAYED, SceneHistory, States, VehicleIndex

ARRAYS: Final = (
    *("history", "size", "kind", "neighbours", "neighbour_size", "neighbour_kind", "neighbour_mask"),
    *("lanes", "lane_limit", "lane_mask"),
)
"""Inputs with one row per vehicle; see `predictor_inputs`."""

KINDS: Final = ("car", "truck", "motorcycle", "bicycle", "pedestrian", "other")
_KIND_OF = {"van": "car", "bus": "truck", "tram": "other"}  # where a `road_user` is none of them
_VEHICLES = MOTOR_TYPES | {"parked", REPLAYED}


@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """Amount of traffic and road that a predictor sees.

    Attributes:
        neighbours: K, number of nearest others.
        radius: perception radius, m.
        lanes: L, number of nearest centreline pieces.
        points: P, of each piece.
        spacing: largest distance between the points of a piece, m.

    Example:
        >>> scex.Surroundings(neighbours=4).radius
        50.0
    """

    neighbours: int = 16
    radius: float = 50.0
    lanes: int = 32
    points: int = 10
    spacing: float = 2.0

    def __post_init__(self) -> None:
        check_positive(self, "neighbours", "radius", "lanes", "points", "spacing")
        if self.points < 2:
            raise UsageError(f"points: got {self.points}, needs at least 2, the ends of a piece")


def predictor_inputs(
    history: SceneHistory,
    road: Road,
    vehicles: VehicleIndex,
    surroundings: Surroundings,
    names: Collection[str] = ARRAYS,
    *,
    step: IntArray | None = None,
) -> dict[str, NDArray[Any]]:
    """Return the named input arrays of n vehicles.

    ``history`` (n, 11, 5): x and y (m), cos and sin of the heading, speed (m/s); oldest first, now last.
    ``size`` (n, 2): length and width, m. ``kind`` (n,): index into `KINDS`.
    ``neighbours`` (n, K, 11, 5), ``neighbour_size`` (n, K, 2), ``neighbour_kind`` (n, K): the same of
    vehicles, pedestrians and cyclists within the radius, nearest first.
    ``lanes`` (n, L, P, 2): centreline pieces in driving direction, nearest middle first, m.
    ``lane_limit`` (n, L): speed limits, m/s.
    ``neighbour_mask`` (n, K) and ``lane_mask`` (n, L): False for unused rows, which are zero.

    Args:
        step: (n,) steps since the seed scene; None for the history's.
    """
    scene = history.scene
    past = history.states[vehicles.future, vehicles.vehicle]
    now = past[:, -1]
    kinds = _kinds(scene.types)
    inputs: dict[str, NDArray[Any]] = {"history": seen_from(now, past), "kind": kinds[vehicles.vehicle]}
    inputs["size"] = np.stack([scene.length, scene.width], axis=-1)[vehicles.vehicle]
    if any(name.startswith("neighbour") for name in names):
        steps = np.full(len(vehicles), history.step) if step is None else step
        inputs |= _others(history, vehicles, now, surroundings, kinds, steps)
    if any(name.startswith("lane") for name in names):
        inputs |= _lanes(road, now, surroundings)
    return {name: inputs[name] for name in names}


def _kinds(types: Sequence[str], unknown: str = "car") -> IntArray:
    """Return the indices into `KINDS` of recorded types, e.g. ``truck_bus``."""
    return np.array([_kind(word.lower(), unknown) for word in types], dtype=np.int64)


@cache
def _kind(word: str, unknown: str) -> int:
    user = road_user(word)
    if user == "car" and word not in _VEHICLES:  # `road_user` takes all other words for cars
        user = unknown
    return KINDS.index(_KIND_OF.get(user, user))


def _others(
    history: SceneHistory,
    vehicles: VehicleIndex,
    now: States,
    surroundings: Surroundings,
    kinds: IntArray,
    step: IntArray,
) -> dict[str, NDArray[Any]]:
    scene, states, obstacles = history.scene, history.states, history.scene.obstacles
    size = np.stack([scene.length, scene.width], axis=-1)
    distance = _apart(now, history.now[vehicles.future])
    distance[np.arange(len(vehicles)), vehicles.vehicle] = np.inf
    if obstacles is not None:
        # Obstacles are replayed: their past is the recorded one.
        steps = np.minimum(step[:, None] + np.arange(HISTORY_STEPS + 1), obstacles.states.shape[1] - 1)
        there = obstacles.present[:, steps[:, -1]].T
        further = np.where(there, _apart(now, obstacles.states[:, steps[:, -1]].swapaxes(0, 1)), np.inf)
        distance = np.concatenate([distance, further], axis=1)
        size = np.concatenate([size, np.stack([obstacles.length, obstacles.width], axis=-1)])
        kinds = np.concatenate([kinds, _kinds(obstacle_kinds(obstacles), "other")])
    nearest, mask = _nearest(distance, surroundings.neighbours, surroundings.radius)
    past = states[vehicles.future[:, None], np.minimum(nearest, scene.vehicles - 1)]
    if obstacles is not None:
        observer, neighbour = np.nonzero(nearest >= scene.vehicles)
        obstacle = nearest[observer, neighbour] - scene.vehicles
        past.assign((observer, neighbour), obstacles.states[obstacle[:, None], steps[observer]])
    seen = seen_from(now, past)
    seen[~mask] = 0.0
    return {
        "neighbours": seen,
        "neighbour_size": np.where(mask[..., None], size[nearest], 0.0),
        "neighbour_kind": np.where(mask, kinds[nearest], 0),
        "neighbour_mask": mask,
    }


def _apart(now: States, others: States) -> FloatArray:
    """Return the distances (n, M) of vehicles (n,) from others (n, M), m."""
    return np.hypot(others.x - now.x[:, None], others.y - now.y[:, None])


def _nearest(distance: FloatArray, count: int, radius: float) -> tuple[IntArray, BoolArray]:
    order = np.argsort(distance, axis=1, kind="stable")[:, :count]
    mask = np.take_along_axis(distance, order, axis=1) <= radius
    if short := count - order.shape[1]:
        return np.pad(order, ((0, 0), (0, short))), np.pad(mask, ((0, 0), (0, short)))
    return order, mask


def _lanes(road: Road, now: States, surroundings: Surroundings) -> dict[str, NDArray[Any]]:
    pieces, limit = lane_pieces(road, surroundings.points, surroundings.spacing)
    middle = pieces[:, [surroundings.points // 2, (surroundings.points - 1) // 2]].mean(axis=1)
    near = _around(now, middle, surroundings.radius + 1.0)  # more than rounding
    pieces, middle, limit = pieces[near], middle[near], limit[near]
    distance = np.hypot(middle[:, 0] - now.x[:, None], middle[:, 1] - now.y[:, None])
    nearest, mask = _nearest(distance, surroundings.lanes, surroundings.radius)
    if len(pieces) == 0:
        pieces, limit = np.zeros((1, surroundings.points, 2)), np.zeros(1)
    places = (pieces[..., axis].take(nearest, axis=0) for axis in (0, 1))
    lanes = np.stack(now.ahead_and_left(*places), axis=-1)
    lanes[~mask] = 0.0
    return {"lanes": lanes, "lane_limit": np.where(mask, limit[nearest], 0.0), "lane_mask": mask}


def _around(now: States, places: FloatArray, radius: float) -> BoolArray:
    """Return which places (R, 2) are within a radius, m, of the box around all vehicles (n,)."""
    near = np.ones(len(places), dtype=np.bool_)
    for own, place in zip((now.x, now.y), places.T, strict=True):
        near &= (place >= own.min(initial=np.inf) - radius) & (place <= own.max(initial=-np.inf) + radius)
    return near


@owner_cache
def lane_pieces(road: Road, points: int, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Cut the vehicle lanes into (R, P, 2) pieces in driving direction, m, with (R,) speed limits, m/s."""
    pieces: list[FloatArray] = [np.empty((0, points, 2))]
    limits: list[FloatArray] = [np.empty(0)]
    for lane in road.vehicle_lanes.values():
        length = length_of(lane.centreline)
        count = max(int(np.ceil(length / (spacing * (points - 1)))), 1)
        line = along(lane.centreline, np.linspace(0.0, length, count * (points - 1) + 1))
        column = np.arange(count)[:, None] * (points - 1) + np.arange(points)
        pieces.append(line[column])
        limits.append(np.full(count, lane.speed_limit_mps))
    return np.concatenate(pieces), np.concatenate(limits)
