"""Errors of a recording's boxes: found in its tracks, put onto futures."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.converters.tracks.rows import TrackRows
from scex_sumo.extrapolation.loop.rollout import Rollout
from scex_sumo.scene import States
from scex_sumo.studies.validate.noise import as_recorded, box_noise
from tests.behaviors import roads

SIGMA = (0.2, 0.1)  # m, along and across
STEPS = 60  # 3 s, and a plan of 3 s


def tracks(count: int, rows: int, noise: float = 1.0, speed: float = 10.0) -> TrackRows:
    """Vehicles on straight ways, with white noise on their places."""
    rng, total = np.random.default_rng(0), count * rows
    track, step = np.repeat(np.arange(count), rows), np.tile(np.arange(rows), count)
    along, across = noise * rng.standard_normal((2, total)) * np.array(SIGMA)[:, None]
    zero, whole = np.zeros(total), np.zeros(total, dtype=np.int64)
    return TrackRows(
        case=whole,
        track=track,
        segment=track,
        labels=tuple(str(k) for k in range(count)),
        types=("car",) * count,
        frame_id=step + 1,
        timestamp_ms=100.0 * step,
        x=speed * 0.1 * step + along,
        y=100.0 * track + across,
        vx=zero + speed,
        vy=zero,
        psi_rad=zero,
        length=zero + 4.5,
        width=zero + 1.8,
    )


def test_the_errors_of_boxes_are_what_a_track_differs_by_from_its_smooth_course() -> None:
    noise = box_noise(tracks(12, 100), np.inf).moving
    assert noise.shape[1:] == (STEPS + 1, 4)
    assert box_noise(tracks(12, 100), np.inf, 50).moving.shape[1:] == (STEPS + 21, 4)
    # Smoothing over 0.8 s leaves the most of it.
    assert noise[:, 10:50, :2].std(axis=(0, 1)) == pytest.approx(SIGMA, rel=0.15)
    assert np.abs(noise[:, :, 2:]).max() < 1e-6


def futures(speeds: tuple[float, ...], count: int = 400) -> Rollout:
    """Vehicles that go on as they do; a plan of each second step, of where they will be."""
    x = np.cumsum(np.full((count, 30, len(speeds)), 0.1) * speeds, axis=1)
    zero = np.zeros_like(x)
    ahead = 0.1 * np.array(speeds)[:, None] * (np.arange(30) + 1)
    plan = np.stack([ahead + 0.1 * np.array(speeds)[:, None] * start for start in range(0, 30, 5)])
    return Rollout(
        futures=np.arange(count),
        states=States(x=x, y=zero, heading=zero, speed=zero + speeds),
        plan_x=np.repeat(plan[None], count, axis=0),
        plan_y=np.zeros((count, *plan.shape)),
        replan=5,
    )


def test_futures_get_the_errors_of_the_boxes_from_none_at_the_seed_scene_on() -> None:
    scene = roads.scene_of((0.0, 0.0, 0.0, 10.0), (0.0, 50.0, 0.0, 0.0))
    found = box_noise(tracks(12, 400), np.inf)
    noise = found.moving - found.moving[:, :1]
    driven = futures((10.0, 0.0))
    seen = as_recorded(scene, driven, found, np.random.default_rng(1))
    off = seen.states.x - driven.states.x, seen.states.y - driven.states.y
    assert np.sqrt((noise[:, 30, :2] ** 2).mean(axis=0)) == pytest.approx(
        [np.sqrt((d[:, 29, 0] ** 2).mean()) for d in off], rel=0.15
    )
    assert np.abs([d[:, :, 1] for d in off]).max() == 0.0  # who stands: nobody stood in that recording
    assert (seen.states.speed[:, :, 1] == 0.0).all()
