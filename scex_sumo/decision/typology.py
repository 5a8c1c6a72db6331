"""Kinds of conflicts of two road users, after the pre-crash typology (Najm, Smith, Yanagisawa 2007).

The kind follows from where the two are now, where their expected lines first come together, and how they go
on from there. It does not depend on who acts. docs/catalogue.md has the table of rules.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.certainty.response.motion.expected import Expected
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.geometry.polylines import wrap
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.roads.places import places_of
from scex_sumo.scene import STEP_S

LEAD_STOPPED, LEAD_DECELERATING, LEAD_SLOWER, LEAD_MOVING = (
    *("lead vehicle stopped", "lead vehicle decelerating"),
    *("lead vehicle slower", "lead vehicle moving on"),
)
LANE_CHANGE, MERGE, ENTRY, HEAD_ON = "lane change", "merge", "roundabout entry", "head-on"
CROSSING = "straight crossing paths"
ACROSS_OPPOSITE = "left turn across path, opposite"
ACROSS_LATERAL = "left turn across path, lateral"
INTO_PATH = "turn into path"
WALKING: Final = tuple(f"{who} {way}" for who in ("pedestrian", "cyclist") for way in ("crossing", "along"))
CONFLICTS: Final = (
    *(LEAD_STOPPED, LEAD_DECELERATING, LEAD_SLOWER, LEAD_MOVING),
    *(LANE_CHANGE, MERGE, ENTRY, CROSSING, ACROSS_OPPOSITE, ACROSS_LATERAL, INTO_PATH, HEAD_ON),
    *WALKING,
)
"""Kinds, in the order of the docs."""

_STANDS_MPS, _SLOWER_MPS, _BRAKES_MPS2 = 0.5, 0.5, -0.5
_IN_LINE_M = 2.75  # of the centre of a leader from the follower's line, mean of now and a second ago
_IN_LINE_RAD, _ALONG_RAD, _OPPOSED_RAD = np.deg2rad(45.0), np.deg2rad(30.0), np.deg2rad(135.0)
_TURNS_RAD = np.deg2rad(30.0)
_MEETING_M, _CROSS_M = 2.0, 1.0  # between lines that come together, and that cross
_BEYOND_M = 15.0  # way after that place, by which it is known whether the lines part again
_SECOND = round(1.0 / STEP_S)


@dataclass(frozen=True, kw_only=True)
class Conflict:
    """Kind and parameters of the conflict of two road users, the first one of which acts.

    Attributes:
        kind: one of `CONFLICTS`.
        angle_deg: between their headings where their lines come together, 0 to 180.
        apart_m: distance of the outlines now.
        speeds: m/s; so ``accelerations``, m/s², over the last second.
        arrivals_s: expected times at which they reach the place where their lines come together; inf: never.
    """

    kind: str
    angle_deg: float
    apart_m: float
    speeds: tuple[float, float]
    accelerations: tuple[float, float]
    arrivals_s: tuple[float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Way:
    """Expected way of one road user: samples (N,) ahead of it, and what it does until past the conflict."""

    x: FloatArray
    y: FloatArray
    heading: FloatArray
    s: FloatArray
    before: float  # heading a second ago

    def turned(self, at: int) -> float:
        """Return the turn from a second ago until `_BEYOND_M` after a sample, positive to the left, rad."""
        heading = self.heading[self._beyond(at)]
        return float(heading - self.heading[0] + wrap(self.heading[0] - self.before))

    def beyond(self, at: int) -> tuple[float, float, float]:
        k = self._beyond(at)
        return float(self.x[k]), float(self.y[k]), float(self.heading[k])

    def _beyond(self, at: int) -> int:
        return int(min(np.searchsorted(self.s, self.s[at] + _BEYOND_M), len(self.s) - 1))


def conflict_of(expected: Expected, one: int, other: int) -> Conflict:
    """Return the conflict of two road users by index; ``one`` acts, ``other`` responds."""
    scene, both = expected.scene, (one, other)
    ways = [_way(expected, v) for v in both]
    place = _meeting_samples(*ways)
    turn = abs(wrap(ways[0].heading[place[0]] - ways[1].heading[place[1]]))
    now = [Rectangles.of(scene.now[[v]], scene.length[[v]], scene.width[[v]]) for v in both]
    past = [scene.history.speed[v, -1 - _SECOND] for v in both]
    return Conflict(
        kind=_person_kind(expected, one, turn) or _kind(expected, both, ways, place),
        angle_deg=float(np.rad2deg(turn)),
        apart_m=float(rectangle_distance(*now)[0]),
        speeds=(float(scene.now.speed[one]), float(scene.now.speed[other])),
        accelerations=(
            float(scene.now.speed[one] - past[0]),
            float(scene.now.speed[other] - past[1]),
        ),
        arrivals_s=(
            _arrival(expected, one, ways[0].s[place[0]]),
            _arrival(expected, other, ways[1].s[place[1]]),
        ),
    )


def _way(expected: Expected, v: int) -> _Way:
    lines, now = expected.lines, expected.scene.now
    s = lines.start[v] + lines.spacing_m * np.arange(lines.x.shape[1])
    reach = max(float(expected.s[v, -1]), 8.0 * float(now.speed[v]), _BEYOND_M) + _BEYOND_M
    ahead = np.flatnonzero((s >= 0) & (s <= reach))
    return _Way(
        x=lines.x[v, ahead],
        y=lines.y[v, ahead],
        heading=lines.heading[v, ahead],
        s=s[ahead],
        before=float(expected.scene.history.heading[v, -1 - _SECOND]),
    )


def _meeting_samples(one: _Way, other: _Way) -> tuple[int, int]:
    """Return the samples at which two ways first come within 2 m, along both; else the nearest ones."""
    apart = np.hypot(one.x[:, None] - other.x, one.y[:, None] - other.y)
    near = apart <= max(_MEETING_M, float(apart.min()))
    k, m = np.nonzero(near)
    first = int(np.argmin(one.s[k] + other.s[m]))
    return int(k[first]), int(m[first])


def _arrival(expected: Expected, v: int, s: float) -> float:
    reached = expected.s[v] >= s - 1e-9
    return float(STEP_S * np.argmax(reached)) if reached.any() else float("inf")


def _person_kind(expected: Expected, person: int, turn: float) -> str | None:
    """Return the kind of a conflict with somebody on foot or bicycle who acts; None for a vehicle."""
    if person < expected.vehicles:
        return None
    who = "pedestrian" if road_user(expected.scene.types[person]) == "pedestrian" else "cyclist"
    stands = expected.scene.now.speed[person] < _STANDS_MPS
    crosses = not stands and _ALONG_RAD <= turn <= np.pi - _ALONG_RAD
    return f"{who} {'crossing' if crosses else 'along'}"


def _kind(expected: Expected, both: tuple[int, int], ways: list[_Way], place: tuple[int, int]) -> str:
    now = abs(wrap(ways[0].heading[0] - ways[1].heading[0]))
    came = max(now, abs(wrap(ways[0].before - ways[1].before)))
    for lead, follower in ((0, 1), (1, 0)):
        if _leads(expected, both[lead], ways[follower]):
            return _lead_kind(expected, both[lead], both[follower])
    turned = [way.turned(at) for way, at in zip(ways, place, strict=True)]
    here = [(way.x[at], way.y[at]) for way, at in zip(ways, place, strict=True)]
    points = np.array([*here, *((way.x[0], way.y[0]) for way in ways)])
    assert expected.scene.road is not None
    _, meets, *stands = places_of(expected.scene.road, points)
    apart = _least_apart(*ways)
    circles = meets == "ring" and (now < _OPPOSED_RAD or apart < _MEETING_M)
    turns = now >= _ALONG_RAD
    if (turns or stands != ["ring", "ring"]) and (circles or "ring" in stands):
        return ENTRY
    if not turns and abs(wrap(ways[0].heading[place[0]] - ways[1].heading[place[1]])) < _IN_LINE_RAD:
        return MERGE if meets == "merge" else LANE_CHANGE
    return _across(came, turned, together=_go_on_together(ways, place), crosses=apart < _CROSS_M)


def _leads(expected: Expected, lead: int, way: _Way) -> bool:
    """Whether a vehicle is on the way of another one, came along it, and goes in its direction."""
    states = expected.scene.history[lead]
    apart, past = (np.hypot(way.x - states.x[k], way.y - states.y[k]) for k in (-1, -1 - _SECOND))
    nearest = int(np.argmin(apart))
    turn = abs(wrap(states.heading[-1] - way.heading[nearest]))
    inside = (apart[nearest] + past.min()) / 2 < _IN_LINE_M
    return bool(nearest > 0 and inside and turn < _IN_LINE_RAD)


def _lead_kind(expected: Expected, lead: int, follower: int) -> str:
    scene, speed = expected.scene, expected.scene.now.speed
    slows = min(
        speed[lead] - scene.history.speed[lead, -1 - _SECOND],
        expected.speed[lead, _SECOND] - speed[lead],
    )
    if speed[lead] < _STANDS_MPS:
        return LEAD_STOPPED
    if slows < _BRAKES_MPS2:
        return LEAD_DECELERATING
    return LEAD_SLOWER if speed[follower] - speed[lead] > _SLOWER_MPS else LEAD_MOVING


def _go_on_together(ways: list[_Way], place: tuple[int, int]) -> bool:
    """Whether two ways are still one `_BEYOND_M` after they came together."""
    (x, y, heading), (x2, y2, heading2) = (w.beyond(at) for w, at in zip(ways, place, strict=True))
    along = abs(wrap(heading - heading2)) < _IN_LINE_RAD
    return bool(along and np.hypot(x - x2, y - y2) < 2 * _MEETING_M)


def _least_apart(one: _Way, other: _Way) -> float:
    return float(np.hypot(one.x[:, None] - other.x, one.y[:, None] - other.y).min())


def _across(came: float, turned: list[float], *, together: bool, crosses: bool) -> str:
    """Return the kind of two vehicles of different headings, by their turns, positive to the left.

    Args:
        came: angle between their headings now or a second ago, rad.
    """
    straight = [abs(turn) < _TURNS_RAD for turn in turned]
    left = [turn >= _TURNS_RAD for turn in turned]
    if together:
        return MERGE if all(straight) else INTO_PATH
    if came >= _OPPOSED_RAD:
        return ACROSS_OPPOSITE if any(left) and crosses else HEAD_ON
    if any(left):
        return ACROSS_LATERAL
    return CROSSING if all(straight) else INTO_PATH
