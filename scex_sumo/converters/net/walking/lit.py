"""Lit crossings: when the lights of a junction let people walk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

from scex_sumo.converters.net.elements import NetLayout
from scex_sumo.converters.net.lights import ALL_RED_S, YELLOW_S, Programme
from scex_sumo.converters.net.walking.walks import Crossing, Walks

_Phases: TypeAlias = Sequence[tuple[float, str]]
_Crossed: TypeAlias = Mapping[int, bool]  # link indices of a programme, and whether the links turn

WALK_S, CLEAR_S = 10, 5  # a phase of people's own; what they get to leave the crossing before cars start
TURNING_RAD = 0.35  # 20 degrees: who turns lets people cross


def with_crossings(
    programmes: Sequence[Programme], recorded: Programme | None, walks: Walks, layout: NetLayout
) -> tuple[list[Programme], list[int]]:
    """Programmes with the crossings of the links that they control.

    People may walk while the links that they cross are red, or turn. Where that is never so, a fixed
    programme gets a phase of their own.

    Args:
        programmes: of the links.
        recorded: the one of them that must stay as it was recorded.
        walks: the crossings.
        layout: the net.

    Returns:
        The programmes, and the crosswalks that the recorded one never leaves free.
    """
    nodes = {node.name: node for node in layout.nodes}
    taken: set[str] = set()
    result, never = [], []
    for programme in programmes:
        index = {c.internal.name: k for k, c in enumerate(programme.connections)}
        lit: list[tuple[Crossing, _Crossed]] = []
        for crossing in walks.crossings:
            links = [nodes[crossing.node].connections[k] for k in crossing.crossed]
            crossed: _Crossed = {
                index[c.internal.name]: abs(c.link.bend) > TURNING_RAD
                for c in links
                if c.internal.name in index
            }
            if crossed and crossing.name not in taken:
                taken.add(crossing.name)
                lit.append((crossing, crossed))
        phases: _Phases = programme.phases
        for _, crossed in lit:
            phases = _with_crossing(phases, crossed)
        closed = [k for k in range(len(lit)) if not any(state[-len(lit) + k] == "G" for _, state in phases)]
        if closed and programme is recorded:
            never += [i for k in closed for i in lit[k][0].lane.lanelets]
        elif closed:
            phases = _with_phase_of_their_own(phases, len(lit), closed)
        names = tuple(crossing.name for crossing, _ in lit)
        result.append(replace(programme, phases=tuple(phases), crossings=names))
    return result, never


def _with_crossing(phases: _Phases, crossed: _Crossed) -> tuple[tuple[float, str], ...]:
    """Phases with one more letter each; links that turn where people walk give way to them."""
    straight = [k for k, turns in crossed.items() if not turns]
    free = [all(state[k] == "r" for k in straight) for _, state in phases]
    result = []
    for p, (seconds, state) in enumerate(phases):
        walk = free[p] and _free_after(phases, free, p) >= CLEAR_S
        letters = ["g" if walk and x == "G" and k in crossed else x for k, x in enumerate(state)]
        result.append((seconds, "".join(letters) + "rG"[walk]))
    return tuple(result)


def _free_after(phases: _Phases, free: Sequence[bool], p: int) -> float:
    """Seconds from the end of a phase on that a crossing stays free."""
    seconds = 0.0
    for k in range(1, len(phases) + 1):
        following = (p + k) % len(phases)
        if not free[following]:
            return seconds
        seconds += phases[following][0]
    return seconds if seconds >= CLEAR_S else float("inf")


def _with_phase_of_their_own(phases: _Phases, crossings: int, closed: Sequence[int]) -> _Phases:
    """Phases in which some crossings are free at the end, and before that the change to red."""
    last = phases[-1][1]
    links = len(last) - crossings
    change = "".join("y" if x in "Gg" and k < links else "r" for k, x in enumerate(last))
    red = "r" * len(last)
    walk = "r" * links + "".join("G" if k in closed else "r" for k in range(crossings))
    before = [(float(YELLOW_S), change), (float(ALL_RED_S), red)] if "y" in change else []
    return [*phases, *before, (float(WALK_S), walk), (float(CLEAR_S), red)]
