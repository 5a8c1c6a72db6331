"""Right of way of a net beside the map's rules: foes, links that give way, signals."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import cached_property
from itertools import combinations, product
from typing import TypeAlias

import numpy as np
import shapely
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from scex_sumo.base.arrays import BoolArray
from scex_sumo.geometry.polylines import heading, length_of, wrap
from scex_sumo.lanelet2sumo.judge.conflicts import NEAR_M, find_conflicts
from scex_sumo.lanelet2sumo.judge.matching import Matching
from scex_sumo.lanelet2sumo.reader import SumoLink

Pair: TypeAlias = tuple[int, int]
LinkPair: TypeAlias = tuple[SumoLink, SumoLink]

ZIPPER = "Z"  # SUMO's state for links that take turns
GREENS = "GgoOsu"  # signal states in which a car may go, if need be after looking
END_M = 2.0  # of a lane, for its direction
RIGHT_RAD = (np.deg2rad(45.0), np.deg2rad(135.0))  # of traffic from the right
JOINT_M = 0.25  # a link this short without foes is none to meet on
RING_M, MAX_OVAL = 400.0, 0.3  # round a roundabout; its radii differ by less than this share
AHEAD_LINKS = 4  # an approach may lie this many plain links before its intersection


class RightOfWay:
    """Requests of a net's junctions beside conflicts and rules of the map.

    Attributes:
        missing_foes: pairs of lanelets; those ``apart`` do not even share a junction.
        regulated: number of pairs with a rule; ``wrong`` (should yield, should go) are the net's mistakes.
        from_the_right, wrong_right: the same of pairs without a rule.
        signalled: lanelets with a traffic light.
    """

    def __init__(self, matching: Matching) -> None:
        self.net, self.rules = matching.net, matching.road.regulations
        self.lanes = matching.road.vehicle_lanes
        self.links = links = _Links(matching)
        self._ruled = {i for rule in self.rules for i in (*rule.lanes, *rule.yielding, *rule.priority)}
        self.conflicts = find_conflicts(self.lanes)
        self.missing_foes, self.apart = list[Pair](), list[Pair]()
        self.from_the_right, self.wrong_right = 0, list[Pair]()
        self.regulated, self.wrong = 0, list[Pair]()
        for conflict in self.conflicts:
            self._judge_foes((conflict.first, conflict.second))
            if conflict.kind == "cross" and RIGHT_RAD[0] <= abs(conflict.turn_rad) <= RIGHT_RAD[1]:
                # A positive turn: the second heads to the left of the first, so it comes from the right.
                both = (conflict.first, conflict.second)
                self._judge_right(*(both if conflict.turn_rad > 0 else both[::-1]))
        meeting = {pair for c in self.conflicts for pair in ((c.first, c.second), (c.second, c.first))}
        rules = [rule for rule in self.rules if rule.kind != "all_way_stop"]
        ruled = {(y, p) for rule in rules for y in rule.yielding for p in rule.priority if y != p}
        meeting -= {
            (p, y) for y, p in ruled
        }  # a rule of an approach says nothing against a rule of these two
        for yielding, priority in sorted(ruled):
            if (priority, yielding) not in ruled:  # else the map contradicts itself
                self._judge_rule(yielding, priority, meeting)
        lit = {i for rule in self.rules if rule.kind == "traffic_light" for i in rule.lanes}
        self.signalled = sorted(i for i in lit if i in self.lanes and links.of(i))

    def _judge_foes(self, pair: Pair) -> None:
        links, pairs = self.links, self.links.meetings(*pair)
        if not pairs and (links.one_source(*pair) or links.foes_before(*pair)):
            return
        if not pairs or not all(links.are_foes(a, b) for a, b in pairs):
            self.missing_foes.append(pair)
            if not any(a.junction == b.junction for a, b in pairs):
                self.apart.append(pair)

    def _judge_right(self, yielding: int, priority: int) -> None:
        links = self.links
        both = [link for i in (yielding, priority) for link in links.of(i)]
        if any(link.signal or links.lanelets(link, approach=True) & self._ruled for link in both):
            return
        pairs = [(a, b) for a, b in links.meetings(yielding, priority) if links.are_foes(a, b)]
        if not any(self._from_the_right(a, b) for a, b in pairs):
            return
        wrong = not all(links.waits(a, b) for a, b in pairs)
        on_it = (yielding, *self.lanes[yielding].predecessors)
        if wrong and all(links.waits(b, a) for a, b in pairs) and any(map(self._circles, on_it)):
            return  # a roundabout goes before its entries
        self.from_the_right += 1
        if wrong:
            self.wrong_right.append((yielding, priority))

    def _from_the_right(self, one: SumoLink, other: SumoLink) -> bool:
        """Whether one link's traffic sees that of another come from the right, before both turn."""
        ends = (self.net.lanes[link.from_lane].shape for link in (one, other))
        ways = [heading(shape, end=True, reach=END_M) for shape in ends]
        return bool(RIGHT_RAD[0] <= wrap(ways[1] - ways[0]) <= RIGHT_RAD[1])

    @cached_property
    def _graph(self) -> tuple[list[int], list[Pair], csr_array]:
        """Lanelets, numbers of each and its successor, and lengths of the first of both."""
        ids = list(self.lanes)
        place = {i: k for k, i in enumerate(ids)}
        ways = [(place[i], place[j]) for i in ids for j in self.lanes[i].successors if j in place]
        lengths = [length_of(self.lanes[ids[k]].centreline) for k, _ in ways]
        ends = tuple(np.array(ways, int).reshape(-1, 2).T)
        return ids, ways, coo_array((lengths, ends), shape=(len(ids), len(ids))).tocsr()

    def _circles(self, lane_id: int) -> bool:
        """Whether a lanelet lies on a circle of lanelets."""
        ids, ways, graph = self._graph
        if lane_id not in self.lanes:
            return False
        here = ids.index(lane_id)
        far, before = dijkstra(graph, indices=here, limit=RING_M, return_predecessors=True)
        back = [k for k, end in ways if end == here and np.isfinite(far[k])]
        if not back:
            return False
        at, circle = min(back, key=lambda k: far[k]), list[int]()
        while at >= 0:
            circle, at = [*circle, at], before[at]
        points = np.vstack([self.lanes[ids[k]].centreline for k in circle])
        radii = np.hypot(*(points - (points.min(axis=0) + points.max(axis=0)) / 2).T)
        return bool(np.ptp(radii) < MAX_OVAL * radii.mean())

    def _judge_rule(self, yielding: int, priority: int, meeting: set[Pair]) -> None:
        links = self.links
        met: dict[LinkPair, list[Pair]] = {}
        for one, other in product(links.ahead(yielding), links.ahead(priority)):
            # They meet behind the lanelets that the rule names.
            on = product(links.lanelets(one) | {yielding}, links.lanelets(other) | {priority})
            places = [pair for pair in on if pair in meeting]
            if places and one is not other and one.from_lane != other.from_lane:
                met[one, other] = places
        self.regulated += bool(met)
        near = [pair for pair in met if links.are_near(*pair)]
        # A lanelet in several pieces meets different lanelets with different ones of them.
        near = near or [
            pair for places in met.values() for place in places for pair in links.meetings(*place)
        ]
        if not all(links.waits(one, other) for one, other in (near or met)):
            self.wrong.append((yielding, priority))

    def missing_signals(self) -> list[int]:
        """Return the lanelets with a traffic light that nothing controls."""
        ways = {i: (self.links.of(i), self.links.leaving(i)) for i in self.signalled}
        return [i for i in self.signalled if not any(held and all(map(self._lit, held)) for held in ways[i])]

    def _lit(self, link: SumoLink) -> bool:
        return any(link.signal_index < len(state) for state in self.net.phases.get(link.signal, ()))

    def clashing_greens(self) -> list[tuple[str, str]]:
        """Return the foes, by their internal lanes, that both have green without having to look."""
        return _named(p for p in self.links.pairs() if self.links.are_foes(*p) and self._both(*p, "G"))

    def mutual_yields(self) -> list[tuple[str, str]]:
        """Return the links that yield to each other for ever."""
        rules = (rule for rule in self.rules if rule.kind == "all_way_stop")
        stops = {i for rule in rules for i in (rule.yielding or rule.lanes)}
        return _named(pair for pair in self.links.pairs() if self._wait_for_each_other(*pair, stops))

    def _wait_for_each_other(self, one: SumoLink, other: SumoLink, stops: set[int]) -> bool:
        links = self.links
        if not (links.yields(one, other) and links.yields(other, one)) or one.state == other.state == ZIPPER:
            return False
        if self.net.junctions[one.junction].kind == "allway_stop":
            return False
        stopped = all(links.lanelets(link, approach=True) & stops for link in (one, other))
        return not stopped and self._both(one, other, GREENS) is not False

    def _both(self, one: SumoLink, other: SumoLink, letters: str) -> bool | None:
        """Whether two links show some of the letters at once; None if they have no common light."""
        states = self.net.phases.get(one.signal)
        if states is None or one.signal != other.signal:
            return None
        shown = ((state[k : k + 1] for k in (one.signal_index, other.signal_index)) for state in states)
        return any(all(letter and letter in letters for letter in both) for both in shown)

    def free_foes(self) -> list[tuple[str, str]]:
        """Return the foes without a light of which neither yields."""
        foes = [
            p for p in self.links.pairs() if self.links.are_foes(*p) and not (p[0].signal and p[1].signal)
        ]
        return _named((a, b) for a, b in foes if not self.links.yields(a, b) and not self.links.yields(b, a))

    def inconsistent_rows(self) -> list[str]:
        """Return the junctions whose requests contradict each other."""
        rows = [(name, j.foes, j.response) for name, j in sorted(self.net.junctions.items())]
        return [name for name, foes, yields in rows if (foes != foes.T).any() or (yields & ~foes).any()]


