"""SUMO net of a road: its files, its lane table, and the text of its shapes."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.road import MapLoss

RECORDED = "recorded"  # programID of a light that replays a recording


@dataclass(frozen=True, kw_only=True, eq=False)
class SumoNet:
    """A converted net: NET.net.xml, drawing for sumo-gui, lane table; what could not be converted, and what
    is lost.

    Example:
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> net = scex.convert(scene.road, Path("roundabout.net.xml"))
        >>> net.path.name, len(net.losses)
        ('roundabout.net.xml', 0)
    """

    path: Path
    extras: Path | None
    lanes: LaneTable
    notes: tuple[str, ...] = ()
    losses: tuple[MapLoss, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class WrittenNet:
    """Net before its files are written: content of NET.net.xml and of NET.add.xml, and the lane table."""

    content: str
    drawing: str
    lanes: LaneTable
    notes: tuple[str, ...] = ()
    losses: tuple[MapLoss, ...] = ()


OPENDRIVE = ".xodr"
DECIMALS = 3  # millimetres: what SUMO's tools expect
LANE_WIDTH_M = 3.2  # SUMO's own for lanes without a width


def net_file(net_path: Path, suffix: str) -> Path:
    """Return the path beside NET.net.xml with another ending: NET + suffix."""
    return net_path.with_name(net_path.name.removesuffix(".xml").removesuffix(".net") + suffix)


HEADER = ["lanelet_id", "lane_id"]


@dataclass(frozen=True, eq=False)
class LaneTable:
    """Lane table: lanelets to SUMO lanes and back, internal lanes included, in driving order.

    A lanelet may span several SUMO lanes, and an internal lane several lanelets.

    Attributes:
        rows: (lanelet id, SUMO lane), in driving order for each lanelet and for each SUMO lane.
        ends: edges before and after each internal SUMO lane.
    """

    rows: tuple[tuple[int, str], ...]
    ends: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    @cached_property
    def _of(self) -> dict[int, list[str]]:
        of: dict[int, list[str]] = {}
        for lanelet, sumo_lane in self.rows:
            of.setdefault(lanelet, []).append(sumo_lane)
        return of

    @cached_property
    def _on(self) -> dict[str, list[int]]:
        on: dict[str, list[int]] = {}
        for lanelet, sumo_lane in self.rows:
            on.setdefault(sumo_lane, []).append(lanelet)
        return on

    def sumo_lanes(self, lanelet_id: int) -> tuple[str, ...]:
        """Return the SUMO lanes of a lanelet, in driving order; empty if the net does not hold it."""
        return tuple(self._of.get(lanelet_id, ()))

    def lanelets(self, sumo_lane: str) -> tuple[int, ...]:
        """Return the lanelets under a SUMO lane, in driving order; empty for an unknown one."""
        return tuple(self._on.get(sumo_lane, ()))

    def edges(self, lanelet_ids: Sequence[int]) -> list[str]:
        """Return the SUMO route (non-internal edges) for a sequence of lanelets.

        If the sequence begins (ends) inside a junction, the edge before (after) it is added.
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
        end, direction = (0, 1) if first else (-1, -1)
        lanes = self.sumo_lanes(lanelet_ids[end])[::direction] if lanelet_ids else ()
        if not lanes or not lanes[0].startswith(":"):
            return None
        ends = (self.ends[sumo_lane][::direction] for sumo_lane in lanes if sumo_lane in self.ends)
        return next((beyond for beyond, joined in ends if not route or joined == route[end]), None)

    @property
    def text(self) -> str:
        """The table as CSV with the header ``lanelet_id,lane_id``."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(HEADER)
        writer.writerows(self.rows)
        return buffer.getvalue()


def shape_text(line: FloatArray, decimals: int = DECIMALS) -> str:
    """Format a polyline as SUMO does: ``x,y x,y``."""
    # Adding 0.0 turns a rounded -0.0 into 0.0.
    return " ".join(
        f"{x:.{decimals}f},{y:.{decimals}f}" for x, y in (np.round(line, decimals) + 0.0).tolist()
    )


def points_of(shape: str) -> FloatArray:
    """Return the points (P, 2) of a shape; SUMO may mix points with and without a height."""
    return np.array([point.split(",")[:2] for point in shape.split()], dtype=np.float64).reshape(-1, 2)
