"""Terms of the human-like driver: accelerations, each a function of one situation, and their combination.

`acceleration` is the whole driver along its path. docs/behaviors.md has the equations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce
from typing import TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.driving.motion import CURVE_TIME_S
from scex_sumo.behaviors.driving.projection import clipped
from scex_sumo.behaviors.models.idm import (
    IdmParameters,
    desired_speed,
    free_share,
    holding_acceleration,
    leader_share,
)
from scex_sumo.humans.parameters import HumanParameters
from scex_sumo.humans.population import node_weights
from scex_sumo.scene import STEP_S

Values: TypeAlias = FloatArray | float  # (n,), or one for all


@dataclass(frozen=True, kw_only=True, eq=False)
class Drivers:
    """n drawn drivers. All plans of a future have the same."""

    speed: FloatArray  # (n,) in the seed scene, m/s
    acceleration: FloatArray  # (n,) lasting, shown in the last second, m/s²
    headway: FloatArray  # (n,) drawn, s
    braking: FloatArray  # (n,) comfortable deceleration behind a leader, m/s²
    habit: Values = 0.0  # shown acceleration beyond the demanded one, m/s²
    sudden: Values = 0.0  # that of the last step beyond the lasting one, m/s²
    variation: FloatArray | None = None  # (n, 3) drawn accelerations, m/s²
    crawl: Values = 0.0  # speed at which a standing vehicle creeps, m/s
    limit: Values | None = None  # speed limit in the seed scene, m/s; None: as now
    rest: Values = 0.0  # gap to the leader at rest, m
    pull: Values = 1.0  # factor on accelerations: from standing, or of a vehicle of SUMO
    top: Values = np.inf  # speed that the vehicle can reach, m/s
    stop_s: Values = np.inf  # time in which a creeping vehicle comes to rest, s; inf: it does not


@dataclass(frozen=True, kw_only=True, eq=False)
class Trailers:
    """k vehicles that follow so closely that their leaders must tow them, or their boxes are too long."""

    row: IntArray  # (k,) of n drivers
    leader: IntArray  # (k,) row of the leader; -1 if it plans elsewhere
    gap: FloatArray  # (k,) when the plan begins, m
    drawbar: FloatArray  # (k,) gap in the seed scene, m

    @property
    def pairs(self) -> tuple[IntArray, IntArray]:
        """Rows of those whose leaders plan here, and of these leaders."""
        known = self.leader >= 0
        return self.row[known], self.leader[known]


NONE, NOWHERE = np.zeros(0, dtype=np.int64), np.zeros(0)
NO_TRAILERS = Trailers(row=NONE, leader=NONE, gap=NOWHERE, drawbar=NOWHERE)


@dataclass(frozen=True, kw_only=True, eq=False)
class Expectation:
    """What n drivers expect when they plan: their leaders, and when they start."""

    headway: FloatArray  # (n,) s
    gap: Values = np.inf  # to the leader, m
    speed: Values = 0.0  # of the leader, m/s
    acceleration: Values = 0.0  # of the leader, m/s²
    starting: Values = 0.0  # the same if the driver starts in a queue, at least 0
    slowing: Values = 0.0  # the same without noise, at most 0
    waits_s: Values = 0.0  # time until a standing vehicle starts, s
    trailers: Trailers = NO_TRAILERS

    def leader(self, step: int, travelled: Values, human: HumanParameters) -> tuple[FloatArray, FloatArray]:
        """Return (n,) gaps, m, after a step, and the speeds that drivers foresee of their leaders, m/s."""
        gap = self.gap + (self.speed + self.starting * step * STEP_S / 2) * step * STEP_S - travelled
        later = self.speed + self.slowing * (step * STEP_S + human.anticipation_s)
        speed = np.maximum(later, np.minimum(self.speed, 0.0))
        return np.asarray(gap + (speed - self.speed) * step * STEP_S / 2), np.asarray(speed)


@dataclass(frozen=True, kw_only=True, eq=False)
class Situation:
    """n drivers in one step of a plan."""

    driver: Drivers
    expects: Expectation
    speed: FloatArray  # (n,) m/s
    limit: FloatArray  # (n,) speed limit, m/s
    curve_speed: Values = np.inf  # that the curves allow a moment later, m/s
    gap: Values = np.inf  # expected to the leader, m
    leader_speed: Values = 0.0  # expected, m/s
    hold: Values = np.inf  # way to the place where rules make it stop, m
    aware: BoolArray | bool = True  # whether the driver acts on its leader
    travelled: Values = 0.0  # since the plan began, m
    plan_step: int = 0  # of the plan, since the seed scene
    step: int = 0  # since the plan began

    @property
    def time_s(self) -> float:
        """Time since the seed scene, s."""
        return (self.plan_step + self.step) * STEP_S

    @property
    def waits(self) -> BoolArray:
        """Return (n,) whether vehicles still stand."""
        return np.asarray(self.expects.waits_s > self.step * STEP_S)


def acceleration(now: Situation, human: HumanParameters) -> FloatArray:
    """Return (n,) accelerations of drivers, m/s²."""
    asked = demanded(now, human)
    own = asked + habit(now, human) + sudden(now, human) + relieved(variation(now, human), asked, human)
    moving = lowest(
        np.maximum(own, -human.max_braking_mps2),
        looking_away(now, human),
        stopping(now, human),
        resting(now, human),
        holding(now, human),
    )
    return np.where(now.waits, standing(now, human), towed(moving, now))


def demanded(now: Situation, human: HumanParameters) -> FloatArray:
    """Return (n,) accelerations that road and leader ask for, m/s².

    The sum, as in the Intelligent Driver Model, makes drivers at their desired speed fall back.

    Source: Treiber and Kesting 2013, section 11.3.
    """
    asked = lowest(free(now, human), following(now, human), curve(now, human))
    return np.where(asked > 0, asked * now.driver.pull, asked)


def lowest(*terms: FloatArray) -> FloatArray:
    """Return the smallest of (n,) accelerations."""
    return reduce(np.minimum, terms)


def free(now: Situation, human: HumanParameters) -> FloatArray:
    """Return the acceleration towards the desired speed, m/s²: a_max·(1 - (v/v0)⁴).

    v0 starts from the shown motion, see `desired_speed`: where the limit is another one, from as large a
    share of it. The motion of a standing vehicle is no habit.
    """
    speed, limit = now.driver.speed, now.limit
    before = limit if now.driver.limit is None else now.driver.limit
    share = np.divide(limit, before, out=np.ones_like(limit), where=before > 0)
    desired = desired_speed(human.idm, limit, now.speed, share * speed, now.driver.acceleration, now.time_s)
    desired = np.where(speed < human.standing_mps, limit, desired)
    wanted: FloatArray = human.idm.max_acceleration * free_share(now.speed, desired, human.free_exponent)
    return np.maximum(wanted, -human.idm.max_deceleration)


def following(now: Situation, human: HumanParameters) -> FloatArray:
    """Return the acceleration behind the leader, m/s²; inf for a driver that looks away.

    a_max·(1 - (s*/s)²), but braking exceeds the necessary Δv²/(2·(s - s0)) by at most ``extra_braking_mps2``.

    Source: necessary braking, Kesting et al. 2010.
    """
    profile = IdmParameters.of(
        human.idm, time_headway=now.expects.headway, comfort_deceleration=now.driver.braking
    )
    gap, leader_speed = np.asarray(now.gap), np.asarray(now.leader_speed)
    formula = human.idm.max_acceleration * (1 - leader_share(profile, now.speed, gap, leader_speed))
    room = np.maximum(gap - human.idm.minimum_gap, human.min_room_m)
    needed = -(np.maximum(now.speed - leader_speed, 0.0) ** 2) / (2 * room)
    excess = np.maximum(needed - formula, 0.0)
    formula += excess - human.extra_braking_mps2 * np.tanh(excess / human.extra_braking_mps2)
    return np.where(now.aware, np.maximum(formula, -human.idm.max_deceleration), np.inf)


def resting(now: Situation, human: HumanParameters) -> FloatArray:
    """Return the braking that ends at the drawn gap at rest behind the leader, m/s²; inf for others.

    From ``onset_mps2`` on Δv²/(2·(s - rest)), at a smaller gap Δv/``crawl_s``, which ends the approach.
    """
    closing, room = np.maximum(now.speed - now.leader_speed, 0.0), np.asarray(now.gap - now.driver.rest)
    needed = closing**2 / (2 * np.maximum(room, human.min_room_m))
    braking = np.where(room > 0, needed, closing / human.crawl_s)
    acts = now.aware & (closing > 0) & ((needed > human.onset_mps2) | (room <= 0))
    return np.where(acts, -np.minimum(braking, human.max_braking_mps2), np.inf)


def holding(now: Situation, human: HumanParameters) -> FloatArray:
    """Return the acceleration that ends at a place to stop, m/s²: a_max·(1 - (s*/s)²) without a headway."""
    profile = IdmParameters.of(human.idm, time_headway=np.zeros(1), comfort_deceleration=now.driver.braking)
    line = replace(profile, minimum_gap=human.line_gap_m)
    gap = np.broadcast_to(np.asarray(now.hold, dtype=np.float64), now.speed.shape)
    return holding_acceleration(line, now.speed, gap)


def curve(now: Situation, human: HumanParameters) -> FloatArray:
    """Return the acceleration to the speed that the curves ahead allow, m/s²; comfortable braking at most."""
    slowing = (now.curve_speed - now.speed) / CURVE_TIME_S
    return np.maximum(slowing, -human.idm.comfort_deceleration)


def habit(now: Situation, human: HumanParameters) -> FloatArray:
    """Return the shown acceleration beyond the demanded one, which fades, m/s²."""
    return np.asarray(now.driver.habit * np.exp(-now.time_s / human.habit_s))


def sudden(now: Situation, human: HumanParameters) -> FloatArray:
    """Return the last step's acceleration beyond the lasting one, which fades sooner, m/s²."""
    return np.asarray(now.driver.sudden * np.exp(-now.time_s / human.sudden_s))


