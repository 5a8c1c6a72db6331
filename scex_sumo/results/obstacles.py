"""Obstacles that become vehicles of a scene, and vehicles that become obstacles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.tracks.road_users import OBSTACLE_SIZES, person_kind, road_user
from scex_sumo.intention import Walk
from scex_sumo.scene import HISTORY_STEPS, REPLAYED, STEP_S, Obstacles, SeedScene, States

MAX_SIZE_M: Final = 4.0
REPLAYED_STEPS: Final = 50
"""Steps of replayed vehicles whose future is not recorded."""


def taking_part(scene: SeedScene, people: Obstacles) -> tuple[SeedScene, str]:
    """Return the scene with people as its last vehicles, and the names of those of unusable size."""
    past = people.states.speed[:, : HISTORY_STEPS + 1]
    kinds = tuple(road_user(person_kind(kind, v)) for kind, v in zip(people.types, past, strict=True))
    length, width, wrong = _sizes(people, kinds)
    known = people.present[:, :HISTORY_STEPS]
    taking = joined(
        scene,
        people,
        track_ids=_numbers(people.ids, scene.track_ids),
        types=kinds,
        sizes=(length, width),
        recorded_steps=np.cumprod(known[:, ::-1], axis=1).sum(axis=1, dtype=np.int64),
    )
    return replace(taking, people=np.arange(taking.vehicles) >= scene.vehicles), wrong


def joined(
    scene: SeedScene,
    people: Obstacles,
    *,
    track_ids: IntArray,
    types: Sequence[str],
    sizes: tuple[FloatArray, FloatArray],
    recorded_steps: IntArray,
) -> SeedScene:
    """Return the scene with obstacles (P,) as its last vehicles, too; sizes are length and width, m."""
    future, valid = _futures(people, 0 if scene.future is None else scene.future.shape[1])
    history, source = people.states[:, : HISTORY_STEPS + 1], scene.source
    if "vehicles" in source:  # SUMO's names
        names = dict(zip(map(str, track_ids.tolist()), people.ids, strict=True))
        source = {**source, "vehicles": {**source["vehicles"], **names}}
    return replace(
        scene,
        source=source,
        track_ids=np.concatenate([scene.track_ids, track_ids]),
        types=(*scene.types, *types),
        length=np.concatenate([scene.length, sizes[0]]),
        width=np.concatenate([scene.width, sizes[1]]),
        history=States.concatenate([scene.history, history], axis=0),
        recorded_steps=np.concatenate([scene.recorded_steps, recorded_steps]),
        future=None if scene.future is None else States.concatenate([scene.future, future], axis=0),
        future_valid=None if scene.future_valid is None else np.concatenate([scene.future_valid, valid]),
        intentions=scene.intentions and (*scene.intentions, *(None,) * len(track_ids)),
    )


def _sizes(people: Obstacles, kinds: tuple[str, ...]) -> tuple[FloatArray, FloatArray, str]:
    """Return (P,) lengths and widths, and the names of those whose size is no person's."""
    usual = np.array([OBSTACLE_SIZES[kind] for kind in kinds])
    sizes = np.column_stack([people.length, people.width])
    bad = ~(np.isfinite(sizes) & (sizes > 0) & (sizes <= MAX_SIZE_M)).all(axis=1)
    unknown = bad | (np.array(people.types) != np.array(kinds))
    length, width = np.where(unknown[:, None], usual, sizes).T
    return length, width, ", ".join(people.ids[k] for k in np.flatnonzero(bad)[:5])


def _futures(people: Obstacles, steps: int) -> tuple[States, BoolArray]:
    """Return recorded states and presence (P, steps) after the seed scene; the last ones stay."""
    there = people.states.shape[1] - HISTORY_STEPS - 1
    step = HISTORY_STEPS + 1 + np.arange(steps)
    column = np.minimum(step, HISTORY_STEPS + there)
    return people.states[:, column], people.present[:, column] & (step <= HISTORY_STEPS + there)


def _numbers(names: tuple[str, ...], taken: IntArray) -> IntArray:
    """Return a track id for each name: its number, or the next free one above all."""
    used, ids = {int(track) for track in taken}, list[int]()
    for name in names:
        digits = "".join(letter for letter in name if letter.isdigit())[:9]
        number = int(digits) if digits else -1
        if number < 0 or number in used:
            number = max([*used, 0]) + 1
        used.add(number)
        ids.append(number)
    return np.array(ids, dtype=np.int64)


def replaying(scene: SeedScene, kept: Sequence[int]) -> SeedScene:
    """Return a scene with some of its vehicles, the others as obstacles that move as recorded.

    Without a recorded future they go on straight at constant speed.
    """
    rest = np.setdiff1d(np.arange(scene.vehicles), kept)
    others, future, now = scene.obstacles, scene.future, scene.now
    if future is None:
        steps = REPLAYED_STEPS if others is None else others.states.shape[1] - HISTORY_STEPS - 1
        travelled_m = now.speed[:, None] * STEP_S * np.arange(1, steps + 1)
        future = now.ahead(travelled_m, np.repeat(now.speed[:, None], steps, axis=1))
    valid = np.ones(future.shape, dtype=np.bool_) if scene.future_valid is None else scene.future_valid
    known = np.ones((len(rest), HISTORY_STEPS + 1), dtype=np.bool_)
    added = Obstacles(
        ids=tuple(str(track) for track in scene.track_ids[rest]),
        types=(REPLAYED,) * len(rest),
        length=scene.length[rest],
        width=scene.width[rest],
        states=States.concatenate([scene.history[rest], future[rest]], axis=1),
        present=np.concatenate([known, valid[rest]], axis=1),
    )
    kept_scene = scene.reordered(kept, name=scene.name)
    return replace(kept_scene, obstacles=added if others is None else _both(others, added))


def some_obstacles(others: Obstacles, keep: BoolArray) -> Obstacles | None:
    """Return some obstacles; None if there are none."""
    kept = np.flatnonzero(keep)
    if not len(kept):
        return None
    return Obstacles(
        ids=tuple(others.ids[k] for k in kept),
        types=tuple(others.types[k] for k in kept),
        length=others.length[kept],
        width=others.width[kept],
        states=others.states[kept],
        present=others.present[kept],
        walks=tuple(others.walks[k] for k in kept) if others.walks else (),
    )


def _both(obstacles: Obstacles, added: Obstacles) -> Obstacles:
    return Obstacles(
        ids=obstacles.ids + added.ids,
        types=obstacles.types + added.types,
        length=np.concatenate([obstacles.length, added.length]),
        width=np.concatenate([obstacles.width, added.width]),
        states=States.concatenate([obstacles.states, added.states], axis=0),
        present=np.concatenate([obstacles.present, added.present]),
        walks=obstacles.walks and (*obstacles.walks, *[Walk()] * len(added.ids)),
    )
