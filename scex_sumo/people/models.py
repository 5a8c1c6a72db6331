"""Behaviour models of pedestrians and cyclists: they go straight on and wait, stop, or step out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.behaviors.base import PLAN_STEPS, Driver, Sight, check_positive
from scex_sumo.behaviors.spec import ModelEntry
from scex_sumo.converters.tracks.road_users import PEOPLE
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, States, VehicleIndex

SPEEDING_UP_MPS2, BRAKING_MPS2 = 1.5, 3.0
LOOK_STEPS = 40  # for which a person and a vehicle are expected to keep their velocities
WAIT_M = 0.5  # from a vehicle's way, or from the vehicle ahead, to where a person waits
STANDING_MPS = 0.5
STEPS_OUT_MPS = 1.5  # least speed of a person that steps out
FAR_M = 60.0  # beyond it nobody steps out before a vehicle


@dataclass(frozen=True, kw_only=True)
class KeepsWayProfile:
    """Parameters of `KeepsWay`.

    Attributes:
        gap: least time between leaving the way of a vehicle and its arrival, s.
    """

    gap: float = 0.5

    def __post_init__(self) -> None:
        check_positive(self, "gap", zero=True)


class _Person(Driver, ABC):
    sight: Sight = "itself"

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Plan 3 s; see `BatchBehavior.plan`."""
        return walked(history.now[vehicles.future, vehicles.vehicle], *self._goes(history, vehicles))

    @abstractmethod
    def _goes(self, history: SceneHistory, vehicles: VehicleIndex) -> tuple[FloatArray, ...]:
        """Return speeds, headings and ways to wait, as of `walked`."""


class KeepsWay(_Person):
    """Keeps the velocity of the seed scene, and waits for vehicles: see `way_to_wait`."""

    sight: Sight = "everyone"

    def __init__(self, profile: KeepsWayProfile) -> None:
        self.profile = profile

    def _goes(self, history: SceneHistory, vehicles: VehicleIndex) -> tuple[FloatArray, ...]:
        shown = history.scene.now[vehicles.vehicle]
        return shown.speed, shown.heading, way_to_wait(history, vehicles, self.profile.gap)


class Stops(_Person):
    """Stops at once."""

    def _goes(self, history: SceneHistory, vehicles: VehicleIndex) -> tuple[FloatArray, ...]:
        nothing = np.zeros(len(vehicles))
        return nothing, history.now.heading[vehicles.future, vehicles.vehicle], nothing


class StepsOut(_Person):
    """Walks straight across the line of the vehicle that comes next in the seed scene, and on."""

    def _goes(self, history: SceneHistory, vehicles: VehicleIndex) -> tuple[FloatArray, ...]:
        speed = np.maximum(history.scene.now.speed[vehicles.vehicle], STEPS_OUT_MPS)
        return speed, _across(history, vehicles), np.full(len(vehicles), np.inf)


