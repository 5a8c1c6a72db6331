"""Right-of-way figures of a net: foes, who gives way, signals."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import combinations
from typing import Any

import numpy as np
import shapely

from scex_sumo.converters.net.reader import NetContent, SumoLink
from scex_sumo.judge.conflicts import NEAR_M, JudgedConflict, find_conflicts
from scex_sumo.judge.matching import Matching, angle_between

Pair = tuple[int, int]

ZIPPER = "Z"  # SUMO's state for links that take turns
GREENS = "GgoOsu"  # signal states in which a car may go, if need be after looking
END_M = 2.0  # of a lane, for its direction
RIGHT_RAD = (np.deg2rad(45.0), np.deg2rad(135.0))  # of traffic from the right


def judge_priority(matching: Matching) -> dict[str, Any]:
    """Compare the requests of the net's junctions with conflicts and rules of the map.

    Pairs are lanelet ids (should yield, should go first).
    """
    net, road, links = matching.net, matching.road, Links(matching)
    conflicts = find_conflicts(road.vehicle_lanes)
    missing, apart = _missing_foes(links, conflicts)
    regulated, wrong = _regulated(links, conflicts)
    unregulated, wrong_right = _from_the_right(links, conflicts)
    lit = {i for rule in road.regulations if rule.kind == "traffic_light" for i in rule.lanes}
    lit = {i for i in lit if i in road.vehicle_lanes and links.of(i)}
    return {
        "conflicts": len(conflicts),
        "crossing": sum(conflict.kind == "cross" for conflict in conflicts),
        "merging": sum(conflict.kind == "merge" for conflict in conflicts),
        "missing_foes": missing,
        "foes_apart": apart,
        "regulated_pairs": regulated,
        "wrong_priority": wrong,
        "signalled": len(lit),
        "missing_signals": tuple(i for i in sorted(lit) if not _controlled(links, i)),
        "clashing_greens": _named(p for p in links.pairs() if links.are_foes(*p) and _both(net, *p, "G")),
        "from_the_right": unregulated,
        "wrong_from_the_right": wrong_right,
        "mutual_yields": _named(_mutual(links)),
        "free_foes": _named(p for p in links.pairs() if _free(links, *p)),
        "inconsistent_rows": _inconsistent(net),
    }


def _named(pairs: Iterable[tuple[SumoLink, SumoLink]]) -> tuple[tuple[str, str], ...]:
    return tuple((one.via[0], other.via[0]) for one, other in pairs)


def _controlled(links: Links, lane_id: int) -> bool:
    ways = (links.of(lane_id), links.leaving(lane_id))
    return any(all(_lit(links.net, link) for link in held) for held in ways if held)


def _lit(net: NetContent, link: SumoLink) -> bool:
    return any(link.signal_index < len(state) for state in net.phases.get(link.signal, ()))


def _missing_foes(
    links: Links, conflicts: Iterable[JudgedConflict]
) -> tuple[tuple[Pair, ...], tuple[Pair, ...]]:
    missing, apart = [], []
    for conflict in conflicts:
        pair = (conflict.first, conflict.second)
        pairs = links.meetings(*pair)
        if not pairs and (links.one_source(*pair) or links.foes_before(*pair)):
            continue
        if not pairs or not all(links.are_foes(a, b) for a, b in pairs):
            missing.append(pair)
            if not any(a.junction == b.junction for a, b in pairs):
                apart.append(pair)
    return tuple(missing), tuple(apart)


def _regulated(links: Links, conflicts: Iterable[JudgedConflict]) -> tuple[int, tuple[Pair, ...]]:
    meeting = {pair for c in conflicts for pair in ((c.first, c.second), (c.second, c.first))}
    rules = (rule for rule in links.matching.road.regulations if rule.kind != "all_way_stop")
    ruled = {(y, p) for rule in rules for y in rule.yielding for p in rule.priority if y != p}
    count, wrong = 0, []
    for yielding, priority in sorted(ruled):
        if (priority, yielding) in ruled:
            continue  # the map contradicts itself
        met = [
            (one, other)
            for one in links.ahead(yielding)
            for other in links.ahead(priority)
            if one is not other and one.from_lane != other.from_lane
            # They meet behind the lanelets that the rule names.
            if any(
                (a, b) in meeting
                for a in links.lanelets(one) | {yielding}
                for b in links.lanelets(other) | {priority}
            )
        ]
        count += bool(met)
        # A lanelet in several pieces meets different lanelets with different ones of them.
        near = [pair for pair in met if links.are_near(*pair)]
        near = near or [
            pair
            for one, other in met
            for a in links.lanelets(one) | {yielding}
            for b in links.lanelets(other) | {priority}
            if (a, b) in meeting
            for pair in links.meetings(a, b)
        ]
        if not all(links.waits(one, other) for one, other in near or met):
            wrong.append((yielding, priority))
    return count, tuple(wrong)


def _from_the_right(links: Links, conflicts: Iterable[JudgedConflict]) -> tuple[int, tuple[Pair, ...]]:
    rules = links.matching.road.regulations
    ruled = {i for rule in rules for i in (*rule.lanes, *rule.yielding, *rule.priority)}
    count, wrong = 0, []
    for conflict in conflicts:
        order = (conflict.first, conflict.second)
        if conflict.kind != "cross" or not RIGHT_RAD[0] <= abs(conflict.turn_rad) <= RIGHT_RAD[1]:
            continue
        both = [link for i in order for link in links.of(i)]
        if any(link.signal or links.lanelets(link, approach=True) & ruled for link in both):
            continue
        # A positive turn: the second's heading lies to the left of the first's, so it comes from the right.
        order = order if conflict.turn_rad > 0 else order[::-1]
        pairs = [(a, b) for a, b in links.meetings(*order) if links.are_foes(a, b)]
        if pairs and not all(_opposed(links, a, b) for a, b in pairs):
            count += 1
            if not all(links.waits(a, b) for a, b in pairs):
                wrong.append(order)
    return count, tuple(wrong)


def _opposed(links: Links, one: SumoLink, other: SumoLink) -> bool:
    ends = [links.net.lanes[link.from_lane].line for link in (one, other)]
    # Over some length, because the last segment may be tiny.
    tips = [(np.array(line.interpolate(-END_M).xy), np.array(line.coords[-1])) for line in ends]
    ways = [np.arctan2(*(tip - before[:, 0])[::-1]) for before, tip in tips]
    return not RIGHT_RAD[0] <= abs(angle_between(*ways)) <= RIGHT_RAD[1]


def _mutual(links: Links) -> Iterator[tuple[SumoLink, SumoLink]]:
    rules = (rule for rule in links.matching.road.regulations if rule.kind == "all_way_stop")
    stops = {i for rule in rules for i in (rule.yielding or rule.lanes)}
    for one, other in links.pairs():
        if not (links.yields(one, other) and links.yields(other, one)):
            continue
        if links.net.junctions[one.junction].kind == "allway_stop" or one.state == other.state == ZIPPER:
            continue
        stopped = all(links.lanelets(link, approach=True) & stops for link in (one, other))
        if not stopped and _both(links.net, one, other, GREENS) is not False:
            yield one, other


def _both(net: NetContent, one: SumoLink, other: SumoLink, letters: str) -> bool | None:
    states = net.phases.get(one.signal)
    if states is None or one.signal != other.signal:
        return None
    last = max(one.signal_index, other.signal_index)
    return any(
        last < len(state) and state[one.signal_index] in letters and state[other.signal_index] in letters
        for state in states
    )


def _free(links: Links, one: SumoLink, other: SumoLink) -> bool:
    free = not links.yields(one, other) and not links.yields(other, one)
    return free and links.are_foes(one, other) and not (one.signal and other.signal)


def _inconsistent(net: NetContent) -> tuple[str, ...]:
    return tuple(
        sorted(
            name
            for name, junction in net.junctions.items()
            if (junction.foes != junction.foes.T).any() or (junction.response & ~junction.foes).any()
        )
    )


JOINT_M = 0.25  # a link this short without foes is none to meet on
AHEAD_LINKS = 4  # an approach may lie this many plain links before its intersection


class Links:
    """Links of a net by the lanelets that they lead through, leave or approach."""

    def __init__(self, matching: Matching) -> None:
        self.matching = matching
        self.net = matching.net
        self._lines: dict[SumoLink, shapely.MultiLineString] = {}
        self._through: dict[int, list[SumoLink]] = defaultdict(list)
        self._leaving: dict[str, list[SumoLink]] = defaultdict(list)
        self._lanelets: dict[SumoLink, set[int]] = {}
        for link in self.net.links:
            self._lanelets[link] = {i for lane in link.via for i in matching.lanelets(lane)}
            self._leaving[link.from_lane].append(link)
            for lane_id in self._lanelets[link]:
                self._through[lane_id].append(link)

    def lanelets(self, link: SumoLink, *, approach: bool = False) -> set[int]:
        """Return the lanelets that a link leads through; ``approach`` adds those on the lane before it."""
        before = self.matching.lanelets(link.from_lane) if approach else set()
        return self._lanelets[link] | before

    def of(self, lane_id: int) -> list[SumoLink]:
        """Return the links through a lanelet or leaving it."""
        lanes = {name for name in self.matching.names(lane_id) if not self.net.lanes[name].internal}
        return list(dict.fromkeys([*self._through.get(lane_id, ()), *self._from(lanes)]))

    def leaving(self, lane_id: int) -> list[SumoLink]:
        """Return the links from a lanelet's own lanes onto others."""
        lanes = {name for name in self.matching.names(lane_id) if not self.net.lanes[name].internal}
        return [k for k in self._from(lanes) if lane_id not in self.matching.lanelets(k.to_lane)]

    def meetings(self, first_id: int, second_id: int) -> list[tuple[SumoLink, SumoLink]]:
        """Return pairs of links from different lanes with which two lanelets get in each other's way."""
        return [
            (one, other)
            for one in self._links_between(first_id, second_id)
            for other in self._links_between(second_id, first_id)
            if one.from_lane != other.from_lane and self.are_near(one, other)
        ]

    def foes_before(self, first_id: int, second_id: int) -> bool:
        """Whether links are foes without a meeting, because one lanelet ends within the other."""
        leaving = any(not self.matching.road.lanes[i].successors for i in (first_id, second_id))
        pairs = ((one, other) for one in self.of(first_id) for other in self.of(second_id))
        return leaving and any(self.are_foes(*pair) for pair in pairs)

    def are_near(self, one: SumoLink, other: SumoLink) -> bool:
        """Whether two links come as near to each other as a conflict does."""
        return bool(self._line(one).distance(self._line(other)) <= NEAR_M)

    def one_source(self, first_id: int, second_id: int) -> bool:
        """Whether cars come to both lanelets from only one SUMO lane."""
        first, second = ({link.from_lane for link in self.of(i)} for i in (first_id, second_id))
        return first == second and len(first) == 1

    def ahead(self, lane_id: int) -> list[SumoLink]:
        """Return links with foes of a lanelet or, for an approach, ahead of it; else its own."""
        links = self.of(lane_id)
        for _ in range(AHEAD_LINKS):
            contested = [k for k in links if k.row >= 0 and self.net.junctions[k.junction].foes[k.row].any()]
            if contested:
                return contested
            links = self._from({link.to_lane for link in links})
        return self.of(lane_id)

    def yields(self, one: SumoLink, other: SumoLink) -> bool:
        """Whether the first of two links of one junction gives way to the second."""
        return bool(self.net.junctions[one.junction].response[one.row, other.row])

    def are_foes(self, one: SumoLink, other: SumoLink) -> bool:
        """Whether two links are foes, in both rows."""
        if one.junction != other.junction or one.row < 0 or other.row < 0:
            return False
        foes = self.net.junctions[one.junction].foes
        return bool(foes[one.row, other.row] and foes[other.row, one.row])

    def waits(self, one: SumoLink, other: SumoLink) -> bool:
        """Whether the first of two foes gives way, and the second does not."""
        return self.are_foes(one, other) and self.yields(one, other) and not self.yields(other, one)

    def pairs(self) -> Iterator[tuple[SumoLink, SumoLink]]:
        """Every pair of links that have rows in one junction, once."""
        rows: dict[str, dict[int, SumoLink]] = defaultdict(dict)
        for link in self.net.links:
            if link.row >= 0:
                rows[link.junction][link.row] = link
        for of_junction in rows.values():
            yield from combinations((link for _, link in sorted(of_junction.items())), 2)

    def _from(self, lanes: Iterable[str]) -> list[SumoLink]:
        return [link for lane in sorted(lanes) for link in self._leaving.get(lane, ())]

    def _links_between(self, lane_id: int, other_id: int) -> list[SumoLink]:
        other = shapely.LineString(self.matching.road.lanes[other_id].centreline)
        return [
            link
            for link in self.of(lane_id)
            if not self._is_joint(link) and self._line(link).distance(other) <= NEAR_M
        ]

    def _is_joint(self, link: SumoLink) -> bool:
        foes = link.row >= 0 and self.net.junctions[link.junction].foes[link.row].any()
        return not foes and self._line(link).length < JOINT_M

    def _line(self, link: SumoLink) -> shapely.MultiLineString:
        if link not in self._lines:
            shapes = [self.net.lanes[lane].shape for lane in link.via]
            # Nets without internal lanes: the link is the place where its lanes meet.
            self._lines[link] = shapely.MultiLineString(shapes or [self.net.lanes[link.from_lane].shape[-2:]])
        return self._lines[link]
