"""Severity and fault of collisions: speed changes, P(MAIS 3+), class of each vehicle's part in it.

Perfectly plastic impact of two point masses: the speed change of a vehicle is the other's share of both
masses times the relative speed. P(MAIS 3+) of its occupant is a logistic curve of the speed change, a mean
over crash modes.

Sources: masses are the defaults of SUMO's vehicle classes; curves NHTSA DOT HS 813 219; classes of fault
after nuPlan's collision types (Caesar et al. 2021).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.geometry.rectangles import Rectangles
from scex_sumo.metrics.base import SceneTracks
from scex_sumo.metrics.collisions import KINDS, Collisions, Moves
from scex_sumo.road import Road
from scex_sumo.roads.matching import match

MASSES_KG: Final = {
    "car": ((6.0, 1500.0), (np.inf, 5000.0)),
    "van": ((6.0, 1500.0), (np.inf, 5000.0)),
    "truck": ((12.0, 4500.0), (np.inf, 13000.0)),
    "bus": ((13.0, 12000.0), (np.inf, 25000.0)),
    "motorcycle": ((np.inf, 200.0),),
}
"""Mass by type: pairs of a length in m and the mass in kg of vehicles up to that length.

SUMO's classes passenger, delivery; truck, trailer; bus, coach; motorcycle.
"""

CURVES: Final = {"mais2": (-5.1331, 0.1479), "mais3": (-6.9540, 0.1637), "fatal": (-8.9819, 0.1603)}
"""Intercept and slope per mph of the logistic curve of an occupant's injury, by level."""

COVERED: Final = frozenset(("car", "van"))
"""Types whose occupants the curves were fitted to; for others P(MAIS 3+) is undefined."""

FAULTS: Final = (
    "hits standing",
    "stands",
    "hits from behind",
    "leaves lane",
    "other leaves lane",
    "against priority",
    "other against priority",
)
"""Classes of the first vehicle's part in a collision; the first one that holds. It has the fault in
``hits standing``, ``hits from behind``, ``leaves lane`` and ``against priority``, else the other one."""

UNDECIDED: Final = -1
_NO_MASS = ((np.inf, np.nan),)
MPH: Final = 0.44704  # m/s
_STANDING_MPS = 0.05  # as nuPlan's
_OUTSIDE_M = 0.25  # a corner this far outside of its lane has left it


@dataclass(frozen=True, kw_only=True, eq=False)
class Severity:
    """Severity and fault of N collisions, (N,) each.

    Attributes:
        delta_v: speed change of the first vehicle, m/s; NaN if one of both has no mass.
        delta_v_other: of the second one.
        p_mais3: probability of a MAIS 3+ injury of an occupant of the first vehicle; NaN for types that the
            curve does not cover.
        p_mais3_other: of the second one.
        fault: index into `FAULTS`; -1 if undecided.
    """

    delta_v: FloatArray
    delta_v_other: FloatArray
    p_mais3: FloatArray
    p_mais3_other: FloatArray
    fault: IntArray

    def faults(self) -> list[str | None]:
        """Return the classes in words; None where undecided."""
        return [FAULTS[k] if k != UNDECIDED else None for k in self.fault.tolist()]


def masses(types: Sequence[str], length: FloatArray) -> FloatArray:
    """Return the mass (V,) of vehicles by type and length in m, kg; NaN for types not in `MASSES_KG`."""
    found = np.empty(len(types))
    for index, (kind, long) in enumerate(zip(types, np.asarray(length).tolist(), strict=True)):
        found[index] = next(mass for limit, mass in MASSES_KG.get(road_user(kind), _NO_MASS) if long <= limit)
    return found


def injury_probability(delta_v: FloatArray, level: str = "mais3") -> FloatArray:
    """Return the probability of an occupant's injury by the speed change in m/s; ``level`` of `CURVES`."""
    intercept, slope = CURVES[level]
    return np.asarray(1.0 / (1.0 + np.exp(-(intercept + slope * np.asarray(delta_v) / MPH))))