def _named(pairs: Iterable[LinkPair]) -> list[tuple[str, str]]:
    return [(one.via[0], other.via[0]) for one, other in pairs]


class _Links:
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

    def lanelets(self, link: SumoLink, *, approach: bool = False) -> set[int]:
        """Return the lanelets that a link leads through; ``approach`` adds those on the lane before it."""
        before = self.matching.lanelets(link.from_lane) if approach else set()
        return self._lanelets[link] | before

    def of(self, lane_id: int) -> list[SumoLink]:
        return list(dict.fromkeys([*self._through.get(lane_id, ()), *self._from_lanes_of(lane_id)]))

    def leaving(self, lane_id: int) -> list[SumoLink]:
        links = self._from_lanes_of(lane_id)
        return [link for link in links if lane_id not in self.matching.lanelets(link.to_lane)]

    def _from_lanes_of(self, lane_id: int) -> list[SumoLink]:
        return self._from(n for n in self.matching.names(lane_id) if not self.net.lanes[n].internal)

    def _from(self, lanes: Iterable[str]) -> list[SumoLink]:
        return [link for lane in sorted({*lanes}) for link in self._leaving.get(lane, ())]

    def meetings(self, first_id: int, second_id: int) -> list[LinkPair]:
        """Return pairs of links from different lanes with which two lanelets get in each other's way."""
        return [
            (one, other)
            for one in self._links_near(first_id, second_id)
            for other in self._links_near(second_id, first_id)
            if one.from_lane != other.from_lane and self.are_near(one, other)
        ]

    def _links_near(self, lane_id: int, other_id: int) -> Iterator[SumoLink]:
        other = shapely.LineString(self.matching.road.lanes[other_id].centreline)
        for link in self.of(lane_id):
            joint = not self._foes(link).any() and self._line(link).length < JOINT_M
            if not joint and self._line(link).distance(other) <= NEAR_M:
                yield link

    def foes_before(self, first_id: int, second_id: int) -> bool:
        """Whether links are foes without a meeting, because one lanelet ends within the other."""
        leaving = any(not self.matching.road.lanes[i].successors for i in (first_id, second_id))
        return leaving and any(self.are_foes(a, b) for a in self.of(first_id) for b in self.of(second_id))

    def are_near(self, one: SumoLink, other: SumoLink) -> bool:
        return bool(self._line(one).distance(self._line(other)) <= NEAR_M)

    def one_source(self, first_id: int, second_id: int) -> bool:
        first, second = ({link.from_lane for link in self.of(i)} for i in (first_id, second_id))
        return first == second and len(first) == 1

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

    def yields(self, one: SumoLink, other: SumoLink) -> bool:
        return bool(self.net.junctions[one.junction].response[one.row, other.row])

    def are_foes(self, one: SumoLink, other: SumoLink) -> bool:
        rows = one.junction == other.junction and one.row >= 0 and other.row >= 0
        return rows and bool(self._foes(one)[other.row] and self._foes(other)[one.row])

    def waits(self, one: SumoLink, other: SumoLink) -> bool:
        return self.are_foes(one, other) and self.yields(one, other) and not self.yields(other, one)

    def pairs(self) -> Iterator[LinkPair]:
        rows: dict[str, dict[int, SumoLink]] = defaultdict(dict)
        for link in self.net.links:
            if link.row >= 0:
                rows[link.junction][link.row] = link
        for of_junction in rows.values():
            yield from combinations((link for _, link in sorted(of_junction.items())), 2)

    def _line(self, link: SumoLink) -> shapely.MultiLineString:
        if link not in self._lines:
            shapes = [self.net.lanes[lane].shape for lane in link.via]
            # Nets without internal lanes: the link is the place where its lanes meet.
            self._lines[link] = shapely.MultiLineString(shapes or [self.net.lanes[link.from_lane].shape[-2:]])
        return self._lines[link]
