"""Critical response in the closed loop: scripted drivers collide if and only if the response is later."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scex_sumo as scex
from scex_sumo.certainty.response.critical import DECELERATIONS, JERK_MPS3, critical_response
from scex_sumo.certainty.response.motion.actions import BRAKES, cases_of, pairs_of
from scex_sumo.certainty.response.motion.expected import Expected, expected_motion
from tests.queues import queues

STEPS, LEVEL, COLUMN = 60, 5, 1
STRENGTH, DECELERATION = 5.0, DECELERATIONS[COLUMN]


class Scripted:
    """The leader brakes with 5 m/s² from the start; the follower drives as expected, then responds."""

    def __init__(self, expected: Expected, response_s: float) -> None:
        speed = expected.scene.now.speed
        times = 0.1 * np.arange(STEPS + 31)
        braking = np.minimum(times, speed[0] / STRENGTH)
        way = [
            speed[0] * braking - STRENGTH * braking**2 / 2,
            self._follower(expected, response_s, len(times)),
        ]
        self.way = np.stack(way)

    @staticmethod
    def _follower(expected: Expected, response_s: float, steps: int) -> Any:
        """Integrate in steps of 1 ms from the motion at the response on."""
        times = 1e-3 * np.arange(100 * steps)
        usual = expected.at(np.array([1]), np.minimum(times, 8.0)[None])
        begin = round(response_s * 1000)
        s, v, a = usual["s"][0].copy(), usual["speed"][0][begin], usual["acceleration"][0][begin]
        for k in range(begin + 1, len(times)):
            a = max(a - JERK_MPS3 * 1e-3, -DECELERATION)
            v = max(v + a * 1e-3, 0.0)
            s[k] = s[k - 1] + v * 1e-3
        return s[::100]

    def plan(self, history: Any, road: Any, who: Any, rng: Any) -> Any:
        steps = slice(history.step + 1, history.step + 31)
        s, before = self.way[who.vehicle, steps], self.way[who.vehicle, history.step : history.step + 30]
        start = history.scene.now.x[who.vehicle][:, None]
        flat = np.zeros_like(s)
        y = flat + history.scene.now.y[who.vehicle][:, None]
        return scex.Plan(x=start + s, y=y, heading=flat, speed=(s - before) / 0.1)


@pytest.mark.parametrize("gap_m", [9.0, 14.0])
def test_vehicles_touch_if_and_only_if_the_response_is_later(gap_m: float, tmp_path: Path) -> None:
    scene = queues(2, gap_m=gap_m, speed=12.0)
    expected = expected_motion(scene)
    cases = cases_of(pairs_of(expected))
    found = critical_response(cases)[(cases.action == BRAKES) & (cases.value == STRENGTH)][0, COLUMN]
    assert 0.3 < found < 3.0
    for response_s, touches in ((found - 0.1, False), (found + 0.1, True)):
        driver = Scripted(expected, response_s)
        run = scex.extrapolate(
            scene,
            models=[driver],
            futures=1,
            steps=STEPS,
            world="plain",
            reference="none",
            out=tmp_path / f"{response_s}",
            response="none",
            report=False,
        )
        assert bool(run.collisions.num_rows) is touches
