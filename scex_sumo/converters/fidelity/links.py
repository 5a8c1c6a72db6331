"""Links of a net by the lanelets they lead through, leave or approach."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import combinations

import shapely

from scex_sumo.converters.fidelity.conflicts import NEAR_M
from scex_sumo.converters.fidelity.matching import Matching
from scex_sumo.converters.fidelity.net import JudgedLink

JOINT_M = 0.25  # a link this short without foes is none to meet on
AHEAD_LINKS = 4  # an approach may lie this many plain links before its intersection


class Links:
    """The net's links, found by the lanelets they lead through, leave or approach."""

    def __init__(self, matching: Matching) -> None:
        self.matching = matching
        self.net = matching.net
        self._lines: dict[JudgedLink, shapely.MultiLineString] = {}
        self._through: dict[int, list[JudgedLink]] = defaultdict(list)
        self._leaving: dict[str, list[JudgedLink]] = defaultdict(list)
        self._lanelets: dict[JudgedLink, set[int]] = {}
        for link in self.net.links:
            self._lanelets[link] = {i for lane in link.via for i in matching.lanelets(lane)}
            self._leaving[link.from_lane].append(link)
            for lane_id in self._lanelets[link]:
                self._through[lane_id].append(link)

    def lanelets(self, link: JudgedLink, *, approach: bool = False) -> set[int]:
        """Lanelets that a link leads through, with those on the lane that it leaves if wanted."""
        before = self.matching.lanelets(link.from_lane) if approach else set()
        return self._lanelets[link] | before

    def of(self, lane_id: int) -> list[JudgedLink]:
        """Links through a lanelet, its first and last centimetres included, or leaving it."""
        lanes = {name for name in self.matching.names(lane_id) if not self.net.lanes[name].internal}
        return list(dict.fromkeys([*self._through.get(lane_id, ()), *self._from(lanes)]))

    def leaving(self, lane_id: int) -> list[JudgedLink]:
        """Links from a lanelet's own lanes onto others."""
        lanes = {name for name in self.matching.names(lane_id) if not self.net.lanes[name].internal}
        return [k for k in self._from(lanes) if lane_id not in self.matching.lanelets(k.to_lane)]

    def meetings(self, first_id: int, second_id: int) -> list[tuple[JudgedLink, JudgedLink]]:
        """Pairs of links with which two lanelets get in each other's way, from different lanes.

        Cars from one lane come one after the other; SUMO needs no foes for them.
        """
        return [
            (one, other)
            for one in self._met(first_id, second_id)
            for other in self._met(second_id, first_id)
            if one.from_lane != other.from_lane and self.are_near(one, other)
        ]

    def foes_before(self, first_id: int, second_id: int) -> bool:
        """Whether links of two lanelets are foes though they do not meet: one leaves the map before that.

        The last metres of a lanelet that ends within another are an edge: cars must be able to leave there.
        """
        leaving = any(not self.matching.road.lanes[i].successors for i in (first_id, second_id))
        pairs = ((one, other) for one in self.of(first_id) for other in self.of(second_id))
        return leaving and any(self.are_foes(*pair) for pair in pairs)

    def are_near(self, one: JudgedLink, other: JudgedLink) -> bool:
        """Whether two links come as near to each other as a conflict does."""
        return bool(self._line(one).distance(self._line(other)) <= NEAR_M)

    def one_source(self, first_id: int, second_id: int) -> bool:
        """Whether cars come to both lanelets from one SUMO lane only."""
        first, second = ({link.from_lane for link in self.of(i)} for i in (first_id, second_id))
        return first == second and len(first) == 1

    def ahead(self, lane_id: int) -> list[JudgedLink]:
        """Links of a lanelet that have foes or, for an approach, the first such ahead of it; else its own."""
        links = self.of(lane_id)
        for _ in range(AHEAD_LINKS):
            contested = [k for k in links if k.row >= 0 and self.net.junctions[k.junction].foes[k.row].any()]
            if contested:
                return contested
            links = self._from({link.to_lane for link in links})
        return self.of(lane_id)

    def yields(self, one: JudgedLink, other: JudgedLink) -> bool:
        """Whether the first of two links of one junction gives way to the second."""
        return bool(self.net.junctions[one.junction].response[one.row, other.row])

    def are_foes(self, one: JudgedLink, other: JudgedLink) -> bool:
        """Whether two links are foes, in both rows."""
        if one.junction != other.junction or one.row < 0 or other.row < 0:
            return False
        foes = self.net.junctions[one.junction].foes
        return bool(foes[one.row, other.row] and foes[other.row, one.row])

    def waits(self, one: JudgedLink, other: JudgedLink) -> bool:
        """Whether the first of two foes gives way, and the second does not."""
        return self.are_foes(one, other) and self.yields(one, other) and not self.yields(other, one)

    def pairs(self) -> Iterator[tuple[JudgedLink, JudgedLink]]:
        """Every pair of links that have rows in one junction, once."""
        rows: dict[str, dict[int, JudgedLink]] = defaultdict(dict)
        for link in self.net.links:
            if link.row >= 0:
                rows[link.junction][link.row] = link
        for of_junction in rows.values():
            yield from combinations((link for _, link in sorted(of_junction.items())), 2)

    def _from(self, lanes: Iterable[str]) -> list[JudgedLink]:
        return [link for lane in sorted(lanes) for link in self._leaving.get(lane, ())]

    def _met(self, lane_id: int, other_id: int) -> list[JudgedLink]:
        """Links of a lanelet that come as near to another lanelet as a conflict does."""
        other = shapely.LineString(self.matching.road.lanes[other_id].centreline)
        return [
            link
            for link in self.of(lane_id)
            if not self._is_joint(link) and self._line(link).distance(other) <= NEAR_M
        ]

    def _is_joint(self, link: JudgedLink) -> bool:
        """Whether a link merely joins two edges: who is there is on the road."""
        foes = link.row >= 0 and self.net.junctions[link.junction].foes[link.row].any()
        return not foes and self._line(link).length < JOINT_M

    def _line(self, link: JudgedLink) -> shapely.MultiLineString:
        if link not in self._lines:
            shapes = [self.net.lanes[lane].shape for lane in link.via]
            # Nets without internal lanes: the link is the place where its lanes meet.
            self._lines[link] = shapely.MultiLineString(shapes or [self.net.lanes[link.from_lane].shape[-2:]])
        return self._lines[link]