def variation(now: Situation, human: HumanParameters) -> Values:
    """Return the drawn acceleration, m/s²; 0 for vehicles that stand: they differ by their ``pull``."""
    if now.driver.variation is None:
        return 0.0
    drawn = now.driver.variation @ node_weights(now.time_s, human)
    return np.where((now.expects.waits_s > 0) | (now.driver.speed < human.standing_mps), 0.0, drawn)


def relieved(added: Values, asked: FloatArray, human: HumanParameters) -> FloatArray:
    """Return added accelerations, m/s², without the positive ones of drivers that must brake."""
    return np.where(added > 0, added * clipped(1 + asked / human.relief_mps2, 0.0, 1.0), added)


def looking_away(now: Situation, human: HumanParameters) -> FloatArray:
    """Return the limit, m/s²; a driver that looks away does not speed up towards a near leader."""
    allowed = now.aware | (now.speed < now.expects.speed) | (now.gap > human.far_leader_m)
    return np.where(allowed, human.max_acceleration_mps2, 0.0)


def stopping(now: Situation, human: HumanParameters) -> FloatArray:
    """Return the braking with which a creeping vehicle comes to rest, m/s²; inf for others.

    From a plan after that, it waits as others do that stand.
    """
    stops = np.isfinite(now.driver.stop_s) & (now.plan_step * STEP_S < now.driver.stop_s)
    return np.where(stops, -now.driver.speed / now.driver.stop_s, np.inf)


