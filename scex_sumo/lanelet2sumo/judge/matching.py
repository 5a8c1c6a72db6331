"""SUMO lanes of a net beside the lanelets of its map: coverage, deviation, speed limits, connections."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.sumo_net import LaneTable
from scex_sumo.geometry.polylines import samples
from scex_sumo.lanelet2sumo.reader import NetContent, SumoLane
from scex_sumo.road import Lane, Road

SAMPLE_M = 0.5
ENDS_NEAR_M = 2.5  # from a lanelet's end to a SUMO lane beside it
COVERED = 0.9  # share of a lanelet's length from which it counts as covered
PRESENT_M = 1.0  # from a lanelet to SUMO lanes that stand for it
WORST_M = 0.1  # deviations from here on are named
SPEED_TOLERANCE_MPS = 0.01  # nets are written with two or three decimals
JOIN_M = 0.1  # stretches of one SUMO lane that overlap by less follow one another


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Piece of a SUMO lane that stands for a lanelet; ``end_m`` ≤ ``start_m`` in the opposite direction."""

    lane_id: int
    sumo_lane: str
    start_m: float
    end_m: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Matching:
    """A net beside its map; stretches of SUMO lanes are in driving order."""

    net: NetContent
    road: Road
    by_lanelet: Mapping[int, Sequence[Stretch]]
    by_sumo_lane: Mapping[str, Sequence[Stretch]]

    def names(self, lane_id: int) -> list[str]:
        """Return the SUMO lanes of a lanelet."""
        return [stretch.sumo_lane for stretch in self.by_lanelet.get(lane_id, ())]

    def lanelets(self, sumo_lane: str) -> set[int]:
        """Return the lanelets that a SUMO lane stands for."""
        return {stretch.lane_id for stretch in self.by_sumo_lane.get(sumo_lane, ())}

    @cached_property
    def driven(self) -> dict[str, list[Stretch]]:
        """Stretches of each SUMO lane for cars that stand for lanelets for vehicles."""
        lanes, on = self.road.vehicle_lanes, self.by_sumo_lane
        return {name: [s for s in on.get(name, ()) if s.lane_id in lanes] for name in self.net.car_lanes}

    def onward(self) -> dict[Stretch, set[Stretch]]:
        """Return the stretches that a car enters after each stretch."""
        following = self.net.following
        moves: dict[Stretch, set[Stretch]] = {}
        for name, on in self.driven.items():
            entered = [*following.get(name, ())]
            for lane in entered:  # grows
                if not self.driven.get(lane):
                    entered += [other for other in following.get(lane, ()) if other not in entered]
            onward = {s for lane in entered for s in _first(self.driven.get(lane, ()))}
            for stretch in on:
                moves[stretch] = _first(other for other in on if _precedes(stretch, other)) or {*onward}
        return moves


def _first(stretches: Iterable[Stretch]) -> set[Stretch]:
    among = list(stretches)
    return {s for s in among if not any(_precedes(other, s) for other in among)}


def _precedes(stretch: Stretch, other: Stretch) -> bool:
    return other.start_m >= stretch.end_m - JOIN_M and not stretch.start_m >= other.end_m - JOIN_M


def match_lanelets(net: NetContent, road: Road, lanes: LaneTable) -> Matching:
    """Put the SUMO lanes of a net beside their lanelets."""
    named = [(i, name) for i in road.lanes for name in lanes.sumo_lanes(i) if name in net.lanes]
    on = [_stretch(road.lanes[i], name, net.lanes[name].line) for i, name in named]
    by_lanelet, by_sumo_lane = defaultdict[int, list[Stretch]](list), defaultdict[str, list[Stretch]](list)
    for stretch in on:
        by_lanelet[stretch.lane_id].append(stretch)
    for stretch in sorted(on, key=lambda s: (s.start_m, s.end_m)):
        by_sumo_lane[stretch.sumo_lane].append(stretch)
    return Matching(net=net, road=road, by_lanelet=by_lanelet, by_sumo_lane=by_sumo_lane)


