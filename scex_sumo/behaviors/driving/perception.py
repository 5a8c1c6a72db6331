"""What a vehicle sees: the others in its own coordinates, and the road around it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road
from scex_sumo.scene import SceneHistory, States, Who


@dataclass(frozen=True, kw_only=True, eq=False)
class Everyone:
    """Vehicles and obstacles of all children together; M = V + O columns.

    Attributes:
        states: (C, M) now.
        present: (C, M).
        length: (M,) m.
        width: (M,) m.
        obstacle: (M,) False for the vehicles.
        longest: the largest diagonal, m.
    """

    states: States
    present: BoolArray
    length: FloatArray
    width: FloatArray
    obstacle: BoolArray
    longest: float


@dataclass(frozen=True, kw_only=True, eq=False)
class LocalView:
    """Others as n vehicles see them: x ahead, y to the left, headings relative to their own.

    Columns are the V vehicles of the seed scene, then its O obstacles; M = V + O.

    Attributes:
        x: (n, M) centre, m.
        y: (n, M) centre, m.
        heading: (n, M) rad in [-pi, pi].
        vx: (n, M) velocity over ground along the own heading, m/s (not relative to the own velocity).
        vy: (n, M) velocity over ground to the left, m/s.
        length: (M,) m.
        width: (M,) m.
        seen: (n, M) present, within the radius and not the vehicle itself. Values elsewhere are arbitrary.
    """

    x: FloatArray
    y: FloatArray
    heading: FloatArray
    vx: FloatArray
    vy: FloatArray
    length: FloatArray
    width: FloatArray
    seen: BoolArray


def everyone(history: SceneHistory) -> Everyone:
    """Vehicles and obstacles in one set of arrays."""
    scene, now = history.scene, history.now
    present = np.ones(now.shape, dtype=np.bool_)
    length, width = scene.length, scene.width
    obstacles = scene.obstacles
    if obstacles is not None and history.obstacle_states is not None and history.obstacle_present is not None:
        shape = (now.shape[0], len(obstacles.ids))
        o = history.obstacle_states
        spread = States(
            x=np.broadcast_to(o.x, shape),
            y=np.broadcast_to(o.y, shape),
            heading=np.broadcast_to(o.heading, shape),
            speed=np.broadcast_to(o.speed, shape),
        )
        now = States.concatenate([now, spread], axis=1)
        present = np.concatenate([present, np.broadcast_to(history.obstacle_present, shape)], axis=1)
        length = np.concatenate([length, obstacles.length])
        width = np.concatenate([width, obstacles.width])
    longest = float(np.sqrt(length**2 + width**2).max(initial=0.0))
    obstacle = np.arange(len(length)) >= scene.vehicles
    return Everyone(
        states=now, present=present, length=length, width=width, obstacle=obstacle, longest=longest
    )


def local_view(history: SceneHistory, who: Who, radius: float = np.inf) -> LocalView:
    """The others in the own coordinates of each vehicle.

    Args:
        history: the present.
        who: the n vehicles that look.
        radius: how far they see, m, centre to centre.
    """
    others = everyone(history)
    own = history.now[who.child, who.vehicle]
    them = others.states[who.child]
    cos, sin = np.cos(own.heading)[:, None], np.sin(own.heading)[:, None]
    dx, dy = them.x - own.x[:, None], them.y - own.y[:, None]
    turn = wrap(them.heading - own.heading[:, None])
    seen = others.present[who.child] & (dx**2 + dy**2 <= radius**2)
    seen[np.arange(len(who)), who.vehicle] = False
    return LocalView(
        x=cos * dx + sin * dy,
        y=cos * dy - sin * dx,
        heading=turn,
        vx=them.speed * np.cos(turn),
        vy=them.speed * np.sin(turn),
        length=others.length,
        width=others.width,
        seen=seen,
    )


def narrow_road(road: Road, x: float, y: float, radius: float) -> Road:
    """The part of the map that a vehicle sees: lanes, markings and areas with a point within the radius.

    Args:
        road: the map.
        x: the vehicle's centre, m.
        y: the vehicle's centre, m.
        radius: m.
    """

    def near(points: FloatArray) -> bool:
        return bool(len(points) and (np.hypot(points[:, 0] - x, points[:, 1] - y) <= radius).any())

    lanes = {
        i: lane
        for i, lane in road.lanes.items()
        if near(lane.centreline) or near(lane.left_bound) or near(lane.right_bound)
    }
    return replace(
        road,
        lanes=lanes,
        regulations=tuple(r for r in road.regulations if any(i in lanes for i in r.lanes)),
        markings=tuple(m for m in road.markings if near(m.points)),
        areas=tuple(a for a in road.areas if near(a.outline)),
    )