def standing(now: Situation, human: HumanParameters) -> FloatArray:
    """Return the acceleration to the crawling speed, or to rest behind the leader, m/s²."""
    towards = (now.driver.crawl - now.speed) / human.crawl_s
    limited = clipped(towards, -human.max_acceleration_mps2, human.max_acceleration_mps2)
    return lowest(limited, np.where(now.gap < now.driver.rest, -now.speed / human.crawl_s, np.inf))


def towed(moving: FloatArray, now: Situation) -> FloatArray:
    """Return (n,) accelerations, m/s², where those of trailers keep the gap to their leaders.

    a = a_leader + 2 1/s·Δv + 1 1/s²·(gap - drawbar).
    """
    expects, trailers, v = now.expects, now.expects.trailers, now.speed
    if not len(trailers.row):
        return moving
    k = trailers.row
    pull, speed = (np.broadcast_to(a, v.shape)[k] for a in (expects.acceleration, expects.speed))
    travelled, step = np.broadcast_to(now.travelled, v.shape), now.step
    gap = trailers.gap + (speed + pull * step * STEP_S / 2) * step * STEP_S - travelled[k]
    result = moving.copy()
    result[k] = pull + 2 * (speed + pull * step * STEP_S - v[k]) + gap - trailers.drawbar
    k, puller = trailers.pairs
    apart = (trailers.gap - trailers.drawbar)[trailers.leader >= 0] - travelled[k] + travelled[puller]
    result[k] = result[puller] + 2 * (v[puller] - v[k]) + apart
    return result
