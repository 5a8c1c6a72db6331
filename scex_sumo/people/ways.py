"""Ways of people: pedestrians along footways and crossings, cyclists along lanes, where the map has them.

A person keeps its place beside the middle of the way and its angle to it; the way adds its bends to the
motion that the person shows. Where ways fork, each future has its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.cache import owner_cache
from scex_sumo.behaviors.driving.leaders import Leaders, find_leaders
from scex_sumo.behaviors.driving.paths import BEHIND_M, SeedPaths, chosen_paths
from scex_sumo.behaviors.driving.projection import expected_way, foot_points, sample_paths
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Lane, Road
from scex_sumo.scene import SceneHistory, VehicleIndex

ANGLE_RAD, ASIDE_M = np.deg2rad(30), 3.0  # to the way, at which one is on it
RADIUS_M, MARGIN_M = 40.0, 0.2  # of leaders; beyond the cyclist's width on each side
HEADING = 4  # among `COLUMNS` of paths


@dataclass(frozen=True, kw_only=True, eq=False)
class Ways:
    """Ways of n people; those that are on none go straight on."""

    paths: SeedPaths
    row: IntArray  # (n,)
    s: FloatArray  # (n,) place now, m
    begin: FloatArray  # (n,) direction of the way in the seed scene, rad
    on: BoolArray  # (n,)
    aside: FloatArray  # (n,) place beside its middle now, m

    def bend(self) -> Callable[[FloatArray], FloatArray]:
        """Return the function of further ways (n,), m, that gives the turns (n,) since the seed scene."""

        def turns(way: FloatArray) -> FloatArray:
            now = sample_paths(self.paths, self.row, self.s + way)[HEADING]
            return np.where(self.on, now - self.begin, 0.0)

        return turns

    def leaders(self, history: SceneHistory, who: VehicleIndex) -> Leaders:
        """Return the leaders of those that are on a way."""
        leaders = find_leaders(
            history,
            who,
            self.paths,
            self.row,
            self.s,
            clearance=0.0,
            obstacle_clearance=0.0,
            radius=RADIUS_M,
            aside=self.aside,
            margin=MARGIN_M,
        )
        return replace(leaders, gap=np.where(self.on, leaders.gap, np.inf))


def ways_of(history: SceneHistory, road: Road, who: VehicleIndex, kind: str) -> Ways | None:
    """Return the ways of people of a kind; None if the map has none."""
    own = used_road(road, kind)
    if not own.lanes:
        return None
    paths, row = chosen_paths(history, own, who, "random")
    seed, now = history.scene.now[who.vehicle], history.now[who.future, who.vehicle]
    _, _, begin = foot_points(paths, row, seed.x, seed.y, np.full(len(who), BEHIND_M))
    s, aside, _ = foot_points(paths, row, now.x, now.y, expected_way(history, who))
    on = paths.on_road[who.vehicle] & (np.abs(wrap(seed.heading - begin)) < ANGLE_RAD)
    return Ways(paths=paths, row=row, s=s, begin=begin, on=on & (np.abs(aside) < ASIDE_M), aside=aside)


@owner_cache
def used_road(road: Road, kind: str) -> Road:
    """Return the lanes that people of a kind use, as those of vehicles: footways in both directions."""
    if kind == "bicycle":
        lanes = [lane for lane in road.lanes.values() if lane.kind in ("vehicle", "bicycle")]
    else:
        walked = {k: lane for k, lane in road.lanes.items() if lane.kind == "pedestrian"}
        other = max(walked, default=0) + 1
        lanes = [*walked.values(), *(_reversed(lane, other) for lane in walked.values())]
    return replace(
        road, lanes={lane.lane_id: replace(lane, kind="vehicle") for lane in lanes}, regulations=(), net=None
    )


def _reversed(lane: Lane, first: int) -> Lane:
    return replace(
        lane,
        lane_id=first + lane.lane_id,
        centreline=lane.centreline[::-1],
        left_bound=lane.right_bound[::-1],
        right_bound=lane.left_bound[::-1],
        successors=tuple(first + k for k in lane.predecessors),
        predecessors=tuple(first + k for k in lane.successors),
        left=None,
        right=None,
        adjacent_left=None,
        adjacent_right=None,
    )
