"""Kinds of conflicts of two road users, after the pre-crash typology (Najm, Smith, Yanagisawa 2007).

The kind follows from where the two are now, where the ways that they drive in a future first come together,
and how the ways go on from there. docs/catalogue.md has the table of rules.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.conflicts.braking import DrivenPaths
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.geometry.polylines import wrap
from scex_sumo.results.participants import everybody, with_everybody
from scex_sumo.results.parts import Part
from scex_sumo.results.tables.pairs import TOLD
from scex_sumo.roads.places import places_of
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene, States

LEAD_STOPPED, LEAD_DECELERATING, LEAD_SLOWER, LEAD_MOVING = LEADING = (
    *("lead vehicle stopped", "lead vehicle decelerating"),
    *("lead vehicle slower", "lead vehicle moving on"),
)
LANE_CHANGE, MERGE, ENTRY, HEAD_ON = "lane change", "merge", "roundabout entry", "head-on"
CROSSING = "straight crossing paths"
ACROSS_OPPOSITE = "turn across path, opposite"
ACROSS_LATERAL = "turn across path, lateral"
INTO_PATH = "turn into path"
WALKING: Final = tuple(f"{kind} {way}" for kind in ("pedestrian", "cyclist") for way in ("crossing", "along"))
CONFLICTS: Final = (
    *LEADING,
    *(LANE_CHANGE, MERGE, ENTRY, CROSSING, ACROSS_OPPOSITE, ACROSS_LATERAL, INTO_PATH, HEAD_ON),
    *WALKING,
)
"""Kinds, in the order of the docs."""

_STANDS_MPS, _SLOWER_MPS, _BRAKES_MPS2 = 0.5, 0.5, -1.0
_IN_LINE_M = 2.75  # of the centre of a leader from the follower's way, mean of now and a second ago
_IN_LINE_RAD, _ALONG_RAD, _OPPOSED_RAD = np.deg2rad(45.0), np.deg2rad(30.0), np.deg2rad(135.0)
_TURNS_RAD = np.deg2rad(30.0)
_MEETING_M, _CROSS_M = 2.0, 1.0  # between ways that come together, and that cross
_BEYOND_M = 15.0  # along a way after that place, by which it is known whether the ways part again
_SPACING_M = 1.0
_SECOND = round(1.0 / STEP_S)


def kinds_of(scene: SeedScene, rows: Sequence[Mapping[str, Any]], part: Part) -> list[str | None]:
    """Return the kind of the conflict of each pair of a moment; None below `TOLD`.

    Args:
        scene: with its road.
        rows: as of `decision.pairs.PAIRS`.
        part: the human-like futures; with plans, ways go on as planned, else straight on.
    """
    whole, driven_in = everybody(scene), dict[int, DrivenPaths]()
    place = {int(track): v for v, track in enumerate(whole.track_ids)}
    kinds: list[str | None] = []
    for row in rows:
        if row["probability"] < TOLD:
            kinds.append(None)
            continue
        future = int(row["future"])
        if future not in driven_in:
            driven_in[future] = _ways_of(scene, part, int(np.searchsorted(part.futures, future)))
        kinds.append(conflict_of(whole, place[row["track_id"]], place[row["other_id"]], driven_in[future]))
    return kinds


def _ways_of(scene: SeedScene, part: Part, index: int) -> DrivenPaths:
    whole, states = everybody(scene), with_everybody(scene, part.states[index : index + 1])[0].swapaxes(0, 1)
    planned = None
    if part.plan_x is not None and part.plan_y is not None and scene.vehicles == whole.vehicles:
        planned = np.stack([plan[index] for plan in (part.plan_x, part.plan_y)])
    return DrivenPaths.of(states, whole.length, whole.width, planned)


def conflict_of(scene: SeedScene, one: int, other: int, driven: DrivenPaths) -> str:
    """Return the kind of the conflict of two road users by index, one of `CONFLICTS`; their order is free.

    Args:
        scene: with its road, and people as its last vehicles.
        driven: (V,) of all in one future, driven from a second before the moment on.
    """
    both = one, other
    ahead = [_ahead(scene, driven, v) for v in both]
    place = _meeting_samples(*ahead)
    turn = abs(wrap(ahead[0].heading[place[0]] - ahead[1].heading[place[1]]))
    return _person_kind(scene, both, turn) or _kind(scene, driven, both, ahead, place)


def _ahead(scene: SeedScene, driven: DrivenPaths, v: int) -> States:
    """Return the path of a road user from now on, `_SPACING_M` apart."""
    now = driven.arc[v, HISTORY_STEPS]
    reach = max(driven.arc[v, -1] - now, 8.0 * scene.now.speed[v], _BEYOND_M) + _BEYOND_M
    s = now + np.arange(0.0, reach, _SPACING_M)
    x, y, _, _, heading, _ = driven.at(np.full(len(s), v), s)
    return States(x=x, y=y, heading=heading, speed=np.zeros_like(s))


def _beyond(path: States, sample: int) -> States:
    """Return where a path is `_BEYOND_M` after a sample."""
    return path[int(min(sample + _BEYOND_M / _SPACING_M, len(path.x) - 1))]


def _turned(path: States, before: float, sample: int) -> float:
    """Return the turn from a heading before until `_BEYOND_M` after a sample, positive to the left, rad."""
    return float(_beyond(path, sample).heading - path.heading[0] + wrap(path.heading[0] - before))


def _meeting_samples(one: States, other: States) -> tuple[int, int]:
    """Return the samples at which two ways first come within 2 m, along both; else the nearest ones."""
    apart = _apart(one, other)
    k, m = np.nonzero(apart <= max(_MEETING_M, float(apart.min())))
    first = int(np.argmin(k + m))
    return int(k[first]), int(m[first])


def _apart(one: States, other: States) -> FloatArray:
    return np.hypot(one.x[:, None] - other.x, one.y[:, None] - other.y)


def _person_kind(scene: SeedScene, both: tuple[int, int], turn: float) -> str | None:
    """Return the kind of a conflict with somebody on foot or bicycle; None of two vehicles."""
    people = [v for v in both if scene.people is not None and scene.people[v]]
    if not people:
        return None
    kind = "pedestrian" if road_user(scene.types[people[0]]) == "pedestrian" else "cyclist"
    stands = scene.now.speed[people[0]] < _STANDS_MPS
    crosses = not stands and _ALONG_RAD <= turn <= np.pi - _ALONG_RAD
    return f"{kind} {'crossing' if crosses else 'along'}"


def _kind(
    scene: SeedScene, driven: DrivenPaths, both: tuple[int, int], paths: list[States], place: tuple[int, int]
) -> str:
    now = abs(wrap(paths[0].heading[0] - paths[1].heading[0]))
    before = scene.history.heading[list(both), -1 - _SECOND].tolist()
    came = max(now, abs(wrap(before[0] - before[1])))
    for lead, follower in ((0, 1), (1, 0)):
        if _leads(scene, both[lead], paths[follower]):
            return _lead_kind(scene, driven, both[lead], both[follower])
    assert scene.road is not None
    inwards = -1.0 if scene.road.left_hand else 1.0  # a turn across the oncoming lane
    turned = [inwards * _turned(*given) for given in zip(paths, before, place, strict=True)]
    here = [(path.x[sample], path.y[sample]) for path, sample in zip(paths, place, strict=True)]
    points = np.array([*here, *((path.x[0], path.y[0]) for path in paths)])
    _, meets, *stands = places_of(scene.road, points)
    apart = float(_apart(*paths).min())
    circles = meets == "ring" and (now < _OPPOSED_RAD or apart < _MEETING_M)
    turns = now >= _ALONG_RAD
    if (turns or stands != ["ring", "ring"]) and (circles or "ring" in stands):
        return ENTRY
    if not turns and abs(wrap(paths[0].heading[place[0]] - paths[1].heading[place[1]])) < _IN_LINE_RAD:
        return MERGE if meets == "merge" else LANE_CHANGE
    return _across(came, turned, together=_go_on_together(paths, place), crosses=apart < _CROSS_M)


def _leads(scene: SeedScene, lead: int, path: States) -> bool:
    """Whether a vehicle is on the way of another one, came along it, and goes in its direction."""
    states = scene.history[lead]
    apart, past = (np.hypot(path.x - states.x[k], path.y - states.y[k]) for k in (-1, -1 - _SECOND))
    nearest = int(np.argmin(apart))
    turn = abs(wrap(states.heading[-1] - path.heading[nearest]))
    inside = (apart[nearest] + past.min()) / 2 < _IN_LINE_M
    return bool(nearest > 0 and inside and turn < _IN_LINE_RAD)


def _lead_kind(scene: SeedScene, driven: DrivenPaths, lead: int, follower: int) -> str:
    speed, second = scene.now.speed, min(HISTORY_STEPS + _SECOND, driven.states.shape[1] - 1)
    slows = min(
        speed[lead] - scene.history.speed[lead, -1 - _SECOND], driven.states.speed[lead, second] - speed[lead]
    )
    if speed[lead] < _STANDS_MPS:
        return LEAD_STOPPED
    if slows < _BRAKES_MPS2:
        return LEAD_DECELERATING
    return LEAD_SLOWER if speed[follower] - speed[lead] > _SLOWER_MPS else LEAD_MOVING


def _go_on_together(paths: list[States], place: tuple[int, int]) -> bool:
    """Whether two ways are still one `_BEYOND_M` after they came together."""
    one, other = (_beyond(path, sample) for path, sample in zip(paths, place, strict=True))
    along = abs(wrap(one.heading - other.heading)) < _IN_LINE_RAD
    return bool(along and np.hypot(one.x - other.x, one.y - other.y) < 2 * _MEETING_M)


def _across(came: float, turned: list[float], *, together: bool, crosses: bool) -> str:
    """Return the kind of two vehicles of different headings, by their turns.

    A turn is positive to the side of oncoming traffic: the left where traffic drives on the right.

    Args:
        came: angle between their headings now or a second ago, rad.
    """
    straight = [abs(turn) < _TURNS_RAD for turn in turned]
    across = any(turn >= _TURNS_RAD for turn in turned)
    if together:
        return MERGE if all(straight) else INTO_PATH
    if came >= _OPPOSED_RAD:
        return ACROSS_OPPOSITE if across and crosses else HEAD_ON
    if across:
        return ACROSS_LATERAL
    return CROSSING if all(straight) else INTO_PATH
