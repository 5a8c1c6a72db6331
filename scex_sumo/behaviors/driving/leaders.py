"""Leaders: the next vehicle or obstacle along each driver's path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray, least_of
from scex_sumo.behaviors.driving.paths import COARSE, DS_M, SeedPaths
from scex_sumo.behaviors.driving.perception import Everyone, everyone
from scex_sumo.behaviors.driving.projection import refine
from scex_sumo.scene import SceneHistory, Who

LATER_WEIGHT = 0.1  # m² per m along the path; the nearest coarse sample is up to 2 m, 4 m², off
MOST_PAIRS = 60_000  # at a time: bounds the memory, and stays near the processor
CORRIDOR_MARGIN_M = 0.3  # kept on both sides of the own width when judging who is in the way


@dataclass(frozen=True, kw_only=True, eq=False)
class Leaders:
    """The leader of each of n vehicles.

    Attributes:
        gap: (n,) bumper to bumper along the path, m; inf without a leader, may be negative on overlap.
        speed: (n,) the leader's speed component along the path, m/s; 0 without a leader.
        index: (n,) column of the leader: vehicles first, then obstacles; -1 without a leader.
    """

    gap: FloatArray
    speed: FloatArray
    index: IntArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Ahead:
    """All who are in the way of n drivers, k in all; the one with the smallest gap leads.

    Attributes:
        driver: (k,) the driver.
        other: (k,) column of who is in the way: vehicles first, then obstacles.
        gap: (k,) bumper to bumper along the path, m.
        speed: (k,) speed component along the path, m/s.
        cos: (k,) cosine of its heading against the path's.
    """

    driver: IntArray
    other: IntArray
    gap: FloatArray
    speed: FloatArray
    cos: FloatArray

    def leaders(self, n: int) -> Leaders:
        """The nearest one ahead of each of the n drivers."""
        result = Leaders(gap=np.full(n, np.inf), speed=np.zeros(n), index=np.full(n, -1))
        chosen = least_of(self.driver, self.gap, self.other)
        driver = self.driver[chosen]
        result.gap[driver], result.speed[driver] = self.gap[chosen], self.speed[chosen]
        result.index[driver] = self.other[chosen]
        return result


def find_leaders(
    history: SceneHistory,
    who: Who,
    paths: SeedPaths,
    row: IntArray,
    s_centre: FloatArray,
    *,
    clearance: float,
    radius: float,
    obstacle_clearance: float = 1.5,
    aside: FloatArray | None = None,
    margin: float = CORRIDOR_MARGIN_M,
) -> Leaders:
    """The next vehicle or obstacle on or near each driver's path: the nearest that `find_ahead` finds."""
    return find_ahead(
        history,
        who,
        paths,
        row,
        s_centre,
        clearance=clearance,
        radius=radius,
        obstacle_clearance=obstacle_clearance,
        aside=aside,
        margin=margin,
    ).leaders(len(who))


