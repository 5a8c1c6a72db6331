"""Lane changes of `LikelyDriver` that begin later than in the first three seconds.

The wish comes after an exponential time. The driver changes once the lane beside it is free, and gives up a
change that has hardly begun if the lane is free no more. The place across the path shows how far a change is.
"""

from __future__ import annotations

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray, IntArray, uniforms
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.driving.motion import rear_axle
from scex_sumo.behaviors.driving.paths import DS_M, SeedPaths
from scex_sumo.behaviors.driving.projection import refine
from scex_sumo.geometry.polylines import samples
from scex_sumo.humans.lines.lanes import occupied_sides
from scex_sumo.humans.observed.observations import View
from scex_sumo.humans.parameters import HumanParameters
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S

WISHES = 60_000  # salt of draws
EVERY_M = 5.0  # along a path, between places of `lanes_along`
BEGUN = 0.08  # share of the time of a change that has passed when it is first planned
DECIDED = 0.3  # share of the way after which nobody gives a change up
PROGRESS = np.linspace(0.0, 1.0, 101)


def eased(u: FloatArray) -> FloatArray:
    """Return the shares (...) of the way after shares of the time of a motion with the least jerk."""
    return np.asarray(u**3 * (10 - 15 * u + 6 * u**2))


def later_changes(view: View, road: Road, offsets: FloatArray, draw: FloatArray) -> FloatArray:
    """Return (n, T) wanted offsets with the lane changes that begin after `lateral_s`, m.

    Args:
        offsets: (n, T) without them, now and after each step.
        draw: (n,) in [0, 1), one per driver.
    """
    history, human, who = view.history, view.human, view.who
    beside, last = lanes_along(road, view.paths, human)
    wish_s = human.lateral_s - np.log(uniforms(draw, 2, WISHES)) / human.later_rate
    wish_s[np.isnan(last[view.row, :, _places(last, view.s)])] = np.inf
    side, wishes = wish_s.argmin(axis=1), wish_s.min(axis=1) <= history.step * STEP_S + 1e-9
    wishes &= (np.abs(offsets[:, -1]) < human.max_offset_m) & view.paths.on_road[who.vehicle]
    index = np.flatnonzero(wishes)
    if not len(index):
        return offsets
    who, row, s, side = who[index], view.row[index], view.s[index], side[index]
    now = history.now[who.future, who.vehicle]
    here, there = (_places(last, ahead) for ahead in (s, s + now.speed * human.later_s / 2))
    way = last[row, side, here]
    known = ~np.isnan(beside[row, side, here]) & ~np.isnan(beside[row, side, there])
    _, offset, _ = refine(view.paths, row, s, *rear_axle(now, history.scene.length[who.vehicle]), 4)
    sign = np.where(side == 0, 1.0, -1.0)
    done = np.clip(sign * (offset - offsets[index, 0]) / way, 0.0, 1.0)
    occupied = occupied_sides(
        history.scene, who.vehicle, history.now[who.future], human, human.occupied_headway_s
    )
    free = known & ~occupied[np.arange(len(index)), side] & (now.speed > human.change_speed_mps)
    goes = (done > DECIDED) | free
    u = np.maximum(np.interp(done, eased(PROGRESS), PROGRESS), BEGUN)[:, None]
    u = np.minimum(u + np.arange(offsets.shape[1]) * STEP_S / human.later_s, 1.0)
    changed = offsets.copy()
    changed[index] += np.where(goes[:, None], (sign * way)[:, None] * eased(u), 0.0)
    return changed


@owner_cache
def lanes_along(road: Road, paths: SeedPaths, human: HumanParameters) -> tuple[FloatArray, FloatArray]:
    """Return (P, 2, M) distances from places on paths to lanes for a change to the left, and to the right, m.

    NaN without such a lane; in the second array the last one before counts there.
    """
    points = paths.table.reshape(len(paths.lanes), paths.samples, -1)[:, :, :2]
    count = int(paths.samples * DS_M / EVERY_M) + 1
    result, (nearest, farthest) = np.full((len(points), 2, count), np.nan), human.lane_beside_m
    for row, lanes in enumerate(paths.lanes):
        line = shapely.LineString(points[row, ::4])
        for side, name in ((0, "left"), (1, "right")):
            beside = {getattr(road.lanes[k], name) for k in lanes if k in road.lanes} & {*road.lanes}
            if not beside:
                continue
            middle = [samples(road.lanes[k].centreline, EVERY_M / 2)[1] for k in sorted(beside)]
            centres = shapely.points(np.concatenate(middle))
            at, apart = shapely.line_locate_point(line, centres), shapely.distance(line, centres)
            good = (apart > nearest) & (apart < farthest) & (at > 0) & (at < line.length)
            bins = (at[good] / EVERY_M).astype(np.int64)
            number = np.bincount(bins, minlength=count)
            total = np.bincount(bins, weights=apart[good], minlength=count)
            result[row, side, number > 0] = total[number > 0] / number[number > 0]
    known = np.maximum.accumulate(np.where(np.isnan(result), 0, np.arange(count)), axis=2)
    return result, np.take_along_axis(result, known, axis=2)


def _places(table: FloatArray, s: FloatArray) -> IntArray:
    """Return (n,) the places in the last axis of a table at arc lengths, m."""
    return np.clip(s / EVERY_M, 0, table.shape[-1] - 1).astype(np.int64)
