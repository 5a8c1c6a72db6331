"""What is packed comes out as it went in, in the smallest type, and differences add up."""

from __future__ import annotations

import numpy as np

from scex_sumo.page.packing import UNITS, coded_motion, quantized
from tests.page.packed import decoded_motion


def test_steady_motion_takes_nothing_and_any_motion_comes_back_to_the_unit() -> None:
    units, time_s = np.array(UNITS), 0.1 * np.arange(31)
    heading, speed = 0.3 + 0.2 * time_s, 8.0 + 2.0 * time_s
    x, y = 1000 + 8 * time_s, 500 - 3 * time_s
    turning = np.stack([x + np.cumsum(np.sin(time_s)), y, heading, speed], axis=1)
    steady = np.stack([x, 0 * x, 0 * x, 8 + 0 * x], axis=1)
    poses = np.stack([steady, turning])
    start = quantized(poses[:, 0], units)
    motion = coded_motion(start, poses[:, 1:])
    assert not motion[:, 0].any() and motion[:, 1].any()
    off = np.abs(decoded_motion(start, motion) - poses[:, 1:])
    assert (off <= 0.501 * units).all()
