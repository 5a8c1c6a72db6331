"""Right of way of a net as a whole: foes, right before left, requests that contradict each other.

Conflicts are found by geometry, independent of the net writer.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import cached_property
from itertools import combinations

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from scex_sumo.converters.net.links import SumoLink
from scex_sumo.geometry.polylines import heading, length_of, wrap
from scex_sumo.lanelet2sumo.judge.matching import Matching
from scex_sumo.lanelet2sumo.judge.priority import LinkPair, Pair, RightOfWay
from tests.lanelet2sumo.judge.conflicts import find_conflicts

ZIPPER = "Z"  # SUMO's state for links that take turns
GREENS = "GgoOsu"  # signal states in which a car may go, if need be after looking
END_M = 2.0  # of a lane, for its direction
RIGHT_RAD = (np.deg2rad(45.0), np.deg2rad(135.0))  # of traffic from the right
RING_M, MAX_OVAL = 400.0, 0.3  # round a roundabout; its radii differ by less than this share


class WholeRightOfWay(RightOfWay):
    """Requests of a net's junctions beside conflicts and rules of the map.

    Attributes:
        missing_foes: pairs of lanelets; those ``apart`` do not even share a junction.
        from_the_right, wrong_right: pairs without a rule, as ``regulated`` and ``wrong`` with one.
    """

    def __init__(self, matching: Matching) -> None:
        self.conflicts = find_conflicts(matching.road.vehicle_lanes)
        super().__init__(matching, [(c.first, c.second) for c in self.conflicts])
        self._ruled = {i for rule in self.rules for i in (*rule.lanes, *rule.yielding, *rule.priority)}
        self.missing_foes, self.apart = list[Pair](), list[Pair]()
        self.from_the_right, self.wrong_right = 0, list[Pair]()
        for conflict in self.conflicts:
            self._judge_foes((conflict.first, conflict.second))
            if conflict.kind == "cross" and RIGHT_RAD[0] <= abs(conflict.turn_rad) <= RIGHT_RAD[1]:
                # A positive turn: the second heads to the left of the first, so it comes from the right.
                both = (conflict.first, conflict.second)
                self._judge_right(*(both if conflict.turn_rad > 0 else both[::-1]))

    def _judge_foes(self, pair: Pair) -> None:
        links, pairs = self.links, self.links.meetings(*pair)
        if not pairs and (self._one_source(*pair) or self._foes_before(*pair)):
            return
        if not pairs or not all(links.are_foes(a, b) for a, b in pairs):
            self.missing_foes.append(pair)
            if not any(a.junction == b.junction for a, b in pairs):
                self.apart.append(pair)

    def _judge_right(self, yielding: int, priority: int) -> None:
        links = self.links
        both = [link for i in (yielding, priority) for link in links.of(i)]
        if any(link.signal or self._with_approach(link) & self._ruled for link in both):
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

    def _with_approach(self, link: SumoLink) -> set[int]:
        return self.links.lanelets(link) | self.links.matching.lanelets(link.from_lane)

    def _foes_before(self, first_id: int, second_id: int) -> bool:
        """Whether links are foes without a meeting, because one lanelet ends within the other."""
        links = self.links
        leaving = any(not self.lanes[i].successors for i in (first_id, second_id))
        return leaving and any(links.are_foes(a, b) for a in links.of(first_id) for b in links.of(second_id))

    def _one_source(self, first_id: int, second_id: int) -> bool:
        first, second = ({link.from_lane for link in self.links.of(i)} for i in (first_id, second_id))
        return first == second and len(first) == 1

    def _pairs(self) -> Iterator[LinkPair]:
        """Yield all pairs of links of each junction."""
        rows: dict[str, dict[int, SumoLink]] = defaultdict(dict)
        for link in self.net.links:
            if link.row >= 0:
                rows[link.junction][link.row] = link
        for of_junction in rows.values():
            yield from combinations((link for _, link in sorted(of_junction.items())), 2)

    def clashing_greens(self) -> list[tuple[str, str]]:
        """Return the foes, by their internal lanes, that both have green without having to look."""
        foes = (pair for pair in self._pairs() if self.links.are_foes(*pair))
        return [(a.via[0], b.via[0]) for a, b in foes if self._both_show(a, b, "G")]

    def _both_show(self, one: SumoLink, other: SumoLink, letters: str) -> bool | None:
        """Return whether two links show some of the letters at once; None if they have no common light."""
        states = self.net.phases.get(one.signal)
        if states is None or one.signal != other.signal:
            return None
        shown = ((state[k : k + 1] for k in (one.signal_index, other.signal_index)) for state in states)
        return any(all(letter and letter in letters for letter in both) for both in shown)

    def mutual_yields(self) -> list[tuple[str, str]]:
        """Return the links that yield to each other for ever."""
        rules = (rule for rule in self.rules if rule.kind == "all_way_stop")
        stops = {i for rule in rules for i in (rule.yielding or rule.lanes)}
        return _named(pair for pair in self._pairs() if self._wait_for_each_other(*pair, stops))

    def _wait_for_each_other(self, one: SumoLink, other: SumoLink, stops: set[int]) -> bool:
        links = self.links
        if not (links.yields(one, other) and links.yields(other, one)) or one.state == other.state == ZIPPER:
            return False
        if self.net.junctions[one.junction].kind == "allway_stop":
            return False
        stopped = all(self._with_approach(link) & stops for link in (one, other))
        return not stopped and self._both_show(one, other, GREENS) is not False

    def free_foes(self) -> list[tuple[str, str]]:
        """Return the foes without a light of which neither yields."""
        foes = [p for p in self._pairs() if self.links.are_foes(*p) and not (p[0].signal and p[1].signal)]
        return _named((a, b) for a, b in foes if not self.links.yields(a, b) and not self.links.yields(b, a))

    def inconsistent_rows(self) -> list[str]:
        """Return the junctions whose requests contradict each other."""
        rows = [(name, j.foes, j.response) for name, j in sorted(self.net.junctions.items())]
        return [name for name, foes, yields in rows if (foes != foes.T).any() or (yields & ~foes).any()]


def _named(pairs: Iterable[LinkPair]) -> list[tuple[str, str]]:
    return [(one.via[0], other.via[0]) for one, other in pairs]
