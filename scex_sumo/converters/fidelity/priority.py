"""Whether a net gives way where its map does: foes, right of way, signals."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from scex_sumo.converters.fidelity.conflicts import Conflict, find_conflicts
from scex_sumo.converters.fidelity.links import Links
from scex_sumo.converters.fidelity.matching import Matching
from scex_sumo.converters.fidelity.net import Link, Net
from scex_sumo.road import Regulation, Road

Pair = tuple[int, int]

ZIPPER = "Z"  # SUMO's state for links that take turns: both answer the other, and neither waits for ever
GREENS = "GgoOsu"  # signal states in which a car may go, if need be after looking
RIGHT_RAD = (np.deg2rad(45.0), np.deg2rad(135.0))  # who crosses from the right, whatever the angle exactly


@dataclass(frozen=True, kw_only=True)
class PriorityFigures:
    """Right of way of the net against geometry and rules of the map. Pairs are lanelet ids.

    Attributes:
        conflicts: lanelet pairs that cross, merge or overlap.
        crossing: those that cross.
        merging: those that merge.
        missing_foes: pairs of which SUMO lets two cars drive at once.
        foes_apart: of these, pairs that do not even lie in one junction.
        regulated_pairs: yielding and priority lanelets of the map's rules that conflict.
        wrong_priority: (yielding, priority) pairs where SUMO says otherwise.
        signalled: lanelets that obey a traffic light.
        missing_signals: those that no programme controls.
        clashing_greens: foes that one phase gives unconditional green to both.
        from_the_right: unregulated crossings at about a right angle.
        wrong_from_the_right: (should yield, should go first) pairs where SUMO says otherwise.
        mutual_yields: link pairs that wait for each other, outside all-way stops, zippers and
            lights that never let both go.
        free_foes: foes of which neither gives way, outside signals.
        inconsistent_rows: junctions whose rows contradict themselves.
    """

    conflicts: int
    crossing: int
    merging: int
    missing_foes: tuple[Pair, ...]
    foes_apart: tuple[Pair, ...]
    regulated_pairs: int
    wrong_priority: tuple[Pair, ...]
    signalled: int
    missing_signals: tuple[int, ...]
    clashing_greens: tuple[tuple[str, str], ...]
    from_the_right: int
    wrong_from_the_right: tuple[Pair, ...]
    mutual_yields: tuple[tuple[str, str], ...]
    free_foes: tuple[tuple[str, str], ...]
    inconsistent_rows: tuple[str, ...]


def judge_priority(net: Net, road: Road, matching: Matching) -> PriorityFigures:
    """Compare the requests of the net's junctions with conflicts and rules of the map."""
    links = Links(net, road, matching)
    conflicts = find_conflicts(road.vehicle_lanes)
    missing, apart = _missing_foes(links, conflicts)
    regulated, wrong = _regulated(links, road, conflicts)
    unregulated, wrong_right = _from_the_right(links, road, conflicts)
    lit = sorted({i for rule in road.regulations if rule.kind == "traffic_light" for i in rule.lanes})
    lit = [i for i in lit if i in road.vehicle_lanes and links.of(i)]
    stops = {i for rule in road.regulations if rule.kind == "all_way_stop" for i in _obliged(rule)}
    return PriorityFigures(
        conflicts=len(conflicts),
        crossing=sum(conflict.kind == "cross" for conflict in conflicts),
        merging=sum(conflict.kind == "merge" for conflict in conflicts),
        missing_foes=missing,
        foes_apart=apart,
        regulated_pairs=regulated,
        wrong_priority=wrong,
        signalled=len(lit),
        missing_signals=tuple(i for i in lit if not all(_lit(net, link) for link in links.of(i))),
        clashing_greens=tuple(_clashing(links)),
        from_the_right=unregulated,
        wrong_from_the_right=wrong_right,
        mutual_yields=tuple(_mutual(links, stops)),
        free_foes=tuple(_free(links)),
        inconsistent_rows=_inconsistent(net),
    )


def _lit(net: Net, link: Link) -> bool:
    return any(link.signal_index < len(state) for state in net.phases.get(link.signal, ()))


def _obliged(rule: Regulation) -> set[int]:
    return set(rule.yielding) or set(rule.lanes)


def _missing_foes(links: Links, conflicts: Iterable[Conflict]) -> tuple[tuple[Pair, ...], tuple[Pair, ...]]:
    missing, apart = [], []
    for conflict in conflicts:
        pair = (conflict.first, conflict.second)
        pairs = links.meetings(*pair)
        if not pairs and links.one_source(*pair):
            continue
        if not pairs or not all(links.are_foes(a, b) for a, b in pairs):
            missing.append(pair)
            if not any(a.junction == b.junction for a, b in pairs):
                apart.append(pair)
    return tuple(missing), tuple(apart)


