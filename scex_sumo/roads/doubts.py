"""Doubts about the data of pairs of vehicles in a seed scene, in words.

An encounter of such a pair says more about the recording than about the traffic.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, IntArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.geometry.rectangles import Rectangles, separation
from scex_sumo.roads.matching import off_road
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene

NEAR_M: Final = 0.1
"""Boxes that are closer nearly touch."""
TOWED_S: Final = 0.15
"""Headway at which nobody follows above `TOWED_MPS`: it is a trailer, or a box is too long."""
TOWED_MPS: Final = 3.0
STRIDE_STEPS: Final = 5
CONTRADICTION_M: Final = 0.5
"""Noise of positions over `STRIDE_STEPS`."""


def doubts_of(
    scene: SeedScene,
    first: IntArray,
    second: IntArray,
    *,
    vehicles: int | None = None,
    names: Sequence[str] | None = None,
) -> list[str | None]:
    """Return why the data of pairs of vehicles, (n,) indices, are doubtful; None where they are not.

    ``vehicles``: how many of the scene's are some; the rest are people, beside the lanes; None: all;
    ``names``: (V,) in words; None: track ids.
    """
    off, short, leaves, contradicts = _off_lanes(scene), _short(scene), _leaves(scene), _contradicts(scene)
    near, overlap = _near(scene, first, second)
    ids, doubts = scene.track_ids, []
    names = [str(track) for track in ids] if names is None else names
    for k, (a, b) in enumerate(zip(first.tolist(), second.tolist(), strict=True)):
        both = " and ".join(names[v] for v in sorted((a, b), key=lambda v: ids[v]))
        reasons = [
            (overlap[k], f"{both} overlap at the seed moment"),
            (near[k], f"{both} nearly touch at the seed moment"),
        ]
        for v in (a, b):
            reasons += [
                (off[v] and (vehicles is None or v < vehicles), f"{names[v]} is off the mapped lanes"),
                (short[v], f"{names[v]} is recorded for less than a second"),
                (leaves[v], f"{names[v]} leaves the recording within a second"),
                (contradicts[v], f"positions and speeds of {names[v]} contradict each other"),
            ]
        doubts.append(next((words for is_so, words in reasons if is_so), None))
    return doubts


@owner_cache
def _off_lanes(scene: SeedScene) -> BoolArray:
    off = np.zeros(scene.vehicles, dtype=np.bool_)
    off[[] if scene.road is None else off_road(scene.road, scene, any_direction=True)] = True
    return off if scene.people is None else off & ~scene.people


def _exact(scene: SeedScene) -> bool:
    """Whether the scene is simulated: vehicles are inserted, arrive, and change lanes in one step."""
    return scene.source.get("kind") in ("simulation", "scenario")


def _short(scene: SeedScene) -> BoolArray:
    return np.asarray((scene.recorded_steps < HISTORY_STEPS) & (not _exact(scene)))


def _leaves(scene: SeedScene) -> BoolArray:
    """Return (V,) whether vehicles leave within a second, and others do not: at the edge of what is seen."""
    if _exact(scene) or scene.future_valid is None or not scene.future_valid.size:
        return np.zeros(scene.vehicles, dtype=np.bool_)
    steps = scene.future_valid.sum(axis=1)
    return np.asarray(steps < min(HISTORY_STEPS, steps.max()))


def _contradicts(scene: SeedScene) -> BoolArray:
    """Return (V,) whether vehicles moved half as far as their speeds say, or twice, within `STRIDE_STEPS`."""
    x, y, speed = scene.history.x, scene.history.y, np.abs(scene.history.speed)
    moved = np.hypot(x[:, STRIDE_STEPS:] - x[:, :-STRIDE_STEPS], y[:, STRIDE_STEPS:] - y[:, :-STRIDE_STEPS])
    steps = np.lib.stride_tricks.sliding_window_view((speed[:, 1:] + speed[:, :-1]) / 2, STRIDE_STEPS, axis=1)
    said = STEP_S * steps.sum(axis=2)
    off = np.abs(moved - said) > np.maximum(np.maximum(moved, said) / 2, CONTRADICTION_M)
    return np.asarray(off.any(axis=1) & (not _exact(scene)))


def _near(scene: SeedScene, first: IntArray, second: IntArray) -> tuple[BoolArray, BoolArray]:
    """Return (n,) whether boxes nearly touch at the seed moment, and whether they overlap.

    A moving vehicle nearly touches what it reaches within `TOWED_S`.
    """
    boxes = Rectangles.of(scene.now, scene.length, scene.width)
    speed = scene.now.speed
    ahead = np.maximum(NEAR_M, np.where(speed > TOWED_MPS, TOWED_S * speed, 0.0)) / 2
    longer = dataclasses.replace(
        boxes,
        x=boxes.x + ahead * np.cos(boxes.heading),
        y=boxes.y + ahead * np.sin(boxes.heading),
        half_length=boxes.half_length + ahead,
        half_width=boxes.half_width + NEAR_M / 2,
    )
    near = [
        separation(reach.take(a), own.take(b)) < 0
        for reach, own, a, b in ((longer, boxes, first, second), (boxes, longer, first, second))
    ]
    return near[0] | near[1], np.asarray(separation(boxes.take(first), boxes.take(second)) < 0)
