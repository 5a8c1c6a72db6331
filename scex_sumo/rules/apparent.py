"""Lights that a junction without regulations apparently has, by its queues; turns that wait elsewhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.sumo_net import LaneTable
from scex_sumo.geometry.polylines import turn
from scex_sumo.road_rules import Rules, Signal
from scex_sumo.rules.links import Link, passages_of
from scex_sumo.rules.passages import NO_SIGN, STANDS_MPS
from scex_sumo.scene import SeedScene

OPPOSED_RAD, TURNS_RAD = np.deg2rad(135.0), np.deg2rad(30.0)
MIN_APPROACHES = 3  # edges that lead to the junction: two merge
MIN_QUEUES, MIN_QUEUED = 2, 2  # lanes with a queue; vehicles in it
FIRST_M, NEXT_M = 15.0, 15.0  # from the first one to the junction, and from front to front
ACROSS_M, ALONG_COS = 1.6, 0.9  # of a vehicle from the middle of its lane, of its heading
LINE_M = 0.5, 3.0  # of a stop line: before the first one, and its length


def with_apparent_lights(
    scene: SeedScene, junctions: Mapping[str, Sequence[Link]], lanes: LaneTable, rules: Rules
) -> Rules:
    """Add the lights that a road without regulations apparently has; elsewhere turns across traffic wait.

    ``junctions``: the links of each junction of its net.
    """
    passages, stops, notes = list(rules.passages), list(rules.stop_lines), list(rules.notes)
    signals: dict[tuple[str, int], Signal] = {}
    for junction, links in junctions.items():
        lit, states, lines = apparent_lights(scene, links)
        if lit:
            signals |= states
            passages += passages_of(lit, len(passages), signals, lanes)
            stops += lines
            why = f"vehicles queue on {len(lines)} lanes before it"
            notes.append(f"junction {junction} apparently has lights, whose states are inferred: {why}")
        else:
            turns = turns_that_wait(links)
            waits = any(link.yields for link in turns)
            passages += passages_of(turns, len(passages), {}, lanes) if waits else ()
    return replace(
        rules,
        passages=tuple(passages),
        signals=tuple(signals.values()),
        stop_lines=tuple(stops),
        notes=tuple(notes),
    )


def apparent_lights(
    scene: SeedScene, links: Sequence[Link]
) -> tuple[list[Link], dict[tuple[str, int], Signal], list[FloatArray]]:
    """Return the links of a junction from lanes with queues, lights of unknown state, and stop lines.

    Lanes of one edge share a light. Without queues on several lanes there are none.
    """
    lanes = sorted({link.lanes[0] for link in links})
    if len({lane.rpartition("_")[0] for lane in lanes}) < MIN_APPROACHES:
        return [], {}, []
    begins = {link.lanes[0]: link.line[:2] for link in links}
    stops = {lane: line for lane in lanes if (line := _stop_line(scene, begins[lane])) is not None}
    if len(stops) < MIN_QUEUES:
        return [], {}, []
    edges = sorted({lane.rpartition("_")[0] for lane in stops})
    lights = {lane: (links[0].junction, edges.index(lane.rpartition("_")[0])) for lane in stops}
    lit = [replace(link, light=lights[link.lanes[0]]) for link in links if link.lanes[0] in stops]
    return lit, {light: Signal() for light in lights.values()}, [*stops.values()]


def _stop_line(scene: SeedScene, begin: FloatArray) -> FloatArray | None:
    """Return the stop line (2, 2) of a queue before a way (2, 2), m; None without one."""
    now, along = scene.now, (begin[1] - begin[0]) / np.hypot(*(begin[1] - begin[0]))
    half, across = scene.length / 2, np.array([-along[1], along[0]])
    x, y = now.x + half * np.cos(now.heading) - begin[0, 0], now.y + half * np.sin(now.heading) - begin[0, 1]
    before_m, aside = -(along[0] * x + along[1] * y), np.abs(across[0] * x + across[1] * y)
    aligned = np.cos(now.heading) * along[0] + np.sin(now.heading) * along[1] > ALONG_COS
    there = (now.speed < STANDS_MPS) & aligned & (aside < ACROSS_M) & (before_m > -LINE_M[0])
    queue = np.sort(before_m[there])
    if len(queue) < MIN_QUEUED or queue[0] > FIRST_M or queue[1] - queue[0] > NEXT_M:
        return None
    place = begin[0] - max(queue[0] - LINE_M[0], 0.0) * along
    return np.stack([place - LINE_M[1] / 2 * across, place + LINE_M[1] / 2 * across])


def turns_that_wait(links: Sequence[Link]) -> list[Link]:
    """Return the links of a junction without rules, of which those across oncoming traffic yield to it."""
    headings = {link.row: link.headings for link in links}  # not of crosswalks, to which links yield, too

    def comes(row: int, link: Link) -> bool:
        (begins, ends), (mine, my_end) = headings[row], link.headings
        opposed = abs(turn(begins, mine)) > OPPOSED_RAD
        return bool(opposed and abs(turn(begins, ends)) < TURNS_RAD < abs(turn(mine, my_end)))

    oncoming = [frozenset(row for row in link.yields & headings.keys() if comes(row, link)) for link in links]
    return [replace(link, state=NO_SIGN, yields=rows) for link, rows in zip(links, oncoming, strict=True)]
