"""Noise of a recording's boxes, and children with this noise.

A recorded extremum picks the largest error of the boxes, so children need the same errors to be compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.converters.cleaning.smooth import smooth
from scex_sumo.converters.tracks.rows import TrackRows
from scex_sumo.extrapolation.rollout import Rollout
from scex_sumo.scene import SeedScene, States

STEPS = 30 + PLAN_STEPS  # after the seed scene: as far as a plan of the last second reaches
SMOOTHED_M = 0.3  # white noise that smoothing takes for granted: a time of 0.8 s
MOVING_MPS = 0.5  # who is slower stands: its box creeps, or is held
APART_ROWS = 20  # between the beginnings of two pieces of a track
MIN_PIECES, MAX_PIECES = 10, 200


@dataclass(frozen=True, kw_only=True, eq=False)
class BoxNoise:
    """Pieces of the errors of boxes: along their way, m, across it, m, of heading, rad, of speed, m/s.

    Attributes:
        moving: (D, 61, 4) of vehicles that move all the time; empty if there are too few.
        standing: (D, 61, 4) of vehicles that stand; empty if there are too few.
    """

    moving: FloatArray
    standing: FloatArray


def box_noise(rows: TrackRows, until_s: float) -> BoxNoise:
    """Return the errors of the boxes of a recording.

    Args:
        rows: vehicles at 10 Hz.
        until_s: later rows count only if the others give too few pieces.
    """
    none = np.empty((0, STEPS + 1, 4))
    if not len(rows):
        return BoxNoise(moving=none, standing=none)
    noise = _errors(rows)
    begin, end = rows.pieces
    starts = [np.arange(b, e - STEPS + 1, APART_ROWS) for b, e in zip(begin, end, strict=True)]
    first = np.concatenate([np.empty(0, dtype=np.int64), *starts])
    whole = first[:, None] + np.arange(STEPS + 1)
    moves = np.asarray(rows.speed[whole] > MOVING_MPS)
    early = rows.timestamp_ms[whole[:, -1]] <= 1000 * until_s

    def of(kind: BoolArray) -> FloatArray:
        for usable in (kind & early, kind):
            found = whole[usable]
            if len(found) >= MIN_PIECES:
                return np.asarray(noise[found[:: -(-len(found) // MAX_PIECES)]])
        return none

    return BoxNoise(moving=of(np.all(moves, axis=1)), standing=of(~np.any(moves, axis=1)))


def _errors(rows: TrackRows) -> FloatArray:
    time_s, heading = rows.timestamp_ms / 1000.0, rows.psi_rad.copy()
    for b, e in zip(*rows.pieces, strict=True):
        heading[b : e + 1] = np.unwrap(heading[b : e + 1])
    places, manner = np.column_stack([rows.x, rows.y]), np.column_stack([heading, rows.speed])
    dx, dy = (places - smooth(places, time_s, rows.segment, SMOOTHED_M)).T
    turned, faster = (manner - smooth(manner, time_s, rows.segment, SMOOTHED_M)).T
    cos, sin = np.cos(heading), np.sin(heading)
    return np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx, turned, faster])


def as_recorded(scene: SeedScene, driven: Rollout, noise: BoxNoise, rng: np.random.Generator) -> Rollout:
    """Add errors of boxes to the states and plans of children, starting from none at the seed scene.

    Each vehicle of each child gets a random piece of ``noise``, of vehicles that move or stand as it does.
    """
    count, steps, vehicles = driven.states.shape
    piece = np.zeros((count, vehicles, STEPS + 1, 4))
    moves = scene.now.speed > MOVING_MPS
    for kind, pieces in ((moves, noise.moving), (~moves, noise.standing)):
        if len(pieces):
            piece[:, kind] = pieces[rng.integers(0, len(pieces), (count, int(kind.sum())))]
    piece -= piece[:, :, :1]
    along, across, turned, faster = piece[:, :, 1:].transpose(3, 0, 2, 1)  # each (C, T, V)
    states, soon = driven.states, slice(0, steps)
    dx, dy = _turned(states.heading, along[:, soon], across[:, soon])
    shown = np.maximum(states.speed + faster[:, soon], 0.0)
    seen = States(
        x=states.x + dx,
        y=states.y + dy,
        heading=states.heading + turned[:, soon],
        speed=np.where(states.speed > MOVING_MPS, shown, states.speed),
    )
    _, rounds, _, reach = driven.plan_x.shape
    at = np.arange(rounds)[:, None] * driven.replan + np.arange(reach)  # (R, H)
    heading = states.heading[:, np.minimum(at, steps - 1)]
    offset = (np.moveaxis(d, 3, 2) for d in _turned(heading, along[:, at], across[:, at]))
    plan_x, plan_y = (plan + d for plan, d in zip((driven.plan_x, driven.plan_y), offset, strict=True))
    return Rollout(children=driven.children, states=seen, plan_x=plan_x, plan_y=plan_y, replan=driven.replan)


def _turned(heading: FloatArray, along: FloatArray, across: FloatArray) -> tuple[FloatArray, FloatArray]:
    cos, sin = np.cos(heading), np.sin(heading)
    return cos * along - sin * across, sin * along + cos * across
