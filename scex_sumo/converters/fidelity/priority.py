"""Right-of-way figures of a net: foes, who gives way, signals."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from scex_sumo.converters.fidelity.conflicts import JudgedConflict, find_conflicts
from scex_sumo.converters.fidelity.links import Links
from scex_sumo.converters.fidelity.matching import Matching, angle_between
from scex_sumo.converters.fidelity.net import JudgedLink, JudgedNet

Pair = tuple[int, int]

ZIPPER = "Z"  # SUMO's state for links that take turns: both answer the other, and neither waits for ever
GREENS = "GgoOsu"  # signal states in which a car may go, if need be after looking
END_M = 2.0  # of a lane, for its direction
RIGHT_RAD = (np.deg2rad(45.0), np.deg2rad(135.0))  # who crosses from the right, whatever the angle exactly


def judge_priority(matching: Matching) -> dict[str, Any]:
    """Compare the requests of the net's junctions with conflicts and rules of the map.

    Pairs are lanelet ids, (should yield, should go first) where one is wrong; of the missing foes, those
    apart do not even lie in one junction.
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


def _named(pairs: Iterable[tuple[JudgedLink, JudgedLink]]) -> tuple[tuple[str, str], ...]:
    return tuple((one.via[0], other.via[0]) for one, other in pairs)


def _controlled(links: Links, lane_id: int) -> bool:
    """Whether a light holds cars before a lanelet and on it, or at its end if it is an approach."""
    ways = (links.of(lane_id), links.leaving(lane_id))
    return any(all(_lit(links.net, link) for link in held) for held in ways if held)


def _lit(net: JudgedNet, link: JudgedLink) -> bool:
    return any(link.signal_index < len(state) for state in net.phases.get(link.signal, ()))


def _missing_foes(
    links: Links, conflicts: Iterable[JudgedConflict]
) -> tuple[tuple[Pair, ...], tuple[Pair, ...]]:
    """Lanelet pairs of which SUMO lets two cars drive at once, and of these the pairs in no one junction."""
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
    """Lanelet pairs of the rules that meet, and those where SUMO does not make the yielding one wait."""
    meeting = {pair for c in conflicts for pair in ((c.first, c.second), (c.second, c.first))}
    rules = (rule for rule in links.matching.road.regulations if rule.kind != "all_way_stop")
    ruled = {(y, p) for rule in rules for y in rule.yielding for p in rule.priority if y != p}
    count, wrong = 0, []
    for yielding, priority in sorted(ruled):
        if (priority, yielding) in ruled:
            continue  # the map contradicts itself; nothing to be right about
        met = [
            (one, other)
            for one in links.ahead(yielding)
            for other in links.ahead(priority)
            if one is not other and one.from_lane != other.from_lane
            # They get in each other's way behind the places that the rule names.
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
    """Crossings at about a right angle that no rule names: who comes from the right goes first."""
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


def _opposed(links: Links, one: JudgedLink, other: JudgedLink) -> bool:
    """Whether two links enter the junction against each other, so that the left-turner yields instead."""
    ends = [links.net.lanes[link.from_lane].line for link in (one, other)]
    # Over some length: the last segment of a lane that was cut may be no longer than a careless click.
    tips = [(np.array(line.interpolate(-END_M).xy), np.array(line.coords[-1])) for line in ends]
    ways = [np.arctan2(*(tip - before[:, 0])[::-1]) for before, tip in tips]
    return not RIGHT_RAD[0] <= abs(angle_between(*ways)) <= RIGHT_RAD[1]


def _mutual(links: Links) -> Iterator[tuple[JudgedLink, JudgedLink]]:
    """Pairs that wait for each other, outside all-way stops, zippers and lights that never let both go."""
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


def _both(net: JudgedNet, one: JudgedLink, other: JudgedLink, letters: str) -> bool | None:
    """Whether some phase shows two links one of the letters both; None where no one light controls them."""
    states = net.phases.get(one.signal)
    if states is None or one.signal != other.signal:
        return None
    last = max(one.signal_index, other.signal_index)
    return any(
        last < len(state) and state[one.signal_index] in letters and state[other.signal_index] in letters
        for state in states
    )


def _free(links: Links, one: JudgedLink, other: JudgedLink) -> bool:
    """Whether neither of two foes gives way, and no signal keeps them apart."""
    free = not links.yields(one, other) and not links.yields(other, one)
    return free and links.are_foes(one, other) and not (one.signal and other.signal)


def _inconsistent(net: JudgedNet) -> tuple[str, ...]:
    """Junctions where foes are not mutual, or a link gives way to one that is no foe."""
    return tuple(
        sorted(
            name
            for name, junction in net.junctions.items()
            if (junction.foes != junction.foes.T).any() or (junction.response & ~junction.foes).any()
        )
    )
