"""Crosswalks on paths, and whether somebody is on them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.driving.leaders import everyone
from scex_sumo.behaviors.driving.paths import DS_M
from scex_sumo.road_rules import Rules
from scex_sumo.scene import SceneHistory

WALKER_M, WALKER_S = 1.0, (0.0, 1.0, 2.0)  # around a crosswalk; times ahead at which walkers count


@owner_cache
def crosswalk_areas(rules: Rules) -> tuple[shapely.Geometry, ...]:
    """Return the areas of the crosswalks."""
    return tuple(shapely.make_valid(shapely.Polygon(outline)) for outline in rules.crosswalks)


def walks_on(points: FloatArray, rules: Rules) -> Iterator[tuple[float, float, float, float]]:
    """Yield path, begin and end of each crosswalk on a path, and the index of the crosswalk."""
    areas = crosswalk_areas(rules)
    tree = shapely.STRtree(areas)
    for path, line in enumerate(points):
        for k in np.sort(tree.query(shapely.LineString(line), "intersects")).tolist():
            inside = np.flatnonzero(shapely.contains_xy(areas[k], line))
            if len(inside):
                yield path, DS_M * float(inside[0]), DS_M * float(inside[-1]), k


def used_crosswalks(history: SceneHistory, asked: IntArray) -> BoolArray:
    """Return whether somebody is on crosswalks (C, W), or steps on them; False for those not asked for."""
    rules, around = history.scene.rules, everyone(history)
    assert rules is not None
    now = around.states[:, around.obstacle]
    time = np.array(WALKER_S)[:, None, None]
    x = now.x + time * now.speed * np.cos(now.heading)
    y = now.y + time * now.speed * np.sin(now.heading)
    used = np.zeros((len(now.x), len(rules.crosswalks)), dtype=np.bool_)
    for k in asked:
        used_later = shapely.contains_xy(crosswalk_areas(rules)[k].buffer(WALKER_M), x, y).any(axis=0)
        used[:, k] = (used_later & around.present[:, around.obstacle]).any(axis=1)
    return used
