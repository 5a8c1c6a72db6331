"""Traffic lights: which links they control, and a fixed programme where none was recorded."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from scex_sumo.converters.net.elements import Connection, NetLayout
from scex_sumo.geometry.polylines import length_of, project, turn
from scex_sumo.road import Lane, Regulation
from scex_sumo.roads.conflicts import Conflict

GREEN_S, YELLOW_S, ALL_RED_S = 25, 3, 2
AT_LINE_M = 2.0  # how far stop lines reach into crosswalks, as drawn
BEFORE_END_M = 30.0  # from a crosswalk to the end of a lane whose light holds people's traffic, too
AHEAD_M = 60.0  # how far beyond a light its traffic is looked at for conflicts with that of other lights
ONCOMING = math.radians(135.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Programme:
    """A SUMO traffic light.

    Attributes:
        name: SUMO's id of it.
        connections: the controlled connections; their places are the link indices.
        phases: (seconds, state), one character of state per connection.
        programme: SUMO's programID.
        crossings: edges of the crossings that it controls; their places follow those of the connections.
    """

    name: str
    connections: tuple[Connection, ...]
    phases: tuple[tuple[float, str], ...]
    programme: str = "0"
    crossings: tuple[str, ...] = ()


def fixed_programmes(
    layout: NetLayout, lanes: Mapping[int, Lane], rules: Sequence[Regulation], found: Sequence[Conflict]
) -> list[Programme]:
    """A programme for each group of traffic_light elements whose traffic conflicts.

    Each element's links are green together; oncoming elements share a phase, in which left turns give way.

    Args:
        layout: the net.
        lanes: that it was made of, by id.
        rules: of the map.
        found: conflicts of the lanes.
    """
    elements = [rule for rule in rules if rule.kind == "traffic_light"]
    clashing = {pair for c in found if c.kind != "diverge" for pair in (c.lanes, c.lanes[::-1])}
    groups = [(rule, controlled(layout, rule, clashing, lanes)) for rule in elements]
    groups = [(rule, links) for rule, links in groups if links]
    ahead = [_ahead(lanes, rule.lanes) for rule, _ in groups]
    against = [
        {j for j, b in enumerate(ahead) if j != i and any((p, q) in clashing for p in a for q in b)}
        for i, a in enumerate(ahead)
    ]
    programmes = []
    for cluster in _clusters(against):
        stages = _stages(cluster, against, [links for _, links in groups])
        name = f"tl{min(groups[i][0].element_id for i in cluster)}"
        links = list({id(c): c for i in cluster for c in groups[i][1]}.values())
        greens = [{id(c) for i in stage for c in groups[i][1]} for stage in stages]
        programmes.append(Programme(name=name, connections=tuple(links), phases=_phases(links, greens)))
    return programmes


def controlled(
    layout: NetLayout, rule: Regulation, clashing: set[tuple[int, int]], lanes: Mapping[int, Lane]
) -> list[Connection]:
    """Links that a light controls: those that leave its lanes, or enter those in conflict.

    Maps differ in whether the approach or the lanelet across the intersection refers to the light. Crosswalks
    behind its stop line, or shortly before the end of its lanes, are controlled, too.
    """
    crossing = {lane for lane, _ in clashing}
    found = []
    for c in layout.connections:
        first, *others = c.lanelets
        for lane in rule.lanes:
            # A lane that begins at the map's border is entered where its first edge ends.
            enters = lane in others or (first == lane and c.enters)
            leaves = first == lane and (bool(others) or _held(lanes[lane], rule, c.starts[-1][1]))
            if enters if lane in crossing else leaves:
                found.append(c)
                break
    return found


def _held(lane: Lane, rule: Regulation, start: float) -> bool:
    """Whether a light holds who drives over a crosswalk that begins at an arc length of a lane, m."""
    stops = [project(line, lane.centreline) for line in rule.stop_lines]
    held = [float(s[gap < lane.width_m].mean()) for s, gap in stops if (gap < lane.width_m).any()]
    if held:
        return max(held) < start + AT_LINE_M
    return length_of(lane.centreline) - start < BEFORE_END_M


def _ahead(lanes: Mapping[int, Lane], ids: Iterable[int]) -> set[int]:
    """Lanes and what follows them within 60 m."""
    reached: dict[int, float] = {}
    stack = [(lane, 0.0) for lane in ids]
    while stack:
        lane, start = stack.pop()
        if lane not in lanes or start > AHEAD_M or reached.get(lane, math.inf) <= start:
            continue
        reached[lane] = start
        end = start + length_of(lanes[lane].centreline)
        stack += [(i, end) for i in lanes[lane].successors]
    return set(reached)


def _clusters(against: Sequence[set[int]]) -> list[list[int]]:
    seen: set[int] = set()
    clusters = []
    for i in range(len(against)):
        stack, cluster = [i], []
        while stack:
            k = stack.pop()
            if k not in seen:
                seen.add(k)
                cluster.append(k)
                stack += against[k]
        if cluster:
            clusters.append(sorted(cluster))
    return clusters


def _stages(
    cluster: Sequence[int], against: Sequence[set[int]], links: Sequence[Sequence[Connection]]
) -> list[list[int]]:
    """Elements that are green together: no conflict, or oncoming."""
    stages: list[list[int]] = []
    for i in cluster:
        for stage in stages:
            if all(j not in against[i] or _oncoming(links[i], links[j]) for j in stage):
                stage.append(i)
                break
        else:
            stages.append([i])
    return stages


def _oncoming(a: Sequence[Connection], b: Sequence[Connection]) -> bool:
    return all(abs(turn(p.link.entry, q.link.entry)) > ONCOMING for p in a for q in b)


def _phases(links: Sequence[Connection], greens: Sequence[set[int]]) -> tuple[tuple[float, str], ...]:
    """Green, yellow, all red, one stage after the other; always green where there is only one stage."""
    phases: list[tuple[float, str]] = []
    for k, green in enumerate(greens):
        following = greens[(k + 1) % len(greens)]
        on = {c.internal.name: "G" for c in links if id(c) in green}
        phases.append((GREEN_S, state(links, on)))
        if len(greens) == 1:
            break
        change = {c.internal.name: "G" if id(c) in following else "y" for c in links if id(c) in green}
        phases.append((YELLOW_S, state(links, change)))
        rest = {name: letter for name, letter in change.items() if letter == "G"}
        phases.append((ALL_RED_S, state(links, rest)))
    return tuple(phases)


def state(links: Sequence[Connection], lit: dict[str, str]) -> str:
    """One phase: letters by internal lane, red where not named; green that must yield becomes ``g``.

    A green link yields where a foe that it gives way to is lit as well, or is under no light at all.
    """
    known = {c.internal.name for c in links}
    letters = []
    for c in links:
        letter = lit.get(c.internal.name, "r")
        if letter == "G":
            prefix = c.internal.name.rsplit("_", 2)[0]
            foes = [f"{prefix}_{j}_0" for j in c.link.response]
            if any(lit.get(foe, "r") in "Gg" or foe not in known for foe in foes):
                letter = "g"
        letters.append(letter)
    return "".join(letters)
