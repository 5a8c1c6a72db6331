"""Traffic light programs: links, crossings, and fixed phases."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import TypeAlias

from scex_sumo.base.errors import MapError
from scex_sumo.converters.registries import DATASETS, dataset_of
from scex_sumo.geometry.polylines import length_of, project, turn
from scex_sumo.lanelet2sumo.plan.elements import Connection, Crossing, NetLayout, Programme, Walks
from scex_sumo.lanelet2sumo.topology.graph import Groups
from scex_sumo.road import Lane, Regulation, Road
from scex_sumo.roads.conflicts import Conflict
from scex_sumo.roads.places import lanes_ahead

GREEN_S, YELLOW_S, ALL_RED_S = 25, 3, 2
AT_LINE_M = 2.0  # how far stop lines reach into crosswalks, as drawn
BEFORE_END_M = 30.0  # from a crosswalk to the end of its light's lane
AHEAD_M = 60.0  # where conflicts with other lights' traffic count
ONCOMING = math.radians(135.0)


def plan_lights(
    road: Road,
    lanes: Mapping[int, Lane],
    conflicts: Sequence[Conflict],
    layout: NetLayout,
    walks: Walks,
    signals: Path | None,
) -> tuple[list[Programme], list[str]]:
    """Return the programmes of all lights, recorded ones (``signals``) first, and notes."""
    recorded, notes = None, list[str]()
    if signals is not None:
        if (read := dataset_of(signals).signals) is None:
            raise MapError(
                f"{signals}: not a recording of signal phases; give a CSV with the column signal_group_id, "
                f"or a file of a dataset that has phases, of {', '.join(DATASETS.paths)}"
            )
        recorded, notes = read(layout, road, signals)
    taken = {c.internal.name for c in recorded.connections} if recorded is not None else set()
    fixed = fixed_programmes(layout, lanes, road.regulations, conflicts)
    free = (p for p in fixed if taken.isdisjoint(c.internal.name for c in p.connections))
    programmes = [*([] if recorded is None else [recorded]), *free]
    return with_crossings(programmes, recorded, walks, layout), notes


def fixed_programmes(
    layout: NetLayout, lanes: Mapping[int, Lane], rules: Sequence[Regulation], conflicts: Sequence[Conflict]
) -> list[Programme]:
    """Return a program for each group of traffic_light elements whose traffic conflicts.

    Oncoming elements share a phase, in which left turns give way.
    """
    clashing = {pair for c in conflicts if c.kind != "diverge" for pair in (c.lanes, c.lanes[::-1])}
    lit = ((x, controlled(layout, x, clashing, lanes)) for x in rules if x.kind == "traffic_light")
    groups = [(rule, links) for rule, links in lit if links]
    ahead = [set(lanes_ahead(lanes, rule.lanes, AHEAD_M)) for rule, _ in groups]
    against = [
        {j for j, b in enumerate(ahead) if j != i and any((p, q) in clashing for p in a for q in b)}
        for i, a in enumerate(ahead)
    ]
    programmes = []
    joined: Groups[int] = Groups()
    for i, others in enumerate(against):
        for j in others:
            joined.join(i, j)
    clusters: dict[int, list[int]] = {}
    for i in range(len(against)):
        clusters.setdefault(joined.name(i), []).append(i)
    for cluster in clusters.values():
        stages = _stages(cluster, against, [links for _, links in groups])
        name = f"tl{min(groups[i][0].element_id for i in cluster)}"
        links = list({id(c): c for i in cluster for c in groups[i][1]}.values())
        greens = [{id(c) for i in stage for c in groups[i][1]} for stage in stages]
        programmes.append(Programme(name=name, connections=tuple(links), phases=_phases(links, greens)))
    return programmes


def controlled(
    layout: NetLayout, rule: Regulation, clashing: set[tuple[int, int]], lanes: Mapping[int, Lane]
) -> list[Connection]:
    """Return the links that a light controls: those that leave its lanes, or enter lanes in conflict.

    Some maps give the light to the approach, others to the lanelet across. Crosswalks behind the stop line,
    or shortly before the end of the lanes, are controlled too.
    """
    crossing = {lane for lane, _ in clashing}
    links = []
    for c in layout.connections:
        first, *others = c.lanelets
        for lane in rule.lanes:
            # A lane that begins at the map's border is entered where its first edge ends.
            enters = lane in others or (first == lane and c.enters)
            leaves = first == lane and (bool(others) or _held(lanes[lane], rule, c.internal.starts[-1][1]))
            if enters if lane in crossing else leaves:
                links.append(c)
                break
    return links


def _held(lane: Lane, rule: Regulation, start: float) -> bool:
    stops = [project(line, lane.centreline) for line in rule.stop_lines]
    held = [float(s[gap < lane.width_m].mean()) for s, gap in stops if (gap < lane.width_m).any()]
    if held:
        return max(held) < start + AT_LINE_M
    return length_of(lane.centreline) - start < BEFORE_END_M


def _stages(
    cluster: Sequence[int], against: Sequence[set[int]], links: Sequence[Sequence[Connection]]
) -> list[list[int]]:
    def together(i: int, j: int) -> bool:
        entries = ((p.entry, q.entry) for p in links[i] for q in links[j])
        return j not in against[i] or all(abs(turn(*both)) > ONCOMING for both in entries)

    stages: list[list[int]] = []
    for i in cluster:
        stage = next((stage for stage in stages if all(together(i, j) for j in stage)), None)
        if stage is None:
            stages.append([i])
        else:
            stage.append(i)
    return stages


def _phases(links: Sequence[Connection], greens: Sequence[set[int]]) -> tuple[tuple[float, str], ...]:
    phases: list[tuple[float, str]] = []
    for k, green in enumerate(greens):
        following = greens[(k + 1) % len(greens)]
        on = {c.internal.name: "G" for c in links if id(c) in green}
        phases.append((GREEN_S, phase_state(links, on)))
        if len(greens) == 1:
            break
        change = {c.internal.name: "G" if id(c) in following else "y" for c in links if id(c) in green}
        phases.append((YELLOW_S, phase_state(links, change)))
        rest = {name: letter for name, letter in change.items() if letter == "G"}
        phases.append((ALL_RED_S, phase_state(links, rest)))
    return tuple(phases)


_Phases: TypeAlias = Sequence[tuple[float, str]]
_Crossed: TypeAlias = Mapping[int, bool]  # link indices of a programme, and whether the links turn

WALK_S, CLEAR_S = 10, 5  # phase for people; time to leave the crossing
TURNING_RAD = 0.35  # 20 degrees: who turns lets people cross


def with_crossings(
    programmes: Sequence[Programme], recorded: Programme | None, walks: Walks, layout: NetLayout
) -> list[Programme]:
    """Add the crossings of its links to each program.

    People walk while links that they cross are red or turn; else a fixed program gets a phase for people.
    """
    nodes = {node.name: node for node in layout.nodes}
    taken: set[str] = set()
    result = []
    for programme in programmes:
        index = {c.internal.name: k for k, c in enumerate(programme.connections)}
        lit: list[tuple[Crossing, _Crossed]] = []
        for crossing in walks.crossings:
            links = [nodes[crossing.node].connections[k] for k in crossing.crossed]
            crossed: _Crossed = {
                index[c.internal.name]: abs(c.bend) > TURNING_RAD for c in links if c.internal.name in index
            }
            if crossed and crossing.lane.edge not in taken:
                taken.add(crossing.lane.edge)
                lit.append((crossing, crossed))
        phases: _Phases = programme.phases
        for _, crossed in lit:
            phases = _with_crossing(phases, crossed)
        closed = [k for k in range(len(lit)) if not any(state[-len(lit) + k] == "G" for _, state in phases)]
        if closed and programme is not recorded:
            phases = _with_phase_of_their_own(phases, len(lit), closed)
        names = tuple(crossing.lane.edge for crossing, _ in lit)
        result.append(replace(programme, phases=tuple(phases), crossings=names))
    return result


def _with_crossing(phases: _Phases, crossed: _Crossed) -> tuple[tuple[float, str], ...]:
    straight = [k for k, turns in crossed.items() if not turns]
    free = [all(state[k] == "r" for k in straight) for _, state in phases]
    result = []
    for p, (seconds, state) in enumerate(phases):
        following = [*range(p + 1, len(phases)), *range(p + 1)]
        clear_s = sum(phases[k][0] for k in takewhile(free.__getitem__, following))
        walk = free[p] and (all(free) or clear_s >= CLEAR_S)
        letters = ["g" if walk and x == "G" and k in crossed else x for k, x in enumerate(state)]
        result.append((seconds, "".join(letters) + "rG"[walk]))
    return tuple(result)


def _with_phase_of_their_own(phases: _Phases, crossings: int, closed: Sequence[int]) -> _Phases:
    last = phases[-1][1]
    links = len(last) - crossings
    change = "".join("y" if x in "Gg" and k < links else "r" for k, x in enumerate(last))
    red = "r" * len(last)
    walk = "r" * links + "".join("G" if k in closed else "r" for k in range(crossings))
    before = [(float(YELLOW_S), change), (float(ALL_RED_S), red)] if "y" in change else []
    return [*phases, *before, (float(WALK_S), walk), (float(CLEAR_S), red)]


def phase_state(links: Sequence[Connection], lit: dict[str, str]) -> str:
    """Format one phase: letters by internal lane, red if not named.

    Green becomes ``g`` if a foe with priority also has green or no light.
    """
    known = {c.internal.name for c in links}
    letters = []
    for c in links:
        letter = lit.get(c.internal.name, "r")
        if letter == "G":
            prefix = c.internal.name.rsplit("_", 2)[0]
            foes = [f"{prefix}_{j}_0" for j in c.response]
            if any(lit.get(foe, "r") in "Gg" or foe not in known for foe in foes):
                letter = "g"
        letters.append(letter)
    return "".join(letters)
