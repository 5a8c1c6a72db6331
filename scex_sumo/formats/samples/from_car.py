"""Recordings from a car: vehicles beyond the mapped lanes, and parked ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from scex_sumo.base.arrays import BoolArray
from scex_sumo.base.errors import listed
from scex_sumo.converters.tracks.rows import TrackRows, TrackTable, joined_rows
from scex_sumo.road import Road
from scex_sumo.roads.matching import match

OUTSIDE_M = 5.0  # from all lanes: there the map ends, or a parking lot begins
PARKED_M = 1.0  # a vehicle that stays within this never moves
PARKED_SHARE = 0.3  # of a lane's width: a vehicle this far from the middle does not wait in the lane


def within_map(table: TrackTable, road: Road) -> tuple[TrackTable, list[str]]:
    """Cut tracks of vehicles where they leave the mapped lanes, and make obstacles of parked vehicles.

    A parked vehicle never moves and stands beside the middle of every lane. Returns a phrase for each.
    """
    rows, notes = table.vehicles, []
    areas = [shapely.make_valid(shapely.Polygon(lane.outline)) for lane in road.vehicle_lanes.values()]
    points, tree = shapely.points(rows.x, rows.y), shapely.STRtree(areas)
    near = tree.query(points, predicate="dwithin", distance=OUTSIDE_M)[0]
    inside = np.bincount(near, minlength=len(rows)) > 0
    if not inside.all():
        cut = sorted({rows.labels[k] for k in rows.track[~inside]}, key=lambda label: (len(label), label))
        notes.append(
            f"{len(cut)} of {rows.tracks} vehicles are over {OUTSIDE_M:g} m from all mapped lanes, left out "
            f"there: {listed(cut)}"
        )
        kept = rows.take(inside)
        gaps = np.cumsum(~inside)[inside]  # so many samples are missing before each one
        new = np.append(True, (np.diff(kept.segment) != 0) | (np.diff(gaps) > 0))[: len(kept)]
        rows = kept.with_columns(segment=np.cumsum(new) - 1)
    parked = _parked(rows, road)
    if parked.any():
        still = rows.take(parked[rows.track])
        notes.append(
            f"{still.tracks} vehicles that never move stand beside the lanes: parked, taken for obstacles"
        )
        still = replace(still, types=("parked",) * still.tracks)
        rows, others = rows.take(~parked[rows.track]), joined_rows(table.others, still)
        table = replace(table, others=others)
    return replace(table, vehicles=rows), notes


def _parked(rows: TrackRows, road: Road) -> BoolArray:
    if not len(rows):
        return np.zeros(0, bool)
    begin = np.flatnonzero(np.append(True, np.diff(rows.track) != 0))
    xs, ys = (np.split(values, begin[1:]) for values in (rows.x, rows.y))  # by track
    spread = np.array([[np.ptp(np.quantile(track, (0.05, 0.95))) for track in axis] for axis in (xs, ys)])
    single = np.diff(begin, append=len(rows)) == 1
    leaves = single & (rows.speed[begin] > PARKED_M)  # within a second, by the speed of its only sample
    still = (np.hypot(*spread) < PARKED_M) & ~leaves
    middle = (begin + np.append(begin[1:], len(rows))) // 2
    matches = match(road, rows.x[middle], rows.y[middle], rows.psi_rad[middle])
    widths = np.array([road.lanes[int(i)].width_m for i in matches.lane_id])
    waiting = matches.vehicle[np.abs(matches.offset) <= PARKED_SHARE * widths]
    return np.asarray(still & ~np.isin(np.arange(rows.tracks), waiting))