def _regulated(links: Links, road: Road, conflicts: Iterable[Conflict]) -> tuple[int, tuple[Pair, ...]]:
    """Lanelet pairs of the rules that meet, and those where SUMO does not make the yielding one wait."""
    meeting = {pair for c in conflicts for pair in ((c.first, c.second), (c.second, c.first))}
    ruled = {(y, p) for rule in road.regulations if rule.kind != "all_way_stop" for y, p in _ruled(rule)}
    count, wrong = 0, []
    for yielding, priority in sorted(ruled):
        if (priority, yielding) in ruled:
            continue  # the map contradicts itself; nothing to be right about
        met = [
            (a, b)
            for a in links.ahead(yielding)
            for b in links.ahead(priority)
            if a is not b and a.from_lane != b.from_lane and _meet(links, a, b, meeting, yielding, priority)
        ]
        count += bool(met)
        if not all(_waits(links, a, b) for a, b in met):
            wrong.append((yielding, priority))
    return count, tuple(wrong)


def _ruled(rule: Regulation) -> Iterator[Pair]:
    return ((y, p) for y in rule.yielding for p in rule.priority if y != p)


def _meet(links: Links, one: Link, other: Link, meeting: set[Pair], yielding: int, priority: int) -> bool:
    """Whether two links get in each other's way behind the places that the rule names."""
    mine, theirs = links.lanelets[one] | {yielding}, links.lanelets[other] | {priority}
    if yielding in mine and priority in theirs and (yielding, priority) in meeting:
        return True
    return any((a, b) in meeting for a in mine for b in theirs)


def _waits(links: Links, one: Link, other: Link) -> bool:
    return links.are_foes(one, other) and links.yields(one, other) and not links.yields(other, one)


def _from_the_right(links: Links, road: Road, conflicts: Iterable[Conflict]) -> tuple[int, tuple[Pair, ...]]:
    """Crossings that no rule names: who comes from the right goes first (right-hand traffic)."""
    ruled = _ruled_lanes(road)
    count, wrong = 0, []
    for conflict in conflicts:
        first, second = links.of(conflict.first), links.of(conflict.second)
        named = {i for link in (*first, *second) for i in links.lanelets[link] | links.approach(link)}
        if conflict.kind != "cross" or named & ruled or any(link.signal for link in (*first, *second)):
            continue
        if not RIGHT_RAD[0] <= abs(conflict.turn_rad) <= RIGHT_RAD[1]:
            continue
        # A positive turn: the second's heading lies to the left of the first's, so it comes from the right.
        order = (
            (conflict.first, conflict.second) if conflict.turn_rad > 0 else (conflict.second, conflict.first)
        )
        pairs = [(a, b) for a, b in links.meetings(*order) if links.are_foes(a, b)]
        if pairs and not all(_opposed(links, a, b) for a, b in pairs):
            count += 1
            if not all(_waits(links, a, b) for a, b in pairs):
                wrong.append(order)
    return count, tuple(wrong)


def _opposed(links: Links, one: Link, other: Link) -> bool:
    """Whether two links enter the junction against each other, so that the left-turner yields instead."""
    ends = [links.net.lanes[link.from_lane].shape for link in (one, other)]
    ways = [shape[-1] - shape[-2] for shape in ends]
    angles = [np.arctan2(way[1], way[0]) for way in ways]
    turn = abs(np.angle(np.exp(1j * (angles[1] - angles[0]))))
    return not RIGHT_RAD[0] <= turn <= RIGHT_RAD[1]


def _ruled_lanes(road: Road) -> set[int]:
    return {i for rule in road.regulations for i in (*rule.lanes, *rule.yielding, *rule.priority)}


def _mutual(links: Links, stops: set[int]) -> Iterator[tuple[str, str]]:
    for one, other in links.pairs():
        if not (links.yields(one, other) and links.yields(other, one)):
            continue
        if links.net.junctions[one.junction].kind == "allway_stop" or one.state == other.state == ZIPPER:
            continue
        if _both(links.net, one, other, GREENS) is False:
            continue
        if all((links.lanelets[link] | links.approach(link)) & stops for link in (one, other)):
            continue
        yield one.via[0], other.via[0]


def _both(net: Net, one: Link, other: Link, letters: str) -> bool | None:
    """Whether some phase shows two links one of the letters both; None where no one light controls them."""
    states = net.phases.get(one.signal)
    if states is None or one.signal != other.signal:
        return None
    last = max(one.signal_index, other.signal_index)
    return any(
        last < len(state) and state[one.signal_index] in letters and state[other.signal_index] in letters
        for state in states
    )


def _clashing(links: Links) -> Iterator[tuple[str, str]]:
    for one, other in links.pairs():
        if links.are_foes(one, other) and _both(links.net, one, other, "G"):
            yield one.via[0], other.via[0]


def _free(links: Links) -> Iterator[tuple[str, str]]:
    for one, other in links.pairs():
        free = not links.yields(one, other) and not links.yields(other, one)
        if free and links.are_foes(one, other) and not (one.signal and other.signal):
            yield one.via[0], other.via[0]


def _inconsistent(net: Net) -> tuple[str, ...]:
    """Junctions where foes are not mutual, or a link gives way to one that is no foe."""
    bad = (
        junction.junction_id
        for junction in net.junctions.values()
        if (junction.foes != junction.foes.T).any() or (junction.response & ~junction.foes).any()
    )
    return tuple(sorted(bad))
