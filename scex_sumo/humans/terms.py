"""Terms of the human-like driver: accelerations of one situation, their combination, and what drivers draw.

`acceleration` is the whole driver along its path. docs/behaviors.md has the equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, clipped
from scex_sumo.base.draws import normal_quantiles
from scex_sumo.behaviors.driving.motion import CURVE_TIME_S
from scex_sumo.behaviors.models.idm import (
    IdmParameters,
    desired_speed,
    free_share,
    holding_acceleration,
    leader_share,
)
from scex_sumo.humans.parameters import HumanParameters

Values: TypeAlias = FloatArray | float  # (n,), or one for all
DEGREES = 4  # of freedom of Student's distribution: few, for rare large deviations


@dataclass(frozen=True, kw_only=True, eq=False)
class Drivers:
    """n drawn drivers. All plans of a future have the same."""

    speed: FloatArray  # (n,) in the seed scene, m/s
    acceleration: FloatArray  # (n,) lasting, shown in the last second, m/s²
    headway: FloatArray  # (n,) drawn, s
    rest: Values  # gap to the leader at rest, m
    habit: Values = 0.0  # shown acceleration beyond the demanded one, m/s²
    sudden: Values = 0.0  # that of the last step beyond the lasting one, m/s²
    variation: FloatArray | None = None  # (n, 2) drawn accelerations, m/s²
    crawl: Values = 0.0  # speed at which a standing vehicle creeps, m/s
    limit: Values | None = None  # speed limit in the seed scene, m/s; None: as now
    pull: Values = 1.0  # factor on accelerations: from standing, or of a vehicle of SUMO
    top: Values = np.inf  # speed that the vehicle can reach, m/s


@dataclass(frozen=True, kw_only=True, eq=False)
class Situation:
    """n drivers in one step of a plan."""

    driver: Drivers
    speed: FloatArray  # (n,) m/s
    limit: FloatArray  # (n,) speed limit, m/s
    headway: FloatArray  # (n,) to this leader, s
    curve_speed: Values = np.inf  # that the curves allow a moment later, m/s
    gap: Values = np.inf  # expected to the leader, m
    leader_speed: Values = 0.0  # expected, m/s
    hold: Values = np.inf  # way to the place where rules make it stop, m
    aware: BoolArray | bool = True  # whether the driver acts on its leader
    waits: BoolArray | bool = False  # whether the vehicle still stands
    time_s: float = 0.0  # since the seed scene, s


def acceleration(now: Situation, human: HumanParameters) -> FloatArray:
    """Return (n,) accelerations of drivers, m/s²."""
    asked = demanded(now, human)
    own = asked + habit(now, human) + sudden(now, human) + relieved(variation(now, human), asked, human)
    own = clipped(own, -human.max_braking_mps2, human.max_acceleration_mps2)
    moving = lowest(own, holding(now, human), resting(now, human))
    return np.where(now.waits, standing(now, human), moving)


def demanded(now: Situation, human: HumanParameters) -> FloatArray:
    """Return (n,) accelerations that road and leader ask for, m/s².

    The sum, as in the Intelligent Driver Model, makes drivers at their desired speed fall back (Treiber and
    Kesting 2013, section 11.3).
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
    idm = _idm(human, now.headway, now.driver.rest)
    gap, leader_speed = np.asarray(now.gap), np.asarray(now.leader_speed)
    formula = human.idm.max_acceleration * (1 - leader_share(idm, now.speed, gap, leader_speed))
    room = np.maximum(gap - now.driver.rest, human.min_room_m)
    needed = -(np.maximum(now.speed - leader_speed, 0.0) ** 2) / (2 * room)
    excess = np.maximum(needed - formula, 0.0)
    formula += excess - human.extra_braking_mps2 * np.tanh(excess / human.extra_braking_mps2)
    return np.where(now.aware, np.maximum(formula, -human.idm.max_deceleration), np.inf)


def resting(now: Situation, human: HumanParameters) -> FloatArray:
    """Return the acceleration that ends an approach nearer than the gap at rest, m/s²; inf for others."""
    ends = (now.leader_speed - now.speed) / human.crawl_s
    near = now.aware & (np.asarray(now.gap) < now.driver.rest)
    return np.where(near, np.maximum(ends, -human.max_braking_mps2), np.inf)


def holding(now: Situation, human: HumanParameters) -> FloatArray:
    """Return the acceleration that ends at a place to stop, m/s²: a_max·(1 - (s*/s)²) without a headway."""
    gap = np.broadcast_to(np.asarray(now.hold, dtype=np.float64), now.speed.shape)
    return holding_acceleration(_idm(human, 0.0, human.line_gap_m), now.speed, gap)


