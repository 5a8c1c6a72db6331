"""Pedestrians and cyclists of a seed scene as participants: vehicles with a behaviour model of their own."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.converters.tracks.road_users import PEOPLE, road_user
from scex_sumo.scene import HISTORY_STEPS, Obstacles, SeedScene, States

MAX_PEOPLE: Final = 100
"""People that take part in a scene: those nearest to a vehicle."""


def with_people(scene: SeedScene, vru: str) -> SeedScene:
    """Return the scene in which people do what the option ``--vru`` says; a scene with people stays."""
    others = scene.obstacles
    if others is None or scene.people is not None or vru == "replay":
        return scene
    from scex_sumo.results.obstacles import some_obstacles, taking_part

    if vru == "none":
        return replace(scene, obstacles=some_obstacles(others, ~_people(others)))
    (taking, more), notes = _taking(scene, others), list[str]()
    if more:
        notes.append(f"{more} of {MAX_PEOPLE + more} people, those farthest from vehicles, are replayed")
    if (people_now := some_obstacles(others, taking)) is None:
        return scene
    whole, wrong = taking_part(scene, people_now)
    if wrong:
        notes.append(f"people without a usable size have the usual one: {wrong}")
    return replace(whole, obstacles=some_obstacles(others, ~taking), notes=(*scene.notes, *notes))


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
        taking = np.flatnonzero(_taking(scene, others)[0])
        beside = States.stack([others.at(step)[0][taking] for step in range(1, steps + 1)], axis=0)
        states = States.concatenate([states, beside.repeat(futures)], axis=2)
    return States.concatenate([past, states], axis=1)


def _people(others: Obstacles) -> BoolArray:
    return np.array([road_user(kind) in PEOPLE for kind in others.types], dtype=np.bool_)


def _taking(scene: SeedScene, others: Obstacles) -> tuple[BoolArray, int]:
    """Return which obstacles (O,) are people that take part, and how many more there are.

    They are there at the moment, with known states: the `MAX_PEOPLE` that are nearest to a vehicle.
    """
    before, now = others.states[:, : HISTORY_STEPS + 1], others.states[:, HISTORY_STEPS]
    known = np.isfinite([before.x, before.y, before.heading, before.speed]).all(axis=(0, 2))
    taking: BoolArray = others.present[:, HISTORY_STEPS] & known & _people(others)
    if (more := int(taking.sum()) - MAX_PEOPLE) <= 0:
        return taking, 0
    far = np.hypot(now.x[:, None] - scene.now.x, now.y[:, None] - scene.now.y).min(axis=1, initial=np.inf)
    far[~taking] = np.inf
    return np.isin(np.arange(len(far)), np.argsort(far, kind="stable")[:MAX_PEOPLE]), more
