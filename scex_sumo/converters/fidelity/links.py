"""The links of a net by the lanelets they lead through, leave or approach."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import combinations

import shapely

from scex_sumo.converters.fidelity.conflicts import NEAR_M
from scex_sumo.converters.fidelity.matching import Matching
from scex_sumo.converters.fidelity.net import Link, Net
from scex_sumo.road import Road

AHEAD_LINKS = 4  # an approach may lie this many plain links before its intersection


class Links:
    """The net's links, found by the lanelets they lead through, leave or approach."""

    def __init__(self, net: Net, road: Road, matching: Matching) -> None:
        self.net = net
        self.road = road
        self._lines: dict[Link, shapely.MultiLineString] = {}
        self.through: dict[int, list[Link]] = defaultdict(list)
        self.leaving: dict[str, list[Link]] = defaultdict(list)
        self.lanelets: dict[Link, set[int]] = {}
        self.matching = matching
        for link in net.links:
            on = {stretch.lane_id for lane in link.via for stretch in matching.by_sumo_lane.get(lane, ())}
            self.lanelets[link] = on
            self.leaving[link.from_lane].append(link)
            for lane_id in on:
                self.through[lane_id].append(link)

    def of(self, lane_id: int) -> list[Link]:
        """Links through a lanelet, its first and last centimetres included, or leaving it."""
        leaving = self._from(self._lanes(lane_id))
        return list(dict.fromkeys([*self.through.get(lane_id, ()), *leaving]))

    def met(self, lane_id: int, other_id: int) -> list[Link]:
        """Links of a lanelet that come as near to another lanelet as a conflict does."""
        other = shapely.LineString(self.road.lanes[other_id].centreline)
        return [link for link in self.of(lane_id) if self._line(link).distance(other) <= NEAR_M]

    def meetings(self, first_id: int, second_id: int) -> list[tuple[Link, Link]]:
        """Pairs of links with which two lanelets get in each other's way, from different lanes.

        Cars from one lane come one after the other; SUMO needs no foes for them.
        """
        return [
            (one, other)
            for one in self.met(first_id, second_id)
            for other in self.met(second_id, first_id)
            if one.from_lane != other.from_lane and self._line(one).distance(self._line(other)) <= NEAR_M
        ]

    def one_source(self, first_id: int, second_id: int) -> bool:
        """Whether cars come to both lanelets from one SUMO lane only."""
        sources = [{link.from_lane for link in self.of(i)} for i in (first_id, second_id)]
        return sources[0] == sources[1] and len(sources[0]) == 1

    def ahead(self, lane_id: int) -> list[Link]:
        """Links of a lanelet that have foes or, for an approach, the first such ahead of it; else its own."""
        links = self.of(lane_id)
        for _ in range(AHEAD_LINKS):
            contested = [link for link in links if self.foes(link)]
            if contested:
                return contested
            links = self._from({link.to_lane for link in links})
        return self.of(lane_id)

    def _line(self, link: Link) -> shapely.MultiLineString:
        if link not in self._lines:
            shapes = [self.net.lanes[lane].shape for lane in link.via]
            # Nets without internal lanes: the link is the place where its lanes meet.
            shapes = shapes or [self.net.lanes[link.from_lane].shape[-2:]]
            self._lines[link] = shapely.MultiLineString(shapes)
        return self._lines[link]

    def foes(self, link: Link) -> bool:
        """Whether anything is in a link's way."""
        return link.row >= 0 and bool(self.net.junctions[link.junction].foes[link.row].any())

    def _lanes(self, lane_id: int) -> set[str]:
        stretches = self.matching.by_lanelet.get(lane_id, ())
        return {s.sumo_lane for s in stretches if not self.net.lanes[s.sumo_lane].internal}

    def _from(self, lanes: Iterable[str]) -> list[Link]:
        return [link for lane in sorted(lanes) for link in self.leaving.get(lane, ())]

    def yields(self, one: Link, other: Link) -> bool:
        """Whether the first of two links of one junction gives way to the second."""
        return bool(self.net.junctions[one.junction].response[one.row, other.row])

    def are_foes(self, one: Link, other: Link) -> bool:
        """Whether two links are foes, in both rows."""
        if one.junction != other.junction or one.row < 0 or other.row < 0:
            return False
        foes = self.net.junctions[one.junction].foes
        return bool(foes[one.row, other.row] and foes[other.row, one.row])

    def approach(self, link: Link) -> set[int]:
        """Lanelets on the lane that a link leaves."""
        return {stretch.lane_id for stretch in self.matching.by_sumo_lane.get(link.from_lane, ())}

    def pairs(self) -> Iterator[tuple[Link, Link]]:
        """Every pair of links that have rows in one junction, once."""
        rows: dict[str, dict[int, Link]] = defaultdict(dict)
        for link in self.net.links:
            if link.row >= 0:
                rows[link.junction][link.row] = link
        for of_junction in rows.values():
            yield from combinations((link for _, link in sorted(of_junction.items())), 2)
