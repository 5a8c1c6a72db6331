"""Lanes and traffic lights of OSI ground truth, where a trace has no OpenDRIVE map."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.formats.lane_maps.lane_map import DrawnLane, DrawnMap
from scex_sumo.geometry.bounds import mean_width_m
from scex_sumo.geometry.polylines import length_of

_DRIVING, _NONDRIVING, _INTERSECTION, _BIKING = 2, 3, 4, 3
_LINES = {
    3: ("line_thin", "solid"),
    4: ("line_thin", "dashed"),
    6: ("road_border", ""),
    12: ("road_border", ""),
}
"""Kind and subtype of a marking by OSI's type of boundary; other ones are not drawn."""
_CLOSED = (3, *range(6, 16))  # types of boundaries over which no vehicle changes lanes
_LETTERS = {2: "r", 3: "y", 4: "G"}
_OFF, _CONSTANT, _FLASHING = 2, 3, 4
MAX_SKEW = 0.2  # of a lane's length: a bound that is longer or shorter gives the width only

_Key = TypeVar("_Key", bound=Hashable)


def osi_map(path: Path, truth: Any) -> DrawnMap:
    """Return the lanes and markings of ground truth; a junction without lanes gets one for each movement."""
    drawn = DrawnMap(path=path)
    bounds = {bound.id.value: bound for bound in truth.lane_boundary}
    for lane in truth.lane:
        if _kind(lane) and len(lane.classification.centerline) > 1:
            drawn.lanes.append(_lane(lane, bounds))
    drawn.lanes += _movements(truth.lane, {lane.name: lane for lane in drawn.lanes})
    for bound in bounds.values():
        kind = int(bound.classification.type) if bound.classification is not None else 0
        if kind in _LINES:
            drawn.lines.append((*_LINES[kind], _points(p.position for p in bound.boundary_line)))
    drawn.lit = {name: None for light in truth.traffic_light for name in lanes_of(light)}
    return drawn


def _kind(lane: Any) -> str:
    about = lane.classification
    if about is None or (about.type == _NONDRIVING and about.subtype != _BIKING):
        return ""
    return {_DRIVING: "vehicle", _INTERSECTION: "vehicle", _NONDRIVING: "bicycle"}.get(int(about.type), "")


def _points(places: Iterable[Any]) -> FloatArray:
    return np.array([(place.x, place.y) for place in places if place is not None]).reshape(-1, 2)


def _lane(lane: Any, bounds: dict[int, Any]) -> DrawnLane:
    """Return a lane in driving direction, which OSI's points need not have."""
    about = lane.classification
    centre = _points(about.centerline)
    sides = [
        [bounds[name.value] for name in names if name.value in bounds]
        for names in (about.left_lane_boundary_id, about.right_lane_boundary_id)
    ]
    if not about.centerline_is_driving_direction:
        centre, sides = centre[::-1], sides[::-1]
    lines = [_along(centre, [_points(p.position for p in b.boundary_line) for b in side]) for side in sides]
    known, length = all(len(line) > 1 for line in lines), length_of(centre)
    whole = known and all(abs(length_of(line) - length) < MAX_SKEW * length for line in lines)
    return DrawnLane(
        name=lane.id.value,
        centre=centre,
        left=lines[0] if whole else None,
        right=lines[1] if whole else None,
        width_m=mean_width_m(*lines) if known else None,
        kind=_kind(lane),
        inside=about.type == _INTERSECTION,
        closed=tuple(
            side
            for side, beside in zip(("left", "right"), sides, strict=True)
            if beside and all(int(bound.classification.type) in _CLOSED for bound in beside)
        ),
    )


def _along(centre: FloatArray, lines: list[FloatArray]) -> FloatArray:
    ahead = centre[-1] - centre[0]
    lines = [line for line in lines if len(line)]
    turned = [line if (line[-1] - line[0]) @ ahead >= 0 else line[::-1] for line in lines]
    return np.concatenate([np.empty((0, 2)), *sorted(turned, key=lambda line: float(line[0] @ ahead))])


def _movements(lanes: Iterable[Any], drawn: dict[Hashable, DrawnLane]) -> Iterator[DrawnLane]:
    """Yield a lane for each pair that a junction without a centreline joins."""
    free = max((int(str(name)) for name in drawn), default=0) + 1
    for junction in lanes:
        about = junction.classification
        if about is None or about.type != _INTERSECTION or len(about.centerline) > 1:
            continue
        for pair in about.lane_pairing:
            ends = (pair.antecessor_lane_id, pair.successor_lane_id)
            into, out = (drawn.get(end.value) if end is not None else None for end in ends)
            if into is not None and out is not None:
                yield DrawnLane(
                    name=free,
                    centre=_curve(into.centre, out.centre),
                    inside=True,
                    successors=[out.name],
                    predecessors=[into.name],
                )
                free += 1


def _curve(into: FloatArray, out: FloatArray) -> FloatArray:
    """Return a cubic from the end of a line to the beginning of another, tangent to both, (21, 2)."""
    start, end = into[-1], out[0]
    reach = float(np.hypot(*(end - start)))
    a, b = (
        (line / max(float(np.hypot(*line)), 1e-9)) * reach for line in (into[-1] - into[-2], out[1] - out[0])
    )
    t = np.linspace(0.0, 1.0, 21)[:, None]
    return np.asarray(
        (2 * t**3 - 3 * t**2 + 1) * start + (t**3 - 2 * t**2 + t) * a
        + (3 * t**2 - 2 * t**3) * end + (t**3 - t**2) * b
    )  # fmt: skip


def lanes_of(light: Any) -> list[int]:
    """Return the lanes of OSI for which a light shines."""
    return [name.value for name in light.classification.assigned_lane_id] if light.classification else []


def signals_of(light: Any) -> list[str]:
    """Return the signals of the OpenDRIVE map that a light is, as ``7`` or ``traffic_light_id:7``."""
    names = [name for source in light.source_reference for name in source.identifier[:1]]
    return [name.rpartition(":")[2].strip() for name in names]


def light_states(
    truths: Iterable[Any], keys: Callable[[Any], Iterable[_Key]]
) -> dict[_Key, list[tuple[float, str]]]:
    """Return time, s from the first frame with traffic, and SUMO's letter of each key with a light.

    OSI has one light for each bulb: of those that shine, the most restrictive counts; red with
    yellow is ``u``.

    Args:
        keys: what a light belongs to, e.g. its lanes.
    """
    states: dict[_Key, list[tuple[float, str]]] = {}
    first_s = None
    for truth in truths:
        if first_s is None and not truth.moving_object:
            continue
        time_s = truth.timestamp.seconds + truth.timestamp.nanos / 1e9
        first_s = time_s if first_s is None else first_s
        shown: dict[_Key, set[str]] = {}
        for light in truth.traffic_light:
            for key in keys(light):
                shown.setdefault(key, set()).add(_letter(light.classification))
        for key, letters in shown.items():
            states.setdefault(key, []).append((time_s - first_s, _letter_of_all(letters)))
    return states


def _letter(about: Any) -> str:
    mode, color = int(about.mode), int(about.color)
    if mode == _OFF:
        return "O"
    if mode == _FLASHING:
        return "o" if color == 3 else ""
    return _LETTERS.get(color, "") if mode == _CONSTANT else ""


def _letter_of_all(letters: set[str]) -> str:
    if {"r", "y"} <= letters:
        return "u"
    return next((letter for letter in "ryoG" if letter in letters), "" if "" in letters else "O")
