"""Lanelets under the lanes of a converted net: which parts of which, so that a reader can put them together.

A net has the geometry of its map, but cut at junctions, and the same ground under several lanes within them.
Where `convert` wrote it, each lane names the stretches of lanelets that it runs over.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias
from xml.etree import ElementTree

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.geometry.polylines import cut, length_of
from scex_sumo.road import Lane

KEY = "lanelets"
CHANGED_M = 1e-3  # a lane whose length differs this much from that of its stretches was drawn anew
JOINT_M = 0.05  # where road follows road, the lane between takes this much of both
BEYOND = 0  # stands for road that the map does not have, where lanes fork or join at its border
GAP_M = 0.1  # such road may end this far beside a lane
STRAIGHT_M = 5e-9  # a point this near to the line between its neighbours is none of the map's

Named: TypeAlias = Mapping[str, tuple["LaneletPart", ...]]


@dataclass(frozen=True)
class LaneletPart:
    """Part of a lanelet under a lane of a net.

    Attributes:
        lanelet: its id, or `BEYOND`.
        start: arc length on the lanelet's centreline, m.
        end: the same.
        width: of the whole lanelet, m.
        speed: its limit, m/s.
    """

    lanelet: int
    start: float
    end: float
    width: float
    speed: float


def parts_text(stretches: Iterable[LaneletPart]) -> str:
    """What is written into the net."""
    return " ".join(
        ",".join([str(s.lanelet), *(f"{v:.9f}" for v in (s.start, s.end, s.width, s.speed))])
        for s in stretches
    )


def named_parts(root: ElementTree.Element) -> dict[str, tuple[LaneletPart, ...]] | None:
    """The stretches under each lane of a net, none where it names none.

    Args:
        root: of the net.

    Returns:
        None where the net was changed since, so that its lanes are no longer what they were made of; nothing
        at all where `convert` did not write it.
    """
    found: dict[str, tuple[LaneletPart, ...]] = {}
    for lane in root.iter("lane"):
        text = next((p.get("value", "") for p in lane.iter("param") if p.get("key") == KEY), "")
        if not text:
            continue
        try:
            points = np.array([[float(v) for v in p.split(",")[:2]] for p in lane.get("shape", "").split()])
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
    """Lanelets of a lane, and where it begins on them, m; without mere joints to the roads around it."""
    stretches = [s for s in named[name] if s.lanelet != BEYOND]
    long = [s for s in stretches if s.end - s.start > JOINT_M * 1.001]
    return list({s.lanelet: s.start for s in reversed(long or stretches)}.items())[::-1]


def put_together(named: Named, lanes: Mapping[str, Lane]) -> dict[int, Lane]:
    """The lanelets of a net, each joined from the lanes that run over it.

    Args:
        named: the stretches under each lane.
        lanes: the net's lanes by name, numbered, connected, with their neighbours.

    Returns:
        By lanelet id; without bounds, predecessors and conflicts. Lanes that name no lanelet are left out.
    """
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
    """Centreline of a lanelet from parts that may cover the same ground, in any order."""
    lines: list[FloatArray] = []
    reached = -np.inf
    for stretch, line in sorted(parts, key=lambda part: (part[0].start, -part[0].end)):
        if stretch.end <= reached + 1e-6:
            continue
        lines.append(cut(line, max(reached - stretch.start, 0.0), length_of(line)))
        reached = stretch.end
    return _without_cuts(np.vstack(lines))


def _without_cuts(line: FloatArray) -> FloatArray:
    """A polyline without the points where it was cut: they repeat, or lie on a straight line."""
    line = line[np.concatenate([[True], np.hypot(*np.diff(line, axis=0).T) > STRAIGHT_M])]
    kept = [0]
    for k in range(1, len(line) - 1):
        a, b, c = line[kept[-1]], line[k], line[k + 1]
        (dx, dy), (ex, ey) = c - a, b - a
        if abs(dx * ey - dy * ex) > STRAIGHT_M * max(float(np.hypot(dx, dy)), 1e-12):
            kept.append(k)
    return np.asarray(line[[*kept, len(line) - 1]])
