"""Pedestrians and cyclists of a seed scene as participants: vehicles with a behaviour model of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.converters.tracks.road_users import OBSTACLE_SIZES, PEOPLE, person_kind, road_user
from scex_sumo.scene import HISTORY_STEPS, Obstacles, SeedScene, States

MAX_PEOPLE: Final = 100
"""People that take part in a scene: those nearest to a vehicle."""

MAX_SIZE_M: Final = 4.0


def with_people(scene: SeedScene, vru: str) -> SeedScene:
    """Return the scene in which people do what the option ``--vru`` says; a scene with people stays."""
    others = scene.obstacles
    if others is None or scene.people is not None:
        return scene
    people = np.array([road_user(kind) in PEOPLE for kind in others.types])
    if vru == "replay":
        return scene
    if vru == "none":
        return replace(scene, obstacles=some_obstacles(others, ~people))
    taking, notes = _taking(others) & people, list[str]()
    if (more := int(taking.sum()) - MAX_PEOPLE) > 0:
        taking = _nearest(scene, others, taking)
        notes.append(f"{more} of {MAX_PEOPLE + more} people, those farthest from vehicles, are replayed")
    if (people_now := some_obstacles(others, taking)) is None:
        return scene
    taking_part, wrong = _taking_part(scene, people_now)
    if wrong:
        notes.append(f"people without a usable size have the usual one: {wrong}")
    return replace(taking_part, obstacles=some_obstacles(others, ~taking), notes=(*scene.notes, *notes))


@owner_cache
def everybody(scene: SeedScene) -> SeedScene:
    """Return the scene with its people as last vehicles, also where they are replayed."""
    return with_people(scene, "model")


def with_everybody(scene: SeedScene, states: States) -> States:
    """Return states (C, 11 + T, V) from a second before the moment on, of all that `everybody` has.

    Args:
        states: (C, T, V) of the scene's vehicles in futures.
    """
    whole, futures, steps = everybody(scene), states.shape[0], states.shape[1]
    past = whole.history.swapaxes(0, 1).repeat(futures)
    others = scene.obstacles
    if others is not None and whole is not scene:
        people = np.array([road_user(kind) in PEOPLE for kind in others.types])
        taking = np.flatnonzero(_nearest(scene, others, _taking(others) & people))
        beside = States.stack([others.at(step)[0][taking] for step in range(1, steps + 1)], axis=0)
        states = States.concatenate([states, beside.repeat(futures)], axis=2)
    return States.concatenate([past, states], axis=1)


def _taking(others: Obstacles) -> BoolArray:
    """Return which obstacles (O,) are there at the moment, with known states."""
    there = others.states[:, : HISTORY_STEPS + 1]
    known = np.isfinite([there.x, there.y, there.heading, there.speed]).all(axis=(0, 2))
    return np.asarray(others.present[:, HISTORY_STEPS] & known)


def _nearest(scene: SeedScene, others: Obstacles, taking: BoolArray) -> BoolArray:
    """Return the `MAX_PEOPLE` obstacles of some (O,) that are nearest to a vehicle."""
    if taking.sum() <= MAX_PEOPLE:
        return taking
    far = _distance(scene, others)
    far[~taking] = np.inf
    return np.isin(np.arange(len(far)), np.argsort(far, kind="stable")[:MAX_PEOPLE])


def _taking_part(scene: SeedScene, people: Obstacles) -> tuple[SeedScene, str]:
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


def _distance(scene: SeedScene, others: Obstacles) -> FloatArray:
    now, there = scene.now, others.states[:, HISTORY_STEPS]
    apart = np.hypot(there.x[:, None] - now.x, there.y[:, None] - now.y)
    return np.asarray(apart.min(axis=1, initial=np.inf))


def some_obstacles(others: Obstacles, keep: BoolArray) -> Obstacles | None:
    """Return some obstacles; None if there are none."""
    at = np.flatnonzero(keep)
    if not len(at):
        return None
    return Obstacles(
        ids=tuple(others.ids[k] for k in at),
        types=tuple(others.types[k] for k in at),
        length=others.length[at],
        width=others.width[at],
        states=others.states[at],
        present=others.present[at],
        walks=tuple(others.walks[k] for k in at) if others.walks else (),
    )
