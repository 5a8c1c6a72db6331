"""Links of junctions without rules: with lights, if vehicles queue before them; else turns that wait."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.geometry.polylines import heading, turn
from scex_sumo.road import Signal
from scex_sumo.rules.states import STANDS_MPS
from scex_sumo.scene import SeedScene

NO_SIGN = ""  # state of links of which a map says nothing
OPPOSED_RAD, TURNS_RAD = np.deg2rad(135.0), np.deg2rad(30.0)
MIN_APPROACHES = 3  # edges that lead to the junction: two merge
MIN_QUEUES, MIN_QUEUED = 2, 2  # lanes with a queue; vehicles in it
FIRST_M, NEXT_M = 15.0, 15.0  # from the first one to the junction, and from front to front
ACROSS_M, ALONG_COS = 1.6, 0.9  # of a vehicle from the middle of its lane, of its heading
LINE_M = 0.5, 3.0  # of a stop line: before the first one, and its length


@dataclass(frozen=True, eq=False)
class Link:
    """Link of a net from a lane to a lane, with its light (light, index) and the rows to which it yields."""

    line: FloatArray
    lanes: tuple[str, ...]
    junction: str
    row: int
    yields: frozenset[int]
    state: str
    light: tuple[str, int] | None

    @property
    def headings(self) -> tuple[float, float]:
        """Headings at its beginning and its end, rad."""
        return heading(self.line, end=False), heading(self.line, end=True)


def apparent_lights(
    scene: SeedScene, links: Sequence[Link]
) -> tuple[list[Link], dict[tuple[str, int], Signal], list[FloatArray]]:
    """Return the links of a junction from lanes with queues, lights of unknown state, and stop lines.

    Lanes of one edge share a light. Without queues on several lanes there are none. Nothing is known of the
    lights of other lanes.
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
    """Return the stop line (2, 2) before which a queue stands, m; None without a queue.

    ``begin``: (2, 2) first points of the way through the junction.
    """
    now, along = scene.now, (begin[1] - begin[0]) / np.hypot(*(begin[1] - begin[0]))
    half, across = scene.length / 2, np.array([-along[1], along[0]])
    x, y = now.x + half * np.cos(now.heading) - begin[0, 0], now.y + half * np.sin(now.heading) - begin[0, 1]
    way, aside = -(along[0] * x + along[1] * y), np.abs(across[0] * x + across[1] * y)
    aligned = np.cos(now.heading) * along[0] + np.sin(now.heading) * along[1] > ALONG_COS
    there = (now.speed < STANDS_MPS) & aligned & (aside < ACROSS_M) & (way > -LINE_M[0])
    queue = np.sort(way[there])
    if len(queue) < MIN_QUEUED or queue[0] > FIRST_M or queue[1] - queue[0] > NEXT_M:
        return None
    place = begin[0] - max(queue[0] - LINE_M[0], 0.0) * along
    return np.stack([place - LINE_M[1] / 2 * across, place + LINE_M[1] / 2 * across])


def turns_that_wait(links: Sequence[Link]) -> list[Link]:
    """Return the links of a junction without rules, of which those across oncoming traffic yield to it."""
    ways = {link.row: link.headings for link in links}  # not of crosswalks, to which links yield, too

    def comes(row: int, link: Link) -> bool:
        (begins, ends), (mine, my_end) = ways[row], link.headings
        opposed = abs(turn(begins, mine)) > OPPOSED_RAD
        return bool(opposed and abs(turn(begins, ends)) < TURNS_RAD < abs(turn(mine, my_end)))

    oncoming = [frozenset(row for row in link.yields & ways.keys() if comes(row, link)) for link in links]
    return [replace(link, state=NO_SIGN, yields=rows) for link, rows in zip(links, oncoming, strict=True)]
