"""Floating car data (FCD): SUMO's format of trajectories, for replays in sumo-gui.

SUMO needs a lane for every position: the nearest one with a similar direction. A vehicle's first lane is
outside of junctions, where SUMO inserts no vehicle. So are all edges of a pedestrian: SUMO removes persons
from edges within junctions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr as quoted

import numpy as np
import shapely
from numpy.typing import NDArray

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, least_of
from scex_sumo.lanelet2sumo.reader import read_net
from scex_sumo.scene import STEP_S, States
from scex_sumo.world.batch import to_sumo
from scex_sumo.world.tiles import tile_id

_TURN_COST_M_PER_RAD = 3.0  # a lane in another direction costs as much as one farther away
_NEAR_M = 8.0


@dataclass(frozen=True, kw_only=True, eq=False)
class FcdTracks:
    """Tracks of N vehicles in one tile, with an offset in m; its slot is None in a net without tiles.

    States (N, T) are centres in the net's coordinates, ``present`` from first to last appearance; lengths
    (N,) in m; ``walks`` (N,) marks pedestrians.
    """

    ids: Sequence[str]
    types: Sequence[str]
    walks: BoolArray
    length: FloatArray
    states: States
    present: BoolArray
    tile: int | None = None
    offset: tuple[int, int] = (0, 0)


class LaneFinder:
    """Index of a SUMO net's lanes by position and heading."""

    def __init__(self, net_path: Path) -> None:
        """Read the lanes; a `MapError` names one that cannot be read."""
        lanes = [x for x in read_net(net_path).lanes.values() if x.function in ("normal", "internal")]
        self._names = [lane.lane_id for lane in lanes]
        self._lines = np.array([lane.line for lane in lanes])
        self._inside = np.array([lane.internal for lane in lanes])
        self._tree = shapely.STRtree(self._lines)
        self._outer = np.flatnonzero(~self._inside)
        self._outer_tree = shapely.STRtree(self._lines[self._outer])

    def find(
        self, x: FloatArray, y: FloatArray, heading: FloatArray, first: BoolArray
    ) -> tuple[list[str], FloatArray]:
        """Return (n) lane ids of places and (n,) positions along them, m; ``first`` outside of junctions."""
        places = shapely.points(x, y)
        place, lane = self._tree.query(places, predicate="dwithin", distance=_NEAR_M)
        allowed = ~(first[place] & self._inside[lane])
        place, lane = place[allowed], lane[allowed]
        cheapest = least_of(place, self._cost(lane, places[place], heading[place]))
        near = place[cheapest]
        chosen = np.empty(len(places), dtype=np.int64)
        chosen[near] = lane[cheapest]
        far = np.setdiff1d(np.arange(len(places)), near)
        if len(far):
            chosen[far] = self._outer[self._outer_tree.nearest(places[far])]
        along = shapely.line_locate_point(self._lines[chosen], places)
        return [self._names[i] for i in chosen], along

    def _cost(self, lanes: IntArray, places: NDArray[np.object_], heading: FloatArray) -> FloatArray:
        lines = self._lines[lanes]
        along = shapely.line_locate_point(lines, places)
        back = shapely.line_interpolate_point(lines, np.maximum(along - 0.5, 0.0))
        front = shapely.line_interpolate_point(lines, along + 0.5)
        direction = np.arctan2(
            shapely.get_y(front) - shapely.get_y(back), shapely.get_x(front) - shapely.get_x(back)
        )
        turn = np.abs(np.angle(np.exp(1j * (direction - heading))))
        cost: FloatArray = shapely.distance(lines, places) + _TURN_COST_M_PER_RAD * turn
        return cost


def write_fcd(path: Path, groups: Sequence[FcdTracks], lanes: LaneFinder) -> None:
    """Write tracks with equal numbers of steps as FCD, the first step at 0.1 s; ``lanes`` has no tiles."""
    steps = groups[0].states.shape[1]
    rows: list[list[str]] = [[] for _ in range(steps)]
    for group in groups:
        x, y, angle = to_sumo(group.states, group.length[:, None])
        dx, dy = group.offset
        there = group.present
        first = there & ((np.cumsum(there, axis=1) == 1) | group.walks[:, None])
        names, along = lanes.find(x[there], y[there], group.states.heading[there], first[there])
        vehicle, when = np.nonzero(there)
        heads = [
            f"        <{'person' if walks else 'vehicle'} id={quoted(key)} type={quoted(kind)}"
            for key, kind, walks in zip(group.ids, group.types, group.walks.tolist(), strict=True)
        ]
        places = (x[there] + dx, y[there] + dy, angle[there], group.states.speed[there], along)
        columns = [column.tolist() for column in (vehicle, when, *places)]
        for name, n, t, *numbers in zip(names, *columns, strict=True):
            lane = name if group.tile is None else tile_id(group.tile, name)
            at_x, at_y, turned, speed, position = numbers
            place = f"edge={quoted(lane.rpartition('_')[0])}" if group.walks[n] else f"lane={quoted(lane)}"
            rows[t].append(
                f'{heads[n]} x="{at_x:.6f}" y="{at_y:.6f}" angle="{turned:.6f}" speed="{speed:.6f}"'
                f' pos="{position:.2f}" {place} slope="0"/>\n'
            )
    with path.open("w", encoding="utf-8") as file:
        file.write('<?xml version="1.0" encoding="UTF-8"?>\n<fcd-export>\n')
        for step, vehicles in enumerate(rows, start=1):
            file.write(f'    <timestep time="{step * STEP_S:.2f}">\n{"".join(vehicles)}    </timestep>\n')
        file.write("</fcd-export>\n")
