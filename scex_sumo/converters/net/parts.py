"""Stretches of lanelets under the lanes of a net that `convert` wrote.

Junctions hold the same ground under several lanes, so they are written into each lane.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias
from xml.etree.ElementTree import Element

from scex_sumo.converters.net.sumo_net import points_of
from scex_sumo.geometry.polylines import length_of

KEY = "lanelets"
JOINT_M = 0.05  # where road follows road, the lane between takes this much of both
BEYOND = 0  # road before or behind the map's border, and between lanelets that do not meet
CHANGED_M = 1e-3  # difference of lengths from which a lane was changed
GAP_M = 0.1  # between road beyond the border and a lane
_DRIVEN = ("normal", "", None, "internal")  # functions of edges


@dataclass(frozen=True)
class LaneletPart:
    """A stretch of a lanelet (or `BEYOND`) under a lane, in m along it; width and limit are the lanelet's."""

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


Named: TypeAlias = Mapping[str, tuple[LaneletPart, ...]]


def named_parts(root: Element) -> dict[str, tuple[LaneletPart, ...]] | None:
    """Return the stretches under each lane of a net.

    None if the net was changed since its conversion; empty if `convert` did not write it.
    """
    parts: dict[str, tuple[LaneletPart, ...]] = {}
    for lane in root.iter("lane"):
        text = next((p.get("value", "") for p in lane.iter("param") if p.get("key") == KEY), "")
        if not text:
            continue
        try:
            points = points_of(lane.get("shape", ""))
            words = [stretch.split(",") for stretch in text.split()]
            stretches = tuple(LaneletPart(int(lanelet), *map(float, numbers)) for lanelet, *numbers in words)
            allowed = CHANGED_M + GAP_M * any(s.lanelet == BEYOND for s in stretches)
            changed = abs(length_of(points) - sum(s.end - s.start for s in stretches)) > allowed
        except (ValueError, IndexError, TypeError):
            changed = True
        if changed:
            return None
        parts[lane.get("id", "")] = stretches
    return parts


def lanelet_places(named: Named, name: str) -> list[tuple[int, float]]:
    """Return a lane's lanelets and the arc lengths where it begins on them, m, without mere joints."""
    stretches = [s for s in named[name] if s.lanelet != BEYOND]
    long = [s for s in stretches if s.end - s.start > JOINT_M * 1.001]
    return list({s.lanelet: s.start for s in reversed(long or stretches)}.items())[::-1]


def lane_names(root: Element) -> list[str]:
    """Return SUMO's lanes of a net that become lanes of its road, in the order of the file."""
    edges = (edge for edge in root.iter("edge") if edge.get("function") in _DRIVEN)
    return [lane.get("id", "") for edge in edges for lane in edge.iter("lane")]


def lane_places(root: Element) -> list[tuple[str, list[tuple[int, float]]]]:
    """Return each lane of a net with (lane of its road under it, arc length in m where it begins there)."""
    named = named_parts(root)
    if named:
        return [(name, under) for name in named if (under := lanelet_places(named, name))]
    return [(name, [(k + 1, 0.0)]) for k, name in enumerate(lane_names(root))]
