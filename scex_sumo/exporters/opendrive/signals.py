"""Signals of OpenDRIVE: lights, stops and yields of the map's rules, at their stop lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from scex_sumo.arrays import FloatArray
from scex_sumo.exporters.opendrive.network import Piece
from scex_sumo.exporters.opendrive.ribbons import Section
from scex_sumo.road import Lane, Regulation, Road

_STEP_M = 0.5


@dataclass(frozen=True, kw_only=True)
class Signal:
    """One light or sign.

    Attributes:
        number: its id in the file.
        name: what it is in the map.
        type: OpenDRIVE's own for a light, else the number of the sign in its country.
        country: whose signs they are.
        dynamic: whether it changes, as a light does.
        s: along the road, m.
        t: from the reference line, m.
        lane: the lane that it is for.
    """

    number: int
    name: str
    type: str
    country: str
    dynamic: bool
    s: float
    t: float
    lane: int


_LIGHT = ("1000001", "OpenDRIVE")
_YIELD, _STOP, _PRIORITY = ("205", "DE"), ("206", "DE"), ("306", "DE")


def place_signals(road: Road, pieces: Sequence[Piece]) -> dict[int, list[Signal]]:
    """Signals by the number of the road that they stand at."""
    found: dict[int, list[Signal]] = {}
    seen: set[tuple[int, tuple[str, str]]] = set()
    for rule in road.regulations:
        for i, kind in _wanted(rule):
            if i not in road.lanes or (i, kind) in seen:
                continue
            seen.add((i, kind))
            piece, section, s = _where(pieces, road.lanes[i], rule)
            n = section.group.index(i)
            signal = Signal(
                number=len(seen),
                name=f"{rule.kind} {rule.element_id}",
                type=kind[0],
                country=kind[1],
                dynamic=kind is _LIGHT,
                s=s,
                t=float(np.interp(s, section.s, section.offsets[:, n + 1])),
                lane=-n - 1,
            )
            found.setdefault(piece.number, []).append(signal)
    return found


def _wanted(rule: Regulation) -> list[tuple[int, tuple[str, str]]]:
    """Lanes with the sign that stands at each."""
    if rule.kind == "traffic_light":
        return [(i, _LIGHT) for i in rule.lanes]
    if rule.kind in ("stop", "all_way_stop"):
        return [(i, _STOP) for i in rule.yielding or rule.lanes]
    return [(i, _YIELD) for i in rule.yielding] + [(i, _PRIORITY) for i in rule.priority]


def _where(pieces: Sequence[Piece], lane: Lane, rule: Regulation) -> tuple[Piece, Section, float]:
    """The road, its section and the place along it: at the stop line, or else at the end of the lane."""
    line = shapely.LineString(lane.centreline)
    place = lane.centreline[-1]
    for points in rule.stop_lines:
        if len(points) > 1 and shapely.LineString(points).intersects(line):
            crossing = shapely.LineString(points).intersection(line).representative_point()
            place = np.array([crossing.x, crossing.y])
            break
    options = [(p, x) for p in pieces for x in p.ribbon.sections if lane.lane_id in x.group]
    near = [_nearest(piece, section, place) for piece, section in options]
    best = int(np.argmin([gap for _, gap in near]))
    return *options[best], near[best][0]


def _nearest(piece: Piece, section: Section, place: FloatArray) -> tuple[float, float]:
    """Arc length on a section that is nearest to a place, and the distance from there, m."""
    s = np.linspace(section.s[0], section.s[-1], max(2, round(np.ptp(section.s) / _STEP_M)))
    gap = np.hypot(*(piece.ribbon.curve.at(s)[0] - place).T)
    return float(s[gap.argmin()]), float(gap.min())