def _idm(human: HumanParameters, headway: Values, minimum_gap: Values) -> IdmParameters:
    return IdmParameters(
        time_headway=headway,
        minimum_gap=minimum_gap,
        max_acceleration=human.idm.max_acceleration,
        comfort_deceleration=human.following_mps2,
        max_deceleration=human.idm.max_deceleration,
    )


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


def relieved(added: Values, asked: FloatArray, human: HumanParameters) -> FloatArray:
    """Return added accelerations, m/s², without the positive ones of drivers that must brake."""
    return np.where(added > 0, added * clipped(1 + asked / human.relief_mps2, 0.0, 1.0), added)


def variation(now: Situation, human: HumanParameters) -> Values:
    """Return the drawn acceleration, m/s²; 0 for vehicles that stood: they differ by their ``pull``."""
    if now.driver.variation is None:
        return 0.0
    drawn = now.driver.variation @ node_weights(now.time_s, human)
    return np.where(now.driver.speed < human.standing_mps, 0.0, drawn)


def standing(now: Situation, human: HumanParameters) -> FloatArray:
    """Return the acceleration to the crawling speed, or to rest behind the leader, m/s²."""
    crawl = np.where(now.gap < now.driver.rest, 0.0, now.driver.crawl)
    most = human.max_acceleration_mps2
    return clipped((crawl - now.speed) / human.crawl_s, -most, most)


def drawn_variation(
    speed: FloatArray,
    mean_features: FloatArray,
    spread_features: FloatArray,
    draw: FloatArray,
    human: HumanParameters,
) -> FloatArray:
    """Return (n, 2) accelerations beyond the demanded ones at ``variation_times_s``, m/s².

    ``speed``: (n,) in the seed scene, m/s; ``mean_features``: (n, F); ``spread_features``: (n, 3); ``draw``:
    (n, 2) Student's numbers; 0 is the expected driver.
    """
    k = (speed >= human.fast_mps).astype(np.int64)
    drawn = np.einsum("nij,nj->ni", human.variation_root[k], draw)
    skew = np.exp(human.variation_skew[k] * np.sign(drawn.sum(axis=1)))[:, None]
    spread = skew * spread_factor(spread_features, human.variation_noise, human.variation_growth)
    added: FloatArray = np.einsum("nij,nj->ni", human.variation_mean[k], mean_features) + drawn * spread
    return np.clip(added, -human.max_variation_mps2, human.max_variation_mps2)


def spread_factor(features: FloatArray, noise: FloatArray, growth: FloatArray) -> FloatArray:
    """Return (n, N) factors on the deviation of drivers, from their variation and the noise of their boxes.

    ``features``: (n, 3) scatter, m/s², of which at 1 / ``noise`` (N,) half of the variance is noise, and two
    features of the variation, with weights ``growth`` (2,) in an exponential.
    """
    return np.asarray(np.hypot(1.0, features[:, :1] * noise) * np.exp(features[:, 1:] @ growth)[:, None])


def node_weights(time_s: float, human: HumanParameters) -> FloatArray:
    """Return (2,) weights of linear interpolation between ``variation_times_s``; the last value goes on."""
    times = human.variation_times_s
    return np.array([np.interp(time_s, times, node) for node in np.eye(len(times))])


def lateral_offsets(
    lateral: FloatArray, target: FloatArray, time_s: FloatArray, human: HumanParameters
) -> FloatArray:
    """Return (n, T) offsets from the path with the least jerk, from the shown motion to the target.

    ``lateral``: (n, 3) offset, m, speed, m/s, and acceleration, m/s², at time 0; ``target``: (n,) offset
    after ``lateral_s``, kept from then on, m; ``time_s``: (T,).

    Source: Takahashi et al. 1989, the quintic polynomial.
    """
    end = human.lateral_s
    u = np.minimum(time_s / end, 1.0)
    shape = (
        1 - 10 * u**3 + 15 * u**4 - 6 * u**5,
        end * (u - 6 * u**3 + 8 * u**4 - 3 * u**5),
        end**2 * (u**2 - 3 * u**3 + 3 * u**4 - u**5) / 2,
    )
    begun: FloatArray = lateral @ np.stack(shape)
    return np.asarray(begun + target[:, None] * (1 - shape[0]))


def students(uniform: FloatArray) -> FloatArray:
    """Return (n, K) numbers of Student's multivariate distribution with four degrees of freedom.

    ``uniform``: (n, K + 2) K for a normal vector and two for the common χ² with four degrees, -2·ln(u·u').
    """
    chi2 = -2.0 * np.log(uniform[:, -2] * uniform[:, -1])
    return np.asarray(normal_quantiles(uniform[:, :-2]) * np.sqrt(DEGREES / chi2)[:, None])
