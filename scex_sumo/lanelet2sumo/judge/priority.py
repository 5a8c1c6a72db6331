"""Right of way of a net beside the map's rules: links that give way, signals."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import product
from typing import TypeAlias

import numpy as np
import shapely

from scex_sumo.base.arrays import BoolArray
from scex_sumo.converters.net.links import SumoLink
from scex_sumo.lanelet2sumo.judge.matching import Matching

Pair: TypeAlias = tuple[int, int]
LinkPair: TypeAlias = tuple[SumoLink, SumoLink]

NEAR_M = 1.5  # lines this near: two cars (1.8 m wide) cannot pass there side by side
JOINT_M = 0.25  # a link this short without foes is none to meet on
AHEAD_LINKS = 4  # an approach may lie this many plain links before its intersection


class RightOfWay:
    """Requests of a net's junctions beside the rules of the map.

    Attributes:
        regulated: number of pairs with a rule; ``wrong`` (should yield, should go) are the net's mistakes.
        signalled: lanelets with a traffic light.
    """

    def __init__(self, matching: Matching, meeting: Iterable[Pair]) -> None:
        """Judge a net by the pairs of lanelets that meet, in any order."""
        self.net, self.rules = matching.net, matching.road.regulations
        self.lanes = matching.road.vehicle_lanes
        self.links = links = Links(matching)
        self.regulated, self.wrong = 0, list[Pair]()
        rules = [rule for rule in self.rules if rule.kind != "all_way_stop"]
        ruled = {(y, p) for rule in rules for y in rule.yielding for p in rule.priority if y != p}
        # A rule of an approach says nothing against a rule of these two.
        places = {pair for a, b in meeting for pair in ((a, b), (b, a))} - {(p, y) for y, p in ruled}
        for yielding, priority in sorted(ruled):
            if (priority, yielding) not in ruled:  # else the map contradicts itself
                self._judge_rule(yielding, priority, places)
        lit = {i for rule in self.rules if rule.kind == "traffic_light" for i in rule.lanes}
        self.signalled = sorted(i for i in lit if i in self.lanes and links.of(i))

    def _judge_rule(self, yielding: int, priority: int, meeting: set[Pair]) -> None:
        links = self.links
        met: dict[LinkPair, list[Pair]] = {}
        for link, other in product(links.ahead(yielding), links.ahead(priority)):
            # They meet behind the lanelets that the rule names.
            on = product(links.lanelets(link) | {yielding}, links.lanelets(other) | {priority})
            places = [pair for pair in on if pair in meeting]
            if places and link is not other and link.from_lane != other.from_lane:
                met[link, other] = places
        self.regulated += bool(met)
        near = [pair for pair in met if links.are_near(*pair)]
        # A lanelet in several pieces meets different lanelets with different ones of them.
        near = near or [
            pair for places in met.values() for place in places for pair in links.meetings(*place)
        ]
        if not all(links.waits(link, other) for link, other in (near or met)):
            self.wrong.append((yielding, priority))

    def missing_signals(self) -> list[int]:
        """Return the lanelets with a traffic light that nothing controls."""
        links = {i: (self.links.of(i), self.links.leaving(i)) for i in self.signalled}
        return [i for i in self.signalled if not any(held and all(map(self._lit, held)) for held in links[i])]

    def _lit(self, link: SumoLink) -> bool:
        return any(link.signal_index < len(state) for state in self.net.phases.get(link.signal, ()))


class Links:
    """Links of a net by the lanelets that they lead through, leave or approach."""

    def __init__(self, matching: Matching) -> None:
        self.matching, self.net = matching, matching.net
        self._lines: dict[SumoLink, shapely.MultiLineString] = {}
        self._through: dict[int, list[SumoLink]] = defaultdict(list)
        self._leaving: dict[str, list[SumoLink]] = defaultdict(list)
        self._lanelets = {k: {i for lane in k.via for i in matching.lanelets(lane)} for k in self.net.links}
        for link, under in self._lanelets.items():
            self._leaving[link.from_lane].append(link)
            for lane_id in under:
                self._through[lane_id].append(link)

    def lanelets(self, link: SumoLink) -> set[int]:
        """Return the lanelets that a link leads through."""
        return self._lanelets[link]

    def of(self, lane_id: int) -> list[SumoLink]:
        """Return the links through a lanelet and from its lanes."""
        return list(dict.fromkeys([*self._through.get(lane_id, ()), *self._from_lanes_of(lane_id)]))

    def leaving(self, lane_id: int) -> list[SumoLink]:
        """Return the links from a lanelet to others."""
        links = self._from_lanes_of(lane_id)
        return [link for link in links if lane_id not in self.matching.lanelets(link.to_lane)]

    def _from_lanes_of(self, lane_id: int) -> list[SumoLink]:
        return self._from(n for n in self.matching.names(lane_id) if not self.net.lanes[n].internal)

    def _from(self, lanes: Iterable[str]) -> list[SumoLink]:
        return [link for lane in sorted({*lanes}) for link in self._leaving.get(lane, ())]

    def meetings(self, first_id: int, second_id: int) -> list[LinkPair]:
        """Return pairs of links from different lanes with which two lanelets get in each other's way."""
        return [
            (link, other)
            for link in self._links_near(first_id, second_id)
            for other in self._links_near(second_id, first_id)
            if link.from_lane != other.from_lane and self.are_near(link, other)
        ]

    def _links_near(self, lane_id: int, other_id: int) -> Iterator[SumoLink]:
        other = shapely.LineString(self.matching.road.lanes[other_id].centreline)
        for link in self.of(lane_id):
            joint = not self._foes(link).any() and self._line(link).length < JOINT_M
            if not joint and self._line(link).distance(other) <= NEAR_M:
                yield link

    def are_near(self, link: SumoLink, other: SumoLink) -> bool:
        """Return whether cars on two links get in each other's way."""
        return bool(self._line(link).distance(self._line(other)) <= NEAR_M)

    def ahead(self, lane_id: int) -> list[SumoLink]:
        """Return links with foes of a lanelet or, for an approach, ahead of it; else its own."""
        links = self.of(lane_id)
        for _ in range(AHEAD_LINKS):
            if contested := [link for link in links if self._foes(link).any()]:
                return contested
            links = self._from(link.to_lane for link in links)
        return self.of(lane_id)

    def _foes(self, link: SumoLink) -> BoolArray:
        return self.net.junctions[link.junction].foes[link.row] if link.row >= 0 else np.zeros(0, np.bool_)

    def yields(self, link: SumoLink, other: SumoLink) -> bool:
        """Return whether a link gives way to another one of its junction."""
        return bool(self.net.junctions[link.junction].response[link.row, other.row])

    def are_foes(self, link: SumoLink, other: SumoLink) -> bool:
        """Return whether a junction knows that two links are in each other's way."""
        rows = link.junction == other.junction and link.row >= 0 and other.row >= 0
        return rows and bool(self._foes(link)[other.row] and self._foes(other)[link.row])

    def waits(self, link: SumoLink, other: SumoLink) -> bool:
        """Return whether only the first of two foes gives way."""
        return self.are_foes(link, other) and self.yields(link, other) and not self.yields(other, link)

    def _line(self, link: SumoLink) -> shapely.MultiLineString:
        if link not in self._lines:
            shapes = [self.net.lanes[lane].shape for lane in link.via]
            # Nets without internal lanes: the link is the place where its lanes meet.
            self._lines[link] = shapely.MultiLineString(shapes or [self.net.lanes[link.from_lane].shape[-2:]])
        return self._lines[link]