def _stretch(lane: Lane, sumo_lane: str, line: shapely.LineString) -> Stretch:
    start, end = 0.0, float(line.length)
    if line.length > 0.0:  # SUMO's shortest connectors may be one point
        ends = shapely.points(lane.centreline[[0, -1]])
        places = shapely.line_locate_point(line, ends)
        # Where an end of the lanelet is far away, the SUMO lane is a piece of it up to its own end.
        begins, stops = shapely.distance(line, ends) <= ENDS_NEAR_M
        start, end = float(places[0]) if begins else start, float(places[1]) if stops else end
    return Stretch(lane_id=lane.lane_id, sumo_lane=sumo_lane, start_m=start, end_m=end)


class Shapes:
    """Distances of lanelets and SUMO lanes, sampled every 0.5 m, and how the lanes lead on.

    Attributes:
        covered: lanelets for vehicles under SUMO lanes for cars.
        deviations: (N,) m, from lanelets to SUMO lanes and back.
        worst: (lanelet, largest deviation in m), the largest first.
        wrong_speeds: (lanelet, its limit, the SUMO lane's), m/s.
        successors: pairs of lanelets; ``joined`` are the net's.
    """

    def __init__(self, matching: Matching) -> None:
        net, lanes = matching.net, matching.road.lanes
        self.lanelets = vehicle = matching.road.vehicle_lanes
        on = {i: [net.lanes[n] for n in matching.names(i) if net.lanes[n].cars] for i in vehicle}
        forth = {i: _distances(lanes[i].centreline, own) for i, own in on.items() if own}
        self.covered = [i for i in sorted(forth) if np.mean(forth[i] <= PRESENT_M) >= COVERED]
        wrong = (_wrong_speed(matching, i, on[i]) for i in self.covered)
        self.wrong_speeds = [entry for entry in wrong if entry is not None]
        worst = {i: float(off.max()) for i, off in forth.items()}
        pooled = list(forth.values())
        for name in matching.by_sumo_lane:
            under = matching.lanelets(name)
            if name in net.car_lanes and under & vehicle.keys():
                pooled.append(_back(net.lanes[name], [lanes[i] for i in under]))
                for i in under:
                    worst[i] = max(worst.get(i, 0.0), float(pooled[-1].max(initial=0.0)))
        self.deviations = np.concatenate(pooled) if forth else np.array([np.nan])
        self.worst = sorted(((i, m) for i, m in worst.items() if m > WORST_M), key=lambda entry: -entry[1])
        joined = {(s.lane_id, t.lane_id) for s, onward in matching.onward().items() for t in onward}
        self.joined = {(i, j) for i, j in joined if i != j}
        self.successors = {(i, j) for i in vehicle for j in vehicle[i].successors if j in vehicle and i != j}


def _distances(points: FloatArray, lanes: list[SumoLane]) -> FloatArray:
    union = shapely.MultiLineString([lane.shape for lane in lanes])
    return np.asarray(shapely.distance(shapely.points(samples(points, SAMPLE_M)[1]), union), dtype=np.float64)


def _back(sumo_lane: SumoLane, lanelets: list[Lane]) -> FloatArray:
    points = shapely.points(samples(sumo_lane.shape, SAMPLE_M)[1])
    lines = [shapely.LineString(lane.centreline) for lane in lanelets]
    off = np.min([shapely.distance(points, line) for line in lines], axis=0)
    places = [(shapely.line_locate_point(line, points), line.length) for line in lines]
    return np.asarray(off[np.any([(s > 0.0) & (s < length) for s, length in places], axis=0)])


def _wrong_speed(matching: Matching, lane_id: int, lanes: list[SumoLane]) -> tuple[int, float, float] | None:
    vehicle = matching.road.vehicle_lanes
    for lane in lanes:
        # One SUMO lane across several lanelets can have the limit of one of them only.
        limits = [vehicle[i].speed_limit_mps for i in matching.lanelets(lane.lane_id) if i in vehicle]
        if min(abs(lane.speed_mps - limit) for limit in limits) > SPEED_TOLERANCE_MPS:
            return lane_id, vehicle[lane_id].speed_limit_mps, lane.speed_mps
    return None
