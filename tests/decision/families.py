"""Families of scenes with one number that makes them worse, on roads drawn by hand."""

from __future__ import annotations

from functools import cache

import numpy as np
import pyarrow as pa

from scex_sumo.decision.moment import moment_pairs
from scex_sumo.road import Lane, Regulation, Road
from scex_sumo.scene import SeedScene, States
from tests.seeds import Vehicle, lane_along, people_of, seed_of, steady

FUTURES = 8
LENGTH_M, WIDTH_M, LANE_M = 4.5, 1.8, 3.5


def lane(lane_id: int, points: list[tuple[float, float]], **more: object) -> Lane:
    return lane_along(lane_id, points, speed_limit_mps=30.0, **more)


@cache
def street() -> Road:
    """Two lanes along x: 1 to the east at y = 0, 2 to the west at y = 3.5."""
    lanes = lane(1, [(-800.0, 0.0), (800.0, 0.0)]), lane(2, [(800.0, LANE_M), (-800.0, LANE_M)])
    return Road(name="street", lanes={one.lane_id: one for one in lanes})


@cache
def cross(*, priority: bool) -> Road:
    """Lane 1 to the east and lane 2 to the north, which cross at the origin; with priority lane 2 yields."""
    east = lane(1, [(-400.0, 0.0), (400.0, 0.0)], conflicts=(2,))
    north = lane(2, [(0.0, -400.0), (0.0, 400.0)], conflicts=(1,))
    line = np.array([[-LANE_M / 2, -4.0], [LANE_M / 2, -4.0]])
    rule = Regulation(
        element_id=7, kind="right_of_way", lanes=(1, 2), yielding=(2,), priority=(1,), stop_lines=(line,)
    )
    regulations = {"regulations": (rule,)} if priority else {}
    return Road(name="cross", lanes={1: east, 2: north}, **regulations)  # type: ignore[arg-type]


@cache
def merge() -> Road:
    """Lane 1 to the east and lane 2 from the south-west, which join at the origin into lane 3."""
    slope = np.deg2rad(20.0)
    far = (-400.0 * np.cos(slope), -400.0 * np.sin(slope))
    lanes = (
        lane(1, [(-400.0, 0.0), (0.0, 0.0)], successors=(3,), conflicts=(2,)),
        lane(2, [far, (0.0, 0.0)], successors=(3,), conflicts=(1,)),
        lane(3, [(0.0, 0.0), (600.0, 0.0)], predecessors=(1, 2)),
    )
    return Road(name="merge", lanes={one.lane_id: one for one in lanes})


def scene(road: Road, *vehicles: tuple[float, ...], people: tuple[Vehicle, ...] = ()) -> SeedScene:
    """Vehicles that have driven straight on for a second, at constant speed or with a constant braking."""
    x, y, heading, speed, braking = np.array([(*one, 0.0)[:5] for one in vehicles], dtype=float).T
    back, whole = 0.1 * np.arange(10, -1, -1), np.ones((len(x), 11))
    way = speed[:, None] * back + braking[:, None] * back**2 / 2
    history = States(
        x=x[:, None] - way * np.cos(heading)[:, None],
        y=y[:, None] - way * np.sin(heading)[:, None],
        heading=heading[:, None] * whole,
        speed=speed[:, None] + braking[:, None] * back,
    )
    ids = tuple(f"{k}" for k in range(900, 900 + len(people)))
    walking = steady(*people, time_s=0.1 * np.arange(-10, 61))
    others = people_of(walking, *("pedestrian",) * len(people), ids=ids) if people else None
    return seed_of(history, obstacles=others, road=road)


def pairs(seed_scene: SeedScene, futures: int = FUTURES) -> pa.Table:
    """The pairs of a scene by its human-like futures."""
    return moment_pairs(seed_scene, futures=futures)


def probability(seed_scene: SeedScene, futures: int = FUTURES) -> float:
    """The largest P of a pair of a scene."""
    return max(pairs(seed_scene, futures)["probability"].to_pylist(), default=0.0)


def behind_standing(speed: float, gap_m: float) -> SeedScene:
    return scene(street(), (0.0, 0.0, 0.0, speed), (gap_m + LENGTH_M, 0.0, 0.0, 0.0))


def behind_slower(speed: float, slower: float, gap_m: float) -> SeedScene:
    return scene(street(), (0.0, 0.0, 0.0, speed), (gap_m + LENGTH_M, 0.0, 0.0, slower))


def behind_braking(speed: float, gap_m: float, braking: float) -> SeedScene:
    return scene(street(), (0.0, 0.0, 0.0, speed), (gap_m + LENGTH_M, 0.0, 0.0, speed, braking))


def crossing(speed: float, ttc_s: float, *, priority: bool = False) -> SeedScene:
    """Two that reach the middle of the crossing at once."""
    way = speed * ttc_s + LENGTH_M / 2 + WIDTH_M / 2
    return scene(cross(priority=priority), (-way, 0.0, 0.0, speed), (0.0, -way, np.pi / 2, speed))


def merging(speed: float, ttc_s: float) -> SeedScene:
    way, slope = speed * ttc_s, np.deg2rad(20.0)
    return scene(merge(), (-way, 0.0, 0.0, speed), (-way * np.cos(slope), -way * np.sin(slope), slope, speed))


def oncoming(speed: float, ttc_s: float) -> SeedScene:
    """One drives on the lane of the other."""
    way = 2 * speed * ttc_s + LENGTH_M
    return scene(street(), (0.0, LANE_M, 0.0, speed), (way, LANE_M, np.pi, speed))


def person(speed: float, ttc_s: float) -> SeedScene:
    """Somebody crosses and is in the middle of the lane when the car comes."""
    way, walk = speed * ttc_s + LENGTH_M / 2, 1.4
    return scene(street(), (0.0, 0.0, 0.0, speed), people=((way, -walk * ttc_s, np.pi / 2, walk),))
