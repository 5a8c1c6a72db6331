"""Perturbed copies of a scene: vehicles moved sideways and turned, and tracked with noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.geometry.polylines import wrap
from scex_sumo.scene import STEP_S, States

# Errors of NGSIM's tracks against a smooth motion: speeds of one track have similar errors for so long.
ALIKE_S = 0.15
CALM_MPS = 3.0  # below, errors shrink with the speed


@dataclass(frozen=True, kw_only=True)
class Perturbation:
    """Size of the perturbations, uniform up to both sides."""

    lateral_m: float = 0.7
    heading_rad: float = float(np.deg2rad(5.0))
    share: float = 1.0  # of the vehicles of a copy that are moved
    speed_mps: float = 0.0  # standard deviation of the errors of `measured`, for half of the vehicles


def perturbed(history: States, perturbation: Perturbation, rng: np.random.Generator) -> States:
    """Move vehicles (V, T) sideways and turn them, with their past; speeds stay."""
    count = history.shape[0]
    off = rng.random(count) < perturbation.share
    lateral = off * rng.uniform(-perturbation.lateral_m, perturbation.lateral_m, count)
    turn = off * rng.uniform(-perturbation.heading_rad, perturbation.heading_rad, count)
    return moved(history, lateral, turn)


def measured(history: States, perturbation: Perturbation, rng: np.random.Generator) -> States:
    """Return states (V, T) of a worse tracker: half of the vehicles have a smooth error along their way."""
    count, steps = history.shape
    reach = 4  # steps, almost three times `ALIKE_S`
    t = STEP_S * np.arange(-reach, reach + 1)
    kernel = np.exp(-0.5 * (t / ALIKE_S) ** 2)
    kernel /= np.sqrt((kernel**2).sum())
    white = rng.standard_normal((count, steps + 2 * reach + 1))
    smooth = np.lib.stride_tricks.sliding_window_view(white, 2 * reach + 1, axis=1) @ kernel
    # The error of the speed is the slope of the place's.
    slope = np.diff(smooth, axis=1) / STEP_S
    size = np.where(rng.random(count) < 0.5, 0.0, perturbation.speed_mps * np.abs(rng.standard_normal(count)))
    calm = np.minimum(history.speed.mean(axis=1) / CALM_MPS, 1.0)
    unit = (size * calm * np.sqrt(2) * ALIKE_S)[:, None]
    travelled_m = unit * smooth[:, 1:]
    return States(
        x=history.x + travelled_m * np.cos(history.heading),
        y=history.y + travelled_m * np.sin(history.heading),
        heading=history.heading,
        speed=np.maximum(history.speed + unit * slope, 0.0),
    )


def moved(history: States, lateral: FloatArray, turn: FloatArray) -> States:
    """Shift tracks (V, T) to the left by (V,) m and turn them by (V,) rad, from their present pose."""
    now = history[:, -1]
    x = now.x - lateral * np.sin(now.heading)
    y = now.y + lateral * np.cos(now.heading)
    dx, dy = history.x - now.x[:, None], history.y - now.y[:, None]
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    return States(
        x=x[:, None] + cos * dx - sin * dy,
        y=y[:, None] + sin * dx + cos * dy,
        heading=wrap(history.heading + turn[:, None]),
        speed=history.speed.copy(),
    )