def find_ahead(
    history: SceneHistory,
    who: Who,
    paths: SeedPaths,
    row: IntArray,
    s_centre: FloatArray,
    *,
    clearance: float,
    radius: float,
    obstacle_clearance: float = 1.5,
    aside: FloatArray | None = None,
    margin: float = CORRIDOR_MARGIN_M,
) -> Ahead:
    """Find the vehicles and obstacles on or near each driver's path, ahead of it.

    Another one counts when its centre is within `radius` of the driver's, its centre or any part of it is
    near enough to the path (a vehicle's centre within `clearance`, an obstacle's within
    `obstacle_clearance`, or its body inside the driver's own corridor: own width and `margin` on both sides),
    and

    - its nearest end along the path is ahead of the driver's front bumper; or
    - it is alongside with its centre ahead of the driver's and its body inside the driver's corridor (a
      vehicle beside, in the next lane, is no leader; one that cuts in is); and
    - it does not face the driver (within 60 degrees) outside the corridor: oncoming traffic in its own
      lane, moving or waiting, would stop every driver whose clearance takes in that lane.

    Its extent along the path is that of its rectangle turned by its heading, so that a vehicle standing
    across the path has a rear bumper too.

    Args:
        row: (n,) path of each driver.
        s_centre: (n,) arc length of the driver's centre on its path, m.
        clearance: m from the path to the other vehicle's centre.
        radius: perception radius, m.
        obstacle_clearance: m from the path to an obstacle's centre; pedestrians wait beside the lane.
        aside: (n,) how far beside its path each driver keeps, m, left positive; distances to the path are to
            that line. None is on the path.
        margin: of the driver's own corridor beyond its width, on each side, m.
    """
    others = everyone(history)
    size = max(1, MOST_PAIRS // max(1, others.length.size))
    parts = [
        _ahead_of(
            history,
            others,
            who[k],
            paths,
            row[k],
            s_centre[k],
            np.where(others.obstacle, obstacle_clearance, clearance),
            radius,
            None if aside is None else aside[k],
            margin,
        )
        for k in (slice(i, i + size) for i in range(0, max(1, len(who)), size))
    ]
    for number, part in enumerate(parts):
        part.driver[:] += number * size
    return Ahead(**{name: np.concatenate([vars(part)[name] for part in parts]) for name in vars(parts[0])})


def _ahead_of(
    history: SceneHistory,
    others: Everyone,
    who: Who,
    paths: SeedPaths,
    row: IntArray,
    s_centre: FloatArray,
    clearance: FloatArray,
    radius: float,
    aside: FloatArray | None,
    margin: float,
) -> Ahead:
    """Who is ahead of a part of the drivers; the clearance is that of each of the others, (M,)."""
    own = history.now[who.child, who.vehicle]
    length, width = history.scene.length[who.vehicle], history.scene.width[who.vehicle]
    ox, oy = others.states.x[who.child], others.states.y[who.child]  # (n, M)
    near = (ox - own.x[:, None]) ** 2 + (oy - own.y[:, None]) ** 2 <= radius**2
    near &= others.present[who.child]
    near[np.arange(len(who)), who.vehicle] = False
    guess, distance2 = _first_guess(paths, row, s_centre, ox, oy, radius)
    # Points further from every coarse sample than this can neither be within the clearance nor in the way.
    reach = max(
        float(clearance.max(initial=0.0)),
        float(width.max(initial=0.0)) / 2 + margin + others.longest / 2,
    )
    if aside is not None:
        reach += float(np.abs(aside).max(initial=0.0))
    near &= distance2 <= (reach + COARSE * DS_M) ** 2
    i, j = np.nonzero(near)
    x, y = ox[i, j], oy[i, j]
    s, offset, path_heading = refine(paths, row[i], guess[i, j], x, y, 3)
    if aside is not None:
        offset = offset - aside[i]
    turn = others.states.heading[who.child[i], j] - path_heading
    cos, sin = np.cos(turn), np.sin(turn)
    half_length, half_width = others.length[j] / 2, others.width[j] / 2
    extent = np.abs(cos) * half_length + np.abs(sin) * half_width
    body = np.abs(offset) - np.abs(sin) * half_length - np.abs(cos) * half_width
    speed = others.states.speed[who.child[i], j] * cos
    inside = body <= width[i] / 2 + margin
    ahead = s - s_centre[i]
    gap = ahead - extent - length[i] / 2
    oncoming = cos < -0.5
    counts = np.where(
        (gap > 0) & ~oncoming, (np.abs(offset) <= clearance[j]) | inside, inside & (ahead > 0)
    )  # fmt: skip
    return Ahead(driver=i[counts], other=j[counts], gap=gap[counts], speed=speed[counts], cos=cos[counts])


def _first_guess(
    paths: SeedPaths, row: IntArray, s: FloatArray, x: FloatArray, y: FloatArray, radius: float
) -> tuple[FloatArray, FloatArray]:
    """The nearest of the coarse samples from just behind each driver to the perception radius.

    Returns:
        (n, M) arc length, m, and (n, M) squared distance, m².
    """
    spacing = COARSE * DS_M
    samples = paths.coarse.shape[2]
    span = min(samples, int(radius / spacing) + 4)
    start = np.clip((s / spacing).astype(np.int64) - 2, 0, samples - span)
    window = start[:, None] + np.arange(span)
    coarse = paths.coarse.transpose(0, 2, 1)[row[:, None], window]  # (n, span, 3)
    # On the second lap of a roundabout the same place is as near: the first time counts.
    later = LATER_WEIGHT * spacing * np.arange(span)
    coarse[:, :, 2] += later
    px, py = x - paths.centre[0], y - paths.centre[1]
    points = np.stack([px, py, np.ones_like(px)], axis=-1)  # (n, M, 3)
    cost = points @ coarse.transpose(0, 2, 1)
    best = np.argmin(cost, axis=2)
    smallest = np.take_along_axis(cost, best[:, :, None], axis=2)[:, :, 0]
    return (start[:, None] + best) * spacing, smallest - later[best] + px**2 + py**2
