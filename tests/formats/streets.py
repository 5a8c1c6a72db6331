"""Street of lane polylines for the tests of map formats: two lanes eastwards that fork, one westwards.

Lanes 1 (right) and 2 (left) run from x = 0 to 100; 1 goes on as 3 and turns right as 5, 2 goes on as 4.
Lane 6 runs westwards. All are 3.5 m wide.
"""

from __future__ import annotations

from typing import Any

import numpy as np

WIDTH_M = 3.5
SUCCESSORS = {1: [3, 5], 2: [4], 3: [], 4: [], 5: [], 6: []}
PREDECESSORS = {1: [], 2: [], 3: [1], 4: [2], 5: [1], 6: []}
LEFT = {1: 2, 2: 6, 3: 4, 4: 6, 5: None, 6: 2}
RIGHT = {1: None, 2: 1, 3: None, 4: 3, 5: None, 6: None}
INSIDE = {5}


def centre(lane: int, x: float = 0.0, y: float = 0.0) -> np.ndarray[Any, Any]:
    """(P, 2) centreline of a lane, moved by x and y."""
    if lane == 5:
        angle = np.linspace(0.0, np.pi / 2.0, 19)
        line = np.stack([100.0 + 15.0 * np.sin(angle), -15.0 + 15.0 * np.cos(angle)], axis=1)
    else:
        across = {1: 0.0, 2: WIDTH_M, 3: 0.0, 4: WIDTH_M, 6: 2 * WIDTH_M}[lane]
        ends = {1: (0.0, 100.0), 2: (0.0, 100.0), 3: (100.0, 200.0), 4: (100.0, 200.0), 6: (200.0, 0.0)}[lane]
        line = np.stack([np.linspace(*ends, 11), np.full(11, across)], axis=1)
    return np.asarray(line + np.array([x, y]))


def bound(lane: int, side: int, x: float = 0.0, y: float = 0.0) -> np.ndarray[Any, Any]:
    """(P, 2) bound of a lane: side 1 is left, -1 right."""
    line = centre(lane, x, y)
    step = np.gradient(line, axis=0)
    normal = np.stack([-step[:, 1], step[:, 0]], axis=1) / np.hypot(*step.T)[:, None]
    return np.asarray(line + side * WIDTH_M / 2 * normal)


# Name, type, x and y at time 0, speed: two on lane 1, one on lane 2, one parked, one on foot, one outside.
USERS = (
    ("11", "car", 20.0, 0.0, 10.0),
    ("12", "car", 45.0, 0.0, 9.0),
    ("ego", "car", 10.0, WIDTH_M, 11.0),
    ("14", "car", 30.0, -4.5, 0.0),
    ("15", "pedestrian", 70.0, -6.0, 1.0),
    ("16", "car", 40.0, 60.0, 8.0),
)
TIMES = np.arange(0.0, 6.01, 0.1)


def driven(x: float, speed: float) -> np.ndarray[Any, Any]:
    """(T,) x by time."""
    return np.asarray(x + speed * TIMES)
