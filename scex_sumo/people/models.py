"""Behaviour models of people: ``walker`` and ``cyclist``, and those of the stress test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.special import ndtri, stdtrit

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.draws import uniforms
from scex_sumo.behaviors.base import PLAN_STEPS, Sight, check_positive
from scex_sumo.behaviors.models.idm import IdmParameters
from scex_sumo.people.evasion import EVASIONS, evaded
from scex_sumo.people.expectation import expected
from scex_sumo.people.gaps import meetings, waiting_way
from scex_sumo.people.parameters import PeopleParameters, people_parameters
from scex_sumo.people.walking import HORIZON_S, Behind, Wish, steady, towards, walked
from scex_sumo.people.ways import Ways, ways_of
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, States, VehicleIndex

DRAWS, SALT = 6, 90_000
EASE_MPS2, BRAKING_MPS2 = 1.5, 3.0  # of the people of the stress test
FAR_M = 60.0  # beyond it nobody steps out before a vehicle


@dataclass(frozen=True, kw_only=True)
class PersonProfile:
    """Parameters of `Person`.

    Attributes:
        spread: factor on all drawn deviations; 0 is the expected person.
        gap: added to the time gap which it accepts before a vehicle, s.
    """

    spread: float = 1.0
    gap: float = 0.0

    def __post_init__(self) -> None:
        check_positive(self, "spread", zero=True)


class Person:
    """A pedestrian or cyclist drawn for every future: speed, direction, stops, and gaps before vehicles."""

    kind = "pedestrian"

    def __init__(self, profile: PersonProfile, parameters: PeopleParameters | None = None) -> None:
        self.profile = profile
        self.parameters = parameters or people_parameters(self.kind)

    def plan(
        self, history: SceneHistory, road: Road, who: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Plan 3 s; see `Behavior.plan`."""
        people = self.parameters
        draw = uniforms(history.route_draw[who.future, who.vehicle], DRAWS, SALT)
        wish = self._wish(history, who, draw)
        gap = people.gap_s + self.profile.spread * people.gap_spread_s * ndtri(draw[:, 5])
        gap = np.maximum(gap, 0.0) + self.profile.gap
        now = history.now[who.future, who.vehicle]
        speed, heading = np.maximum(wish.speed[:, 0], 0.1), wish.heading[:, PLAN_STEPS // 3]
        wait, in_the_way = waiting_way(meetings(history, who, speed, heading, people), speed, gap, people)
        hurries = np.where(in_the_way & (now.speed > people.standing_mps), people.hurry, 1.0)
        ways = ways_of(history, road, who, self.kind)
        plan = walked(
            now,
            Wish(speed=wish.speed * hurries[:, None], heading=wish.heading),
            wait_m=wait,
            acceleration=people.acceleration_mps2,
            braking=people.braking_mps2,
            bend=None if ways is None else ways.bend(),
            behind=None if ways is None else self._behind(history, who, ways),
        )
        return evaded(plan, history, who, [partial(self._other, now, *way) for way in EVASIONS])

    def _other(self, now: States, turn: float, least_mps: float, rows: IntArray) -> Plan:
        """Return plans of some people (n,): straight on after a turn, with at least a speed; 0 stops."""
        people, now = self.parameters, now[rows]
        speed = np.maximum(now.speed, least_mps) if least_mps else np.zeros(len(rows))
        free = np.full(len(rows), np.inf)
        braking = people.braking_mps2
        return walked(
            now, steady(speed, now.heading + turn), wait_m=free, acceleration=braking, braking=braking
        )

    def _behind(self, history: SceneHistory, who: VehicleIndex, ways: Ways) -> Behind | None:
        """Return what n people follow; None if they follow nobody."""
        return None

    def _wish(self, history: SceneHistory, who: VehicleIndex, draw: FloatArray) -> Wish:
        """Return the wanted motion (n, H), which follows from the seed scene and the draws (n, 6)."""
        people, spread, seen = self.parameters, self.profile.spread, expected(history.scene)
        shown, direction = seen.speed[who.vehicle], seen.direction[who.vehicle]
        student = spread * stdtrit(people.tails, draw[:, :2])
        stands = shown < people.standing_mps
        beyond = seen.beyond[who.vehicle] + seen.scale[who.vehicle] * student
        # Stops and starts: an exponential time, of which a share lies within 3 s.
        rate = -np.log1p(-np.where(stands, people.start_share, people.stop_share)) / HORIZON_S
        at = -np.log(draw[:, 2]) / rate if spread else np.full(len(rate), np.inf)
        time: FloatArray = (history.step + np.arange(PLAN_STEPS, dtype=np.float64)) * STEP_S
        walks = towards(shown, direction, beyond, time + STEP_S, people.settle_s)
        usual = people.usual_mps * np.exp(2 * people.usual_spread * ndtri(draw[:, 3]))
        sway = spread * people.sway_mps * np.abs(ndtri(draw[:, 3]))
        changed = time >= at[:, None]
        starts = np.where(changed, usual[:, None], sway[:, None])
        looks = direction + np.pi * (spread > 0) * (2 * draw[:, 4] - 1) ** 3
        return Wish(
            speed=np.where(stands[:, None], starts, np.where(changed, 0.0, walks.speed)),
            heading=np.where(stands[:, None], looks[:, None], walks.heading),
        )


class Walker(Person):
    """A pedestrian."""


class Cyclist(Person):
    """A cyclist."""

    kind = "bicycle"

    def _behind(self, history: SceneHistory, who: VehicleIndex, ways: Ways) -> Behind | None:
        leaders, people = ways.leaders(history, who), self.parameters
        idm = IdmParameters(
            time_headway=people.headway_s,
            minimum_gap=people.least_gap_m,
            max_acceleration=people.acceleration_mps2,
            comfort_deceleration=people.braking_mps2 / 2,
            max_deceleration=people.braking_mps2,
        )
        return Behind(gap=leaders.gap, speed=leaders.speed, idm=idm)


@dataclass(frozen=True, kw_only=True)
class StressProfile:
    """Parameters of the people of the stress test.

    Attributes:
        speed: least speed of one that steps out, m/s.
        braking: of one that stops, m/s².
    """

    speed: float = 1.5
    braking: float = BRAKING_MPS2

    def __post_init__(self) -> None:
        check_positive(self, "speed", "braking")


class KeepsWalking:
    """Walks on as shown, whatever comes."""

    sight: Sight = "itself"

    def __init__(self, profile: StressProfile) -> None:
        self.profile = profile

    def plan(
        self, history: SceneHistory, road: Road, who: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Plan 3 s; see `Behavior.plan`."""
        now = history.now[who.future, who.vehicle]
        free = np.full(len(who), np.inf)
        return walked(
            now, self.wish(history, who), wait_m=free, acceleration=EASE_MPS2, braking=self.profile.braking
        )

    def wish(self, history: SceneHistory, who: VehicleIndex) -> Wish:
        """Return the wanted motion (n, H)."""
        now = history.scene.now[who.vehicle]
        return steady(np.maximum(now.speed, 0.0), now.heading)


class Stops(KeepsWalking):
    """Stops at once."""

    def plan(
        self, history: SceneHistory, road: Road, who: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Plan 3 s; see `Behavior.plan`."""
        now, still = history.now[who.future, who.vehicle], np.zeros(len(who))
        wish = steady(still, now.heading)
        return walked(
            now, wish, wait_m=still, acceleration=self.profile.braking, braking=self.profile.braking
        )


class StepsOut(KeepsWalking):
    """Walks straight across the line of the vehicle that comes next, and on."""

    def wish(self, history: SceneHistory, who: VehicleIndex) -> Wish:
        """Return the wanted motion (n, H), which follows from the seed scene alone."""
        scene = history.scene
        now, others = scene.now[who.vehicle], scene.now
        cos, sin = np.cos(others.heading), np.sin(others.heading)
        dx, dy = now.x[:, None] - others.x, now.y[:, None] - others.y
        ahead, aside = cos * dx + sin * dy, cos * dy - sin * dx
        comes = (ahead > 0) & (np.hypot(dx, dy) < FAR_M) & (others.speed > 0.5)
        if scene.people is not None:
            comes &= ~scene.people
        soon = np.where(comes, (ahead + np.abs(aside)) / np.maximum(others.speed, 0.5), np.inf)
        next_one, row = np.argmin(soon, axis=1), np.arange(len(who))
        towards = others.heading[next_one] - np.sign(aside[row, next_one]) * (np.pi / 2)
        heading = np.where(np.isfinite(soon[row, next_one]), towards, now.heading)
        return steady(np.maximum(now.speed, self.profile.speed), heading)
