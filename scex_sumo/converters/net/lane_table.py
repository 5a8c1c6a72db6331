"""Lane table: which SUMO lanes a lanelet became, and back."""

from __future__ import annotations

import csv
import heapq
import io
import xml.etree.ElementTree as ET
from collections.abc import Container, Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

from scex_sumo.errors import InputError

_Row: TypeAlias = tuple[int, str]  # lanelet, SUMO lane

HEADER = ["lanelet_id", "lane_id"]


class LaneTable:
    """Lanelet to SUMO lanes and back, internal lanes included, in driving order.

    A lanelet may span several SUMO lanes (road before a junction, internal lanes within it), and an internal
    lane may run over several lanelets.

    Attributes:
        rows: (lanelet id, SUMO lane), for each lanelet and for each SUMO lane in driving order.
        ends: for each internal SUMO lane the edges before and after it.
    """

    def __init__(
        self, rows: Iterable[tuple[int, str]], ends: dict[str, tuple[str, str]] | None = None
    ) -> None:
        """Build from rows.

        Args:
            rows: (lanelet id, SUMO lane), for each lanelet and for each SUMO lane in driving order.
            ends: for each internal SUMO lane the edges before and after it.
        """
        self.rows = tuple(rows)
        self.ends = dict(ends or {})
        self._of: dict[int, list[str]] = {}
        self._on: dict[str, list[int]] = {}
        for lanelet, sumo_lane in self.rows:
            self._of.setdefault(lanelet, []).append(sumo_lane)
            self._on.setdefault(sumo_lane, []).append(lanelet)
        if self.ends:
            self._of = {lanelet: self._in_order(lanes) for lanelet, lanes in self._of.items()}

    def _in_order(self, lanes: list[str]) -> list[str]:
        """A lanelet's SUMO lanes by what leads to what; rows alone cannot say that on a ring."""
        edges = {name.rsplit("_", 1)[0]: name for name in lanes}
        waiting: dict[str, set[str]] = {name: set() for name in lanes}
        for name in lanes:
            before, after = self.ends.get(name, ("", ""))
            if before in edges:
                waiting[name].add(edges[before])
            if after in edges:
                waiting[edges[after]].add(name)
        ordered: list[str] = []
        while waiting:
            first = next((name for name, others in waiting.items() if not others), next(iter(waiting)))
            del waiting[first]
            ordered.append(first)
            for others in waiting.values():
                others.discard(first)
        return ordered

    def sumo_lanes(self, lanelet_id: int) -> tuple[str, ...]:
        """SUMO lanes of a lanelet, in driving order; empty for a lanelet that the net leaves out."""
        return tuple(self._of.get(lanelet_id, ()))

    def lanelets(self, sumo_lane: str) -> tuple[int, ...]:
        """Lanelets under a SUMO lane, in driving order; empty for an unknown one."""
        return tuple(self._on.get(sumo_lane, ()))

    def edges(self, lanelet_ids: Sequence[int]) -> list[str]:
        """The SUMO route (non-internal edges) that drives a sequence of lanelets.

        Lanelets wholly inside a junction add no edge. Where the sequence begins (ends) inside one, the edge
        before (after) the junction is added, so that the route covers it.
        """
        route: list[str] = []
        last: list[str] = []
        for lanelet in lanelet_ids:
            edges = [s.rsplit("_", 1)[0] for s in self.sumo_lanes(lanelet) if not s.startswith(":")]
            if edges != last:  # the same edges again: a lane change
                route += edges
            last = edges or last
        for first in (True, False):
            beyond = self._beyond(lanelet_ids, route, first=first)
            if beyond is not None:
                route.insert(0 if first else len(route), beyond)
        return route

    def _beyond(self, lanelet_ids: Sequence[int], route: list[str], *, first: bool) -> str | None:
        """Edge before (after) a sequence whose first (last) SUMO lane is internal."""
        if not lanelet_ids:
            return None
        lanes = self.sumo_lanes(lanelet_ids[0 if first else -1])
        candidates = [s for s in lanes if s in self.ends and lanes and s.startswith(":")]
        outer = [s for s in (lanes[:1] if first else lanes[-1:]) if s.startswith(":")]
        if not outer:
            return None
        for sumo_lane in candidates if first else reversed(candidates):
            before, after = self.ends[sumo_lane]
            beyond, joined = (before, after) if first else (after, before)
            if not route or joined == route[0 if first else -1]:
                return beyond
        return None

    def write(self, path: Path) -> None:
        """Write as CSV with the header ``lanelet_id,lane_id``."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(HEADER)
        writer.writerows(self.rows)
        path.write_text(buffer.getvalue(), encoding="utf-8")

    @classmethod
    def read(cls, path: Path) -> LaneTable:
        """Read NET.lanes.csv; the edges around junctions come from NET.net.xml beside it, if there."""
        with path.open(encoding="utf-8", newline="") as file:
            reader = csv.reader(file)
            if next(reader, None) != HEADER:
                raise InputError(f"{path}: not a lane table; its first line must be {','.join(HEADER)}")
            rows = [(int(lanelet), sumo_lane) for lanelet, sumo_lane in reader]
        net = path.with_name(path.name.removesuffix(".lanes.csv") + ".net.xml")
        return cls(rows, read_ends(net) if net.is_file() else None)


def read_ends(net: Path) -> dict[str, tuple[str, str]]:
    """For each internal SUMO lane of a net the edges before and after it."""
    ends = {}
    for connection in ET.parse(net).getroot().iter("connection"):
        via = connection.get("via")
        before, after = connection.get("from", ""), connection.get("to", "")
        if via and not before.startswith(":"):
            ends[via] = (before, after)
    return ends


def lane_table(
    places: Iterable[tuple[str, list[tuple[int, float]]]],
    ends: dict[str, tuple[str, str]],
    known: Container[int],
) -> LaneTable:
    """Build the table, its rows in driving order along lanelets and along internal lanes over several.

    Args:
        places: each SUMO lane with the lanelets under it, in driving order, and the arc lengths at which it
            begins on them, m.
        ends: for each internal SUMO lane the edges before and after it.
        known: lanelets of the map; others are left out.
    """
    along: dict[int, list[tuple[float, str]]] = {}
    within: dict[_Row, set[_Row]] = {}
    for sumo_lane, stretches in places:
        keys = [(lanelet, sumo_lane) for lanelet, _ in stretches if lanelet in known]
        for k, key in enumerate(keys):
            within.setdefault(key, set()).update(keys[:k])
        for lanelet, start in stretches:
            if lanelet in known:
                along.setdefault(lanelet, []).append((start, sumo_lane))
    before: dict[_Row, set[_Row]] = {key: set() for key in within}
    for lanelet, stations in along.items():
        rows = [(lanelet, sumo_lane) for _, sumo_lane in sorted(stations)]
        for earlier, later in pairwise(rows):
            before[later].add(earlier)
    return LaneTable(_sorted(within, before), ends)


def _sorted(within: dict[_Row, set[_Row]], before: dict[_Row, set[_Row]]) -> list[_Row]:
    """Topological order, smallest row first; on rings, where there is none, that within SUMO lanes stays."""
    waiting = {key: within[key] | before[key] for key in within}
    following: dict[_Row, list[_Row]] = {}
    for key, others in waiting.items():
        for other in others:
            following.setdefault(other, []).append(key)
    ready = [key for key, others in waiting.items() if not others]
    heapq.heapify(ready)
    result: list[_Row] = []
    while waiting:
        if ready:
            key = heapq.heappop(ready)
        else:
            key = min(row for row in waiting if waiting.keys().isdisjoint(within[row]))
        if key not in waiting:
            continue
        del waiting[key]
        result.append(key)
        for later in following.get(key, ()):
            if later in waiting:
                waiting[later].discard(key)
                if not waiting[later]:
                    heapq.heappush(ready, later)
    return result
