"""Room beside others: how far to either side a driver may go with others alongside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.behaviors.driving.paths import SeedPaths
from scex_sumo.behaviors.driving.perception import everyone
from scex_sumo.behaviors.driving.projection import foot_points
from scex_sumo.geometry.polylines import wrap
from scex_sumo.scene import STEP_S, SceneHistory, States, Who

NEAR_M = 25.0  # centres of those who come to be beside each other within a plan
MARGIN_M = 0.4  # between two boxes
AHEAD_M = 1.0  # who is so far ahead or behind counts as beside
ALONG = 0.5  # sine of the angle to the path; who turns further crosses it
STRAIGHTENS_S, STRAIGHTENS_M = 1.0, 6.0  # after this time, at least this way, a third is left of an angle
OWN_DRIFT_S = 0.3  # the driver stops its own drift sooner
ASIDE_SPEED = 0.8  # m/s; so fast a driver moves aside for a narrower place ahead
ASIDE_M, ASIDE_S = 0.5, 1.0  # at most, and how fast, to make room for one who is too near


@dataclass(frozen=True, kw_only=True, eq=False)
class _Boxes:
    """Boxes against paths, (p,) each.

    Attributes:
        s: arc length of the centre, m.
        offset: of the centre from the path, m, left positive.
        sine: of the angle to the path.
        ahead: speed along the path, m/s, at least 0.
        along: how far the box reaches along the path from its centre, m.
        across: likewise across it, m.
    """

    s: FloatArray
    offset: FloatArray
    sine: FloatArray
    ahead: FloatArray
    along: FloatArray
    across: FloatArray

    @classmethod
    def of(
        cls,
        paths: SeedPaths,
        row: IntArray,
        near: FloatArray,
        states: States,
        length: FloatArray,
        width: FloatArray,
    ) -> _Boxes:
        """Project boxes onto paths, near arc lengths."""
        s, offset, direction = foot_points(paths, row, states.x, states.y, near)
        turned = wrap(states.heading - direction)
        cos, sin = np.abs(np.cos(turned)), np.abs(np.sin(turned))
        return cls(
            s=s,
            offset=offset,
            sine=np.sin(turned),
            ahead=np.maximum(states.speed, 0.0) * np.cos(turned),
            along=(cos * length + sin * width) / 2,
            across=(cos * width + sin * length) / 2,
        )


def offsets_beside(
    history: SceneHistory, who: Who, paths: SeedPaths, row: IntArray, s: FloatArray, way: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(n, H + 1) least and most offset from the path, m; infinite where nobody is beside the vehicle.

    Of what is free between two boxes each takes half, for each thinks the same of the other. Others keep
    their speed and straighten up. Who is ahead in the vehicle's own way, or crosses it, is no matter of
    steering.

    Args:
        row: (n,) path of each vehicle.
        s: (n,) arc length of its centre now, m.
        way: (n, H + 1) further way now and after each step, m.
    """
    (i, j), everybody = _near(history, who), everyone(history)
    own, other = (
        _Boxes.of(
            paths, row[i], s[i], everybody.states[who.child[i], k], everybody.length[k], everybody.width[k]
        )
        for k in (who.vehicle[i], j)
    )
    side = np.where(other.offset > own.offset, 1.0, -1.0)
    t: FloatArray = STEP_S * np.arange(way.shape[1], dtype=np.float64)
    ahead = (other.s - own.s)[:, None] + other.ahead[:, None] * t - way[i]
    along, apart = own.along + other.along, np.abs(other.offset - own.offset)
    beside = (np.abs(ahead[:, 0]) < along) | (apart > own.across + other.across)
    beside &= np.abs(other.sine) < ALONG
    counts = beside[:, None] & (np.abs(ahead) < along[:, None] + AHEAD_M)
    free = apart[:, None] - _taken(own, other, side, everybody.width[j], t) - MARGIN_M
    room = reached(np.where(counts, np.maximum(free / 2, -ASIDE_M), np.inf))
    room *= np.where(room < 0, 1 - np.exp(-t / ASIDE_S), 1.0)
    least, most = np.full(way.shape, -np.inf), np.full(way.shape, np.inf)
    left, right = side > 0, side < 0
    np.minimum.at(most, i[left], own.offset[left, None] + room[left])
    np.maximum.at(least, i[right], own.offset[right, None] - room[right])
    return least, most


def _near(history: SceneHistory, who: Who) -> tuple[IntArray, IntArray]:
    """(p,) which of the vehicles, and (p,) the column of one who is near it."""
    everybody = everyone(history)
    own, theirs = history.now[who.child, who.vehicle], everybody.states[who.child]
    near = np.hypot(theirs.x - own.x[:, None], theirs.y - own.y[:, None]) < NEAR_M
    near &= everybody.present[who.child]
    near[np.arange(len(who)), who.vehicle] = False
    i, j = np.nonzero(near)
    return i, j


def _taken(own: _Boxes, other: _Boxes, side: FloatArray, width: FloatArray, t: FloatArray) -> FloatArray:
    """(p, H + 1) what boxes take of the distance between their centres across the path at times t, m.

    Args:
        side: (p,) 1 where the other one is on the left, else -1.
        width: (p,) of the other one, m.
    """
    ahead = np.abs(other.ahead)
    straightens = np.maximum(STRAIGHTENS_S * ahead, STRAIGHTENS_M)
    left = np.exp(-ahead[:, None] * t / straightens[:, None])
    drift = np.maximum(-side * other.sine, 0.0) * straightens
    own_drift = np.maximum(side * own.ahead * own.sine, 0.0) * OWN_DRIFT_S
    turned, straight = other.across[:, None], (width / 2 + drift)[:, None]
    taken: FloatArray = (own.across + own_drift)[:, None] + straight + (turned - straight) * left
    return taken


def reached(room: FloatArray) -> FloatArray:
    """(n, H + 1) room from which what is left later can be reached at `ASIDE_SPEED`."""
    reach = ASIDE_SPEED * STEP_S * np.arange(room.shape[1])
    reachable: FloatArray = np.minimum.accumulate((room + reach)[:, ::-1], axis=1)[:, ::-1] - reach
    return reachable