def severity_of(
    tracks: SceneTracks, hits: Collisions, types: Sequence[str], road: Road | None = None
) -> Severity:
    """Compute severity and fault of collisions.

    Args:
        tracks: the tracks that ``hits`` were found in, with lengths (V,).
        types: (V,) of the vehicles.
        road: lanes and right of way; without it only standing and rear-end collisions have a fault.
    """
    mass = masses(types, tracks.length)
    one, two = mass[hits.first], mass[hits.second]
    is_covered = np.array([road_user(kind) in COVERED for kind in types], dtype=np.bool_)
    changes = two / (one + two) * hits.relative_speed, one / (one + two) * hits.relative_speed
    risks = [
        np.where(is_covered[vehicle], injury_probability(change), np.nan)
        for vehicle, change in zip((hits.first, hits.second), changes, strict=True)
    ]
    return Severity(
        delta_v=changes[0],
        delta_v_other=changes[1],
        p_mais3=risks[0],
        p_mais3_other=risks[1],
        fault=_faults(tracks, hits, road),
    )


def _faults(tracks: SceneTracks, hits: Collisions, road: Road | None) -> IntArray:
    start = max(tracks.first - 1, 0)
    moves = Moves(tracks, hits.child, hits.step - 1, hits.first, hits.second)
    share = np.clip(hits.time_s / tracks.step_s - (moves.step - start), 0.0, 1.0)
    speeds = [moves.speed(vehicle, share) for vehicle in (hits.first, hits.second)]
    stands = [np.abs(speed) <= _STANDING_MPS for speed in speeds]
    none = np.zeros(len(hits), dtype=np.bool_)
    leaves, against = [none, none], [none, none]
    if road is not None and len(hits):
        leaves, against = _on_road(road, moves.poses(share))
    holds = [
        stands[1] & ~stands[0],
        stands[0] & ~stands[1],
        hits.kind == KINDS.index("rear-end"),
        leaves[0] & ~leaves[1],
        leaves[1] & ~leaves[0],
        against[0],
        against[1],
    ]
    return np.select(holds, range(len(FAULTS)), default=UNDECIDED).astype(np.int64)


def _on_road(road: Road, poses: tuple[Rectangles, Rectangles]) -> tuple[list[BoolArray], list[BoolArray]]:
    """Return (N,) whether either vehicle is outside of its lane, and whether it must give way."""
    lanes, leaves = [], []
    for pose in poses:
        found = match(road, pose.x, pose.y, pose.heading)
        vehicle, at = np.unique(found.vehicle, return_index=True)  # the most probable lane of each
        lane = np.full(len(pose.x), UNDECIDED)
        lane[vehicle] = found.lane_id[at]
        width = np.array([road.lanes[k].width_m for k in found.lane_id[at].tolist()])
        turn, half = found.heading_error[at], pose.half_length[vehicle]
        reach = half * np.abs(np.sin(turn)) + pose.half_width[vehicle] * np.abs(np.cos(turn))
        out = np.ones(len(pose.x), dtype=np.bool_)
        out[vehicle] = np.abs(found.offset[at]) + reach > width / 2 + _OUTSIDE_M
        lanes.append(lane)
        leaves.append(out)
    yielding = _yielding(road)
    pairs = [(_with_before(road, a), _with_before(road, b)) for a, b in zip(*lanes, strict=True)]
    against = [
        _flags([any((a, b) in yielding for a in one for b in two) for one, two in order])
        for order in (pairs, [(two, one) for one, two in pairs])
    ]
    return leaves, [against[0] & ~against[1], against[1] & ~against[0]]


def _flags(values: Sequence[bool]) -> NDArray[np.bool_]:
    return np.array(values, dtype=np.bool_)


def _yielding(road: Road) -> set[tuple[int, int]]:
    """Return the pairs of a lane that must give way and a lane that has priority over it."""
    rules = [rule for rule in road.regulations if rule.kind != "all_way_stop"]
    return {(a, b) for rule in rules for a in rule.yielding for b in rule.priority}


def _with_before(road: Road, lane: int) -> tuple[int, ...]:
    """Return a lane and those before it: rules name the approach to a conflict; none off the lanes."""
    return (lane, *road.lanes[lane].predecessors) if lane in road.lanes else ()
