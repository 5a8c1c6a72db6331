"""Stretches of lanelets under the lanes of a converted net, to join the map's lanelets again.

Junctions hold the same ground under several lanes, so `convert` writes the stretches into each lane.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias
from xml.etree import ElementTree

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.reader import points_of
from scex_sumo.geometry.polylines import cut, length_of
from scex_sumo.road import Lane

KEY = "lanelets"
CHANGED_M = 1e-3  # difference of lengths from which a lane was changed
JOINT_M = 0.05  # where road follows road, the lane between takes this much of both
BEYOND = 0  # road before or behind the map's border
GAP_M = 0.1  # between such road and a lane
_DRIVEN = ("normal", "", None, "internal")  # functions of edges
STRAIGHT_M = 5e-9  # a point this near to the line between its neighbours is none of the map's

Named: TypeAlias = Mapping[str, tuple["LaneletPart", ...]]


@dataclass(frozen=True)
class LaneletPart:
    """A stretch of a lanelet (or `BEYOND`) under a lane, in m along the lanelet; width and limit are the
    lanelet's.
    """

    lanelet: int
    start: float
    end: float
    width: float
    speed: float


def parts_text(stretches: Iterable[LaneletPart]) -> str:
    """Format the stretches as a value of the net."""
    return " ".join(
        ",".join([str(s.lanelet), *(f"{v:.9f}" for v in (s.start, s.end, s.width, s.speed))])
        for s in stretches
    )


def named_parts(root: ElementTree.Element) -> dict[str, tuple[LaneletPart, ...]] | None:
    """Return the stretches under each lane of a net.

    None if the net was changed since its conversion; empty if `convert` did not write it.
    """
    found: dict[str, tuple[LaneletPart, ...]] = {}
    for lane in root.iter("lane"):
        text = next((p.get("value", "") for p in lane.iter("param") if p.get("key") == KEY), "")
        if not text:
            continue
        try:
            points = points_of(lane.get("shape", ""))
            stretches = tuple(_stretch(part) for part in text.split())
            allowed = CHANGED_M + GAP_M * any(s.lanelet == BEYOND for s in stretches)
            changed = abs(length_of(points) - sum(s.end - s.start for s in stretches)) > allowed
        except (ValueError, IndexError, TypeError):
            changed = True
        if changed:
            return None
        found[lane.get("id", "")] = stretches
    return found


def _stretch(text: str) -> LaneletPart:
    lanelet, *numbers = text.split(",")
    return LaneletPart(int(lanelet), *map(float, numbers))


def lanelet_places(named: Named, name: str) -> list[tuple[int, float]]:
    """Return a lane's lanelets and the arc lengths where it begins on them, m, without mere joints."""
    stretches = [s for s in named[name] if s.lanelet != BEYOND]
    long = [s for s in stretches if s.end - s.start > JOINT_M * 1.001]
    return list({s.lanelet: s.start for s in reversed(long or stretches)}.items())[::-1]


def lane_names(root: ElementTree.Element) -> list[str]:
    """Return SUMO's lanes of a net that become lanes of its road, in the order of the file."""
    edges = (edge for edge in root.iter("edge") if edge.get("function") in _DRIVEN)
    return [lane.get("id", "") for edge in edges for lane in edge.iter("lane")]


def lane_places(root: ElementTree.Element) -> list[tuple[str, list[tuple[int, float]]]]:
    """Return each lane of a net with (lane of its road under it, arc length in m where it begins there)."""
    named = named_parts(root)
    if named:
        return [(name, under) for name in named if (under := lanelet_places(named, name))]
    return [(name, [(k + 1, 0.0)]) for k, name in enumerate(lane_names(root))]


def put_together(named: Named, lanes: Mapping[str, Lane]) -> dict[int, Lane]:
    """Join the lanelets of a net, by id, without bounds, predecessors and conflicts."""
    numbers = {lane.lane_id: name for name, lane in lanes.items()}
    parts: dict[int, list[tuple[LaneletPart, FloatArray]]] = {}
    following: dict[int, set[int]] = {}
    beside: dict[int, list[int | None]] = {}
    for name, stretches in named.items():
        lane = lanes[name]
        ends = np.cumsum([0.0, *(s.end - s.start for s in stretches)])
        if stretches[0].lanelet == BEYOND:  # the gap is at its end
            ends += length_of(lane.centreline) - ends[-1]
        for stretch, (start, end) in zip(stretches, pairwise(ends.tolist()), strict=True):
            parts.setdefault(stretch.lanelet, []).append((stretch, cut(lane.centreline, start, end)))
        after = [numbers[i] for i in lane.successors]
        ways = [*pairwise(s.lanelet for s in stretches)]
        ways += [(stretches[-1].lanelet, named[other][0].lanelet) for other in after if other in named]
        for here, there in ways:
            if here != there:
                following.setdefault(here, set()).add(there)
        near = [named.get(numbers.get(i or 0, "")) for i in (lane.left, lane.right)]
        own = beside.setdefault(stretches[0].lanelet, [None, None])
        for side, other_stretches in enumerate(near):
            own[side] = other_stretches[0].lanelet if other_stretches else own[side]
    kinds = {s.lanelet: lanes[name].kind for name, stretches in named.items() for s in stretches}
    parts.pop(BEYOND, None)
    return {
        i: _lanelet(i, parts[i], kinds[i], sorted(following.get(i, set()) - {BEYOND}), beside.get(i))
        for i in sorted(parts)
    }


def _lanelet(
    number: int,
    parts: Sequence[tuple[LaneletPart, FloatArray]],
    kind: str,
    following: Sequence[int],
    beside: Sequence[int | None] | None,
) -> Lane:
    stretch, left, right = parts[0][0], *(beside or (None, None))
    line = _joined(parts)
    return Lane(
        lane_id=number,
        centreline=line,
        left_bound=line,
        right_bound=line,
        width_m=stretch.width,
        speed_limit_mps=stretch.speed,
        kind=kind,
        successors=tuple(following),
        left=left,
        right=right,
        adjacent_left=left,
        adjacent_right=right,
    )


def _joined(parts: Sequence[tuple[LaneletPart, FloatArray]]) -> FloatArray:
    lines: list[FloatArray] = []
    reached = -np.inf
    for stretch, line in sorted(parts, key=lambda part: (part[0].start, -part[0].end)):
        if stretch.end <= reached + 1e-6:
            continue
        lines.append(cut(line, max(reached - stretch.start, 0.0), length_of(line)))
        reached = stretch.end
    return _without_cuts(np.vstack(lines))


def _without_cuts(line: FloatArray) -> FloatArray:
    line = line[np.concatenate([[True], np.hypot(*np.diff(line, axis=0).T) > STRAIGHT_M])]
    kept = [0]
    for k in range(1, len(line) - 1):
        a, b, c = line[kept[-1]], line[k], line[k + 1]
        (dx, dy), (ex, ey) = c - a, b - a
        if abs(dx * ey - dy * ex) > STRAIGHT_M * max(float(np.hypot(dx, dy)), 1e-12):
            kept.append(k)
    return np.asarray(line[[*kept, len(line) - 1]])
