"""Inverse universal traffic quality (TQ): deviation of a scene from smooth flow, weighted by closeness."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.metrics.formulas.distance import least_gap
from scex_sumo.metrics.pairs.near import surroundings
from scex_sumo.metrics.pairs.scenes import Samples, Scenes

DISTANCE_SCALE_M = 5.0
MIN_MEAN_SPEED = 1e-5
WINDOW_S = 2.0
REFERENCE_ACCELERATION = 1.5
REFERENCE_SPEED = 13.89


def _variation(speed: FloatArray, member: BoolArray) -> FloatArray:
    count = member.sum(axis=0)
    mean = np.where(member, speed, 0.0).sum(axis=0) / np.maximum(count, 1)
    # Deviations from the mean, so that equal speeds give exactly 0.
    deviation = np.where(member, speed - mean, 0.0)
    variance = (deviation * deviation).sum(axis=0) / np.maximum(count, 1)
    flows = mean >= MIN_MEAN_SPEED
    variation: FloatArray = np.divide(np.sqrt(variance), mean, out=np.zeros_like(mean), where=flows)
    return variation


def _individual(scenes: Scenes) -> FloatArray:
    tracks = scenes.tracks
    present = np.ones(tracks.states.shape, dtype=bool) if tracks.present is None else tracks.present
    samples = round(WINDOW_S / tracks.step_s) + 1
    sums = []
    for array in (scenes.all_acceleration, tracks.states.speed, None):
        total = np.zeros((present.shape[0], present.shape[1] + 1, present.shape[2]))
        np.cumsum(present if array is None else np.where(present, array, 0.0), axis=1, out=total[:, 1:])
        last = np.arange(tracks.first + 1, present.shape[1] + 1)
        sums.append(total[:, last] - total[:, np.maximum(last - samples, 0)])
    acceleration, speed, count = sums
    count = np.maximum(count, 1)
    load = 0.5 * (np.abs(acceleration) / count / REFERENCE_ACCELERATION + speed / count / REFERENCE_SPEED)
    return np.ascontiguousarray(load.transpose(2, 0, 1))


def tq(scenes: Scenes) -> Samples:
    """Compute the TQ of all vehicles; undefined in scenes of fewer than two vehicles.

    Source: Schütt et al. 2023, Zipfl et al. 2022.
    """
    present, speed, vehicles = scenes.present, scenes.speed, scenes.vehicles
    macro = _variation(speed, present)
    count = present.sum(axis=0)
    radius = surroundings(speed, scenes.length)
    near = scenes if scenes.near is None else scenes.near.scenes
    first, second = near.pairs
    apart = np.where(near.both_present, near.distance, np.inf)
    micro, nano = np.zeros_like(speed), np.zeros_like(speed)
    for vehicle in range(vehicles):
        after, before = np.flatnonzero(first == vehicle), np.flatnonzero(second == vehicle)
        others = np.concatenate([first[before], second[after]])  # ascending: sums keep their order
        close = apart[np.concatenate([before, after])] <= radius[vehicle]
        micro[vehicle] = close.sum(axis=0) / np.maximum(count, 1)
        nano[vehicle] = _variation(speed[others], close)
    gaps = least_gap(scenes)
    nearest = np.where(gaps.defined, gaps.value, np.inf).min(axis=0, initial=np.inf)
    closeness = np.exp(-nearest / DISTANCE_SCALE_M)
    value = closeness * np.sqrt(macro**2 + micro**2 + nano**2 + _individual(scenes) ** 2)
    return Samples(value=value, defined=present & (count >= 2), row=np.arange(vehicles), other=None)