def way_to_wait(history: SceneHistory, vehicles: VehicleIndex, gap_s: float) -> FloatArray:
    """Return the way (n,) to where people wait for a vehicle, m; inf for those that go on.

    Both are expected to keep their velocities for 4 s. A person waits if it would then be in the vehicle's
    way, as wide as both, where the vehicle is or arrives within the gap: before that way, or behind a vehicle
    ahead. One that cannot stop before it, or is in the way of a vehicle that comes, goes on.
    """
    scene = history.scene
    drivers = np.arange(scene.vehicles) if scene.people is None else np.flatnonzero(~scene.people)
    me, other = history.now[vehicles.future, vehicles.vehicle], history.now[:, drivers][vehicles.future]
    half = (scene.length[vehicles.vehicle] + scene.width[vehicles.vehicle])[:, None] / 4
    half_length, half_width = scene.length[drivers] / 2 + half, scene.width[drivers] / 2 + half
    ahead, aside = other.ahead_and_left(me.x[:, None], me.y[:, None])
    speed = scene.now.speed[vehicles.vehicle][:, None]
    turn = scene.now.heading[vehicles.vehicle][:, None] - other.heading
    closing, across = speed * np.cos(turn) - other.speed, speed * np.sin(turn)
    reach = half_length + gap_s * np.maximum(other.speed, 0.0)
    enters, meets = np.full((2, *ahead.shape), np.inf)
    for step in range(LOOK_STEPS, -1, -1):
        time_s = step * STEP_S
        in_way = np.abs(aside + time_s * across) < half_width
        along = ahead + time_s * closing
        enters[in_way] = time_s
        meets[in_way & (along > -half_length) & (along < reach)] = time_s
    follows = (other.speed < STANDING_MPS) | ((ahead < 0) & (np.cos(turn) > 0))
    before = np.where(enters > 0, enters, np.where(follows & (meets > 0), meets, np.inf))
    with np.errstate(invalid="ignore"):  # no way at no speed
        distance_m = np.where(np.isfinite(meets) & np.isfinite(before), before * speed - WAIT_M, np.inf)
    stops = (distance_m + WAIT_M >= me.speed[:, None] ** 2 / (2 * BRAKING_MPS2)) | (enters == 0)
    return np.asarray(np.where(stops, np.maximum(distance_m, 0.0), np.inf).min(axis=1, initial=np.inf))


def walked(now: States, speed: FloatArray, heading: FloatArray, wait_m: FloatArray) -> Plan:
    """Let n people go straight on, and stop where they wait.

    ``speed``: (n,) wanted, m/s; ``heading``: (n,) rad; ``wait_m``: (n,) way to where they wait; inf: they
    need not.
    """
    v, travelled_m = np.maximum(now.speed, 0.0), np.zeros_like(now.speed)
    speeds, distances_m = np.empty((2, len(v), PLAN_STEPS))
    for step in range(PLAN_STEPS):
        left = wait_m - travelled_m
        needed = np.where(left > 0, v**2 / (2 * np.maximum(left, 1e-6)), np.inf)
        eased = v + np.clip(speed - v, -SPEEDING_UP_MPS2 * STEP_S, SPEEDING_UP_MPS2 * STEP_S)
        held = np.minimum(eased, v - np.minimum(needed, BRAKING_MPS2) * STEP_S)
        following = np.maximum(np.where(needed >= SPEEDING_UP_MPS2 / 2, held, eased), 0.0)
        travelled_m = travelled_m + (v + following) * (STEP_S / 2)
        v = following
        speeds[:, step], distances_m[:, step] = v, travelled_m
    return Plan(**vars(replace(now, heading=wrap(heading)).ahead(distances_m, speeds)))


def _across(history: SceneHistory, vehicles: VehicleIndex) -> FloatArray:
    """Return the headings (n,) across the line of the vehicle that comes next; the own one without."""
    scene = history.scene
    now, others = scene.now[vehicles.vehicle], scene.now
    ahead, aside = others[None].ahead_and_left(now.x[:, None], now.y[:, None])
    comes = (ahead > 0) & (np.hypot(ahead, aside) < FAR_M) & (others.speed > STANDING_MPS)
    if scene.people is not None:
        comes &= ~scene.people
    soon = np.where(comes, (ahead + np.abs(aside)) / np.maximum(others.speed, STANDING_MPS), np.inf)
    next_one, person = np.argmin(soon, axis=1), np.arange(len(vehicles))
    towards = others.heading[next_one] - np.sign(aside[person, next_one]) * (np.pi / 2)
    return np.where(np.isfinite(soon[person, next_one]), towards, now.heading)


_person = partial(ModelEntry, may_fail=False, is_own=False, takes_guard=False, moves=PEOPLE)

KEEPS_WAY = _person(
    make=KeepsWay,
    profile=KeepsWayProfile(),
    summary="a person that keeps its velocity, and waits for vehicles that come",
    place=81,
)
STOPS = _person(make=Stops, summary="a person that stops at once", place=82)
STEPS_OUT = _person(
    make=StepsOut, summary="a person that walks across the line of the vehicle that comes next", place=83
)
