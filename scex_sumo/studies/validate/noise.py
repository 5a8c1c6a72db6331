"""Noise of a recording's boxes, and futures with this noise.

A recorded extremum picks the largest error of the boxes, so futures need the same errors to be compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.converters.cleaning.motion import smooth
from scex_sumo.converters.tracks.rows import TrackRows
from scex_sumo.extrapolation.loop.rollout import Rollout
from scex_sumo.scene import SeedScene, States

SMOOTHED_M = 0.3  # white noise that smoothing takes for granted: a time of 0.8 s
MOVING_MPS = 0.5  # who is slower stands: its box creeps, or is held
REPLAN = 5  # steps
APART_ROWS = 20  # between the beginnings of two pieces of a track
MIN_PIECES, MAX_PIECES = 10, 200


@dataclass(frozen=True, kw_only=True, eq=False)
class BoxNoise:
    """Pieces of the errors of boxes: along their way, m, across it, m, of heading, rad, of speed, m/s.

    Attributes:
        moving: (D, H + 1, 4) of vehicles that move all the time; empty if there are too few.
        standing: (D, H + 1, 4) of vehicles that stand; empty if there are too few.
    """

    moving: FloatArray
    standing: FloatArray


def box_noise(rows: TrackRows, until_s: float, steps: int = 30) -> BoxNoise:
    """Return the errors of the boxes of a recording.

    Args:
        rows: vehicles at 10 Hz.
        until_s: later rows count only if the others give too few pieces.
        steps: of futures; pieces reach as far as their last plan, H steps.
    """
    steps += PLAN_STEPS
    none = np.empty((0, steps + 1, 4))
    if not len(rows):
        return BoxNoise(moving=none, standing=none)
    noise = _errors(rows)
    begin, end = rows.pieces
    starts = [np.arange(b, e - steps + 1, APART_ROWS) for b, e in zip(begin, end, strict=True)]
    first = np.concatenate([np.empty(0, dtype=np.int64), *starts])
    whole = first[:, None] + np.arange(steps + 1)
    moves = np.asarray(rows.speed[whole] > MOVING_MPS)
    early = rows.timestamp_ms[whole[:, -1]] <= 1000 * until_s

    def of(kind: BoolArray) -> FloatArray:
        for usable in (kind & early, kind):
            pieces = whole[usable]
            if len(pieces) >= MIN_PIECES:
                return np.asarray(noise[pieces[:: -(-len(pieces) // MAX_PIECES)]])
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
    """Return futures as a recording would show them: with errors of boxes, their tracks as planned paths.

    Errors start from none at the seed scene. Each vehicle of each future gets a random piece of ``noise``, of
    vehicles that move or stand as it does. Tracks go on along the last plan.
    """
    count, steps, vehicles = driven.states.shape
    piece = np.zeros((count, vehicles, steps + PLAN_STEPS + 1, 4))
    moves = scene.now.speed > MOVING_MPS
    for kind, pieces in ((moves, noise.moving), (~moves, noise.standing)):
        if len(pieces):
            piece[:, kind] = pieces[rng.integers(0, len(pieces), (count, int(kind.sum())))]
    piece -= piece[:, :, :1]
    states, planned = driven.states, driven.replan * (driven.plan_x.shape[1] - 1)
    x, y = (
        np.concatenate([track, plan[:, -1, :, steps - planned :].swapaxes(1, 2)], axis=1)
        for track, plan in ((states.x, driven.plan_x), (states.y, driven.plan_y))
    )
    along, across, turned, faster = piece[:, :, 1 : 1 + x.shape[1]].transpose(3, 0, 2, 1)  # each (C, T', V)
    heading = states.heading[:, np.minimum(np.arange(x.shape[1]), steps - 1)]
    cos, sin = np.cos(heading), np.sin(heading)
    x, y = x + cos * along - sin * across, y + sin * along + cos * across
    shown = np.maximum(states.speed + faster[:, :steps], 0.0)
    seen = States(
        x=x[:, :steps],
        y=y[:, :steps],
        heading=states.heading + turned[:, :steps],
        speed=np.where(states.speed > MOVING_MPS, shown, states.speed),
    )
    return along_tracks(seen, x[:, steps:], y[:, steps:], replan=driven.replan)


def along_tracks(
    states: States, further_x: FloatArray, further_y: FloatArray, *, replan: int = REPLAN
) -> Rollout:
    """Return a rollout with the driven tracks (C, T, V) and their continuation as planned paths."""
    at = np.arange(0, states.shape[1], replan)[:, None] + np.arange(PLAN_STEPS)  # (R, H)
    plan_x, plan_y = (
        np.concatenate(parts, axis=1)[:, at].swapaxes(2, 3)
        for parts in ((states.x, further_x), (states.y, further_y))
    )
    return Rollout(
        futures=np.arange(len(states.x)), states=states, plan_x=plan_x, plan_y=plan_y, replan=replan
    )
