"""Likely driver: each vehicle's driver is drawn from a population that was fitted to recordings.

A drawn driver follows the Intelligent Driver Model as ``calibrated_driver`` does, with a time headway of its
own, adds an acceleration of its own to it, stays or starts when it stands, keeps to its side of the lane or
changes to the next one, and takes one of its paths. What it shows in the seed scene beside what is asked of
it there goes on for a while. All draws follow from `SceneHistory.route_draw`, so every plan of a child has
the same driver in it; with what the last second shows, they are conditioned on the seed scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.driving.leaders import Leaders
from scex_sumo.behaviors.driving.motion import REAR_AXLE_SHARE, Accelerate, curve_speeds, drive
from scex_sumo.behaviors.driving.paths import DS_M, PathChoice, SeedPaths, chosen_paths
from scex_sumo.behaviors.driving.projection import clipped, expected_way, foot_points
from scex_sumo.behaviors.models.idm import CURVE_TIME_S, desired_speed, desired_speeds
from scex_sumo.behaviors.models.idm_profile import CALIBRATED, IdmParameters
from scex_sumo.behaviors.models.likely_lanes import change_shares, change_to, lanes_beside
from scex_sumo.behaviors.models.likely_seen import (
    STANDING_MPS,
    Seen,
    asked_acceleration,
    leaders_of,
    path_edges,
    queue_place,
    room_beside,
    seen_of,
    shown_by,
    side_shown,
)
from scex_sumo.behaviors.models.population import (
    MOST_ASIDE_M,
    MOST_CHANGE_M,
    node_shares,
    population,
    spread_of,
    students,
    uniforms,
    way_across,
)
from scex_sumo.behaviors.parameters import check_path, check_positive
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, SeedScene, Who
from scex_sumo.statistics.normal import normal_quantiles

STARTING_MPS = 0.02  # a standing vehicle that gained so much in the last step has started
HEADWAY_S = (0.1, 4.0)  # nobody keeps less or more
KEPT_SHARE = 0.9  # of the headway shown in the seed scene, which a driver keeps at most
RELIEF_MPS2 = 3.0  # who has to brake this hard adds nothing to it
STRONGEST_MPS2 = 4.0
HARDEST_MPS2 = -4.0
BRAKING_MPS2 = (0.5, 8.0)  # nobody comes up to a leader more gently or harder than that
ROOM_SHARE = 0.8  # of the room to who drives beside it, of which a driver makes use by chance
CRAWL_S = 0.5  # who stands has the speed at which it crawls after about this time
QUEUE_GAP_M = 0.5  # nobody crawls nearer to its leader
_DRIVER, _START = 0, 1  # salts; each plan has a start of its own


@dataclass(frozen=True, kw_only=True)
class LikelyProfile:
    """Parameters of `LikelyDriver`.

    Attributes:
        spread: factor on how much drivers differ; 1 as people do, 0 the expected driver.
        path: which path to take, as in `IdmProfile`, or ``fitted``: a draw per child and vehicle, by how well
            each path fits what the vehicle shows.
    """

    spread: float = 1.0
    path: PathChoice | str = "fitted"

    def __post_init__(self) -> None:
        check_positive(self, "spread", zero=True)
        if self.path != "fitted":
            check_path(self.path)


@dataclass(frozen=True, kw_only=True, eq=False)
class Drivers:
    """The n drivers of a plan, as drawn.

    Attributes:
        headway: (n,) s.
        braking: (n,) comfortable deceleration behind a leader, m/s².
        own: (n, 3) what each adds to its acceleration in each second after the seed scene, m/s².
        aside: (n, 31) where each wants to be beside its path now and after each step, m, left positive.
        crawl: (n,) factor on the speed of who stands.
        leader: (n,) column of its leader in the seed scene,
        slack: (n,) and how much further away that one is taken to be, m, see `Seen`.
        habit: (n,) what it shows beside what is asked of it there, m/s².
    """

    headway: FloatArray
    braking: FloatArray
    own: FloatArray
    aside: FloatArray
    crawl: FloatArray
    leader: IntArray
    slack: FloatArray
    habit: FloatArray


class LikelyDriver:
    """Drivers as people are: one drawn for every vehicle of every child."""

    def __init__(self, profile: LikelyProfile) -> None:
        self.profile = profile
        self.population = population()

    def plan(self, history: SceneHistory, road: Road, who: Who, rng: Sequence[np.random.Generator]) -> Plan:
        """Plan 3 s; see `Behavior.plan`. What it draws follows from `SceneHistory.route_draw` alone."""
        paths, row = self._paths(history, road, who)
        drivers = self._drivers(history, road, who, paths, row)
        own = history.now[who.child, who.vehicle]
        s, _, _ = foot_points(paths, row, own.x, own.y, expected_way(history, who))
        leaders = leaders_of(history, who, paths, row, s, drivers.aside[:, 0])
        waits = self._waits(history, who, leaders)
        accelerate = _acceleration(history, who, paths, row, leaders, drivers, waits, self.population.habit_s)
        return drive(history, who, paths, row, accelerate, aside=drivers.aside)

    def _paths(self, history: SceneHistory, road: Road, who: Who) -> tuple[SeedPaths, IntArray]:
        if self.profile.path != "fitted":
            return chosen_paths(history, road, who, self.profile.path)  # type: ignore[arg-type]
        paths, _ = chosen_paths(history, road, who, 0)
        edges = path_edges(history.scene, paths, self.population)
        draw = uniforms(history.route_draw[who.child, who.vehicle], 1, 7)[:, 0]
        row = paths.first[who.vehicle]
        last = row + paths.count[who.vehicle] - 1
        for _ in range(int(paths.count.max(initial=1)) - 1):
            row = row + ((row < last) & (draw >= edges[row]))
        return paths, row

    def _drivers(
        self, history: SceneHistory, road: Road, who: Who, paths: SeedPaths, row: IntArray
    ) -> Drivers:
        drawn = uniforms(history.route_draw[who.child, who.vehicle], 12, _DRIVER)
        spread, known = self.profile.spread, self.population
        seen, speed = seen_of(history.scene, paths), shown_by(history.scene).speed[who.vehicle]
        headway = np.exp(known.headway[0] + spread * known.headway[1] * normal_quantiles(drawn[:, 5]))
        shown = np.maximum(KEPT_SHARE * seen.headway[row], HEADWAY_S[0])
        braking = np.exp(known.braking[0] + spread * known.braking[1] * normal_quantiles(drawn[:, 7]))
        time_s = np.arange(history.step, history.step + PLAN_STEPS + 1, dtype=np.float64) * STEP_S
        off = spread * students(drawn[:, [6, 6, 6, 8, 9]])[:, 0]
        wills = drawn[:, 11] if spread else np.full(len(row), 0.5)
        side = self._side(history.scene, road, paths, who.vehicle, row, off, wills)
        headway, braking = np.clip(np.minimum(headway, shown), *HEADWAY_S), np.clip(braking, *BRAKING_MPS2)
        return Drivers(
            headway=headway,
            own=known.own_acceleration(
                speed, seen.features[row], seen.unsure[row], spread * students(drawn[:, :5])
            ),
            braking=braking,
            aside=way_across(seen.across[row], side, time_s),
            crawl=1 + np.minimum(spread, 1.0) * (2 * drawn[:, 10] - 1),
            leader=seen.leader[row],
            slack=seen.slack[row],
            habit=_habit(history, who, seen, row, headway, braking),
        )

    def _side(
        self,
        scene: SeedScene,
        road: Road,
        paths: SeedPaths,
        vehicle: IntArray,
        row: IntArray,
        off: FloatArray,
        wills: FloatArray,
    ) -> FloatArray:
        """(n,) where drivers want to be beside their paths after 3 s: in their lane or in the next one, m.

        Args:
            off: (n,) Student's draws: by how much not where one expects them.
            wills: (n,) in (0, 1): the lowest change to the left, the highest to the right.
        """
        known, across = self.population, seen_of(scene, paths).across[row]
        wide = known.side_m * spread_of(side_shown(scene), known.side_noise, known.side_unsure)[vehicle, 0]
        right, left = (ROOM_SHARE * room_beside(scene)[vehicle]).T
        keeps = across @ known.keeps_side + np.clip(wide * off, -right, left)
        keeps = np.clip(keeps, -MOST_ASIDE_M, MOST_ASIDE_M)
        share = change_shares(scene, road, paths, known)[row]
        to = change_to(across, lanes_beside(scene, road, paths)[row], known) + known.change_m * off[:, None]
        to = np.clip(to, -MOST_CHANGE_M, MOST_CHANGE_M)
        return np.where(wills < share[:, 0], to[:, 0], np.where(wills > 1 - share[:, 1], to[:, 1], keeps))

    def _waits(self, history: SceneHistory, who: Who, leaders: Leaders) -> FloatArray:
        """(n,) for how long each vehicle stands from now on, s; 0 where it drives."""
        speed = history.states.speed[who.child, who.vehicle]
        before = speed[:, -2] if history.step else speed[:, -1]
        stands = (speed[:, -1] < STANDING_MPS) & (speed[:, -1] - before < STARTING_MPS)
        draw = uniforms(history.route_draw[who.child, who.vehicle], 1, 10 + history.step)[:, 0]
        if self.profile.spread == 0:
            draw = np.full_like(draw, 0.5)
        rate = np.asarray(self.population.start_rate)[queue_place(leaders.gap, leaders.speed)]
        # Waiting has no memory: what is drawn anew in every plan is one exponential time in all.
        return np.where(stands, -np.log(draw) / np.maximum(rate, 1e-9), 0.0)


def _habit(
    history: SceneHistory, who: Who, seen: Seen, row: IntArray, headway: FloatArray, braking: FloatArray
) -> FloatArray:
    """(n,) acceleration shown in the seed scene beside what was asked there, as far as believed, m/s²."""
    shown = shown_by(history.scene)
    speed, acceleration = shown.speed[who.vehicle], shown.acceleration[who.vehicle]
    profile = IdmParameters.of(CALIBRATED, time_headway=headway, comfort_deceleration=braking)
    desired = desired_speed(CALIBRATED, seen.wished[row], speed, speed, acceleration, 0.0)
    asked = asked_acceleration(
        profile, speed, desired, seen.gap[row], seen.leader_speed[row], seen.curve[row]
    )
    habit = acceleration - shown.calm[who.vehicle] * np.clip(asked, HARDEST_MPS2, STRONGEST_MPS2)
    return np.where(speed < STANDING_MPS, 0.0, habit)


def headway_kept(speed: FloatArray, leaders: Leaders, drivers: Drivers) -> FloatArray:
    """(n,) time headway as drawn, s; behind a leader that is new, no more than there is."""
    there = (leaders.gap - CALIBRATED.minimum_gap) / np.maximum(speed, 1.0)
    most = np.where(leaders.index == drivers.leader, np.inf, np.maximum(KEPT_SHARE * there, HEADWAY_S[0]))
    return np.minimum(drivers.headway, most)


def _acceleration(
    history: SceneHistory,
    who: Who,
    paths: SeedPaths,
    row: IntArray,
    leaders: Leaders,
    drivers: Drivers,
    waits: FloatArray,
    habit_s: float,
) -> Accelerate:
    """Acceleration of drawn drivers, for `drive`."""
    wished = desired_speeds(paths, CALIBRATED.speed, CALIBRATED.speed_factor)
    curves = curve_speeds(paths, CALIBRATED.curve_acceleration, CALIBRATED.curve_deceleration)
    first, last = row * paths.samples, paths.samples - 1
    ahead = REAR_AXLE_SHARE * history.scene.length[who.vehicle]
    shown = shown_by(history.scene)
    motion = (shown.speed[who.vehicle], shown.acceleration[who.vehicle])
    stood = motion[0] < STANDING_MPS
    headway = headway_kept(history.states.speed[who.child, who.vehicle, -1], leaders, drivers)
    profile = IdmParameters.of(CALIBRATED, time_headway=headway, comfort_deceleration=drivers.braking)
    away = leaders.gap + np.where(leaders.index == drivers.leader, drivers.slack, 0.0)
    crawl = np.minimum(motion[0] * drivers.crawl, STANDING_MPS)

    def at(s: FloatArray) -> IntArray:
        return first + clipped((s + ahead) * (1 / DS_M), 0.0, last).astype(np.int64)

    def accelerate(step: int, v: FloatArray, travelled: FloatArray, s: FloatArray) -> FloatArray:
        time_s = (history.step + step) * STEP_S
        limit = wished[at(s)]
        # What a standing vehicle shows is no habit.
        desired = np.where(stood, limit, desired_speed(CALIBRATED, limit, v, *motion, time_s))
        gap = away + leaders.speed * (step * STEP_S) - travelled
        curve = curves[at(s + v * CURVE_TIME_S)]
        asked = asked_acceleration(profile, v, desired, gap, leaders.speed, curve)
        own = np.where(waits > 0, 0.0, drivers.own @ node_shares(time_s))
        own = np.where(own > 0, own * clipped(1 + asked / RELIEF_MPS2, 0.0, 1.0), own)
        asked = asked + drivers.habit * np.exp(-time_s / habit_s)
        still = clipped((crawl - v) / CRAWL_S, -STRONGEST_MPS2, STRONGEST_MPS2)
        still = np.minimum(still, np.where(gap < QUEUE_GAP_M, -v / CRAWL_S, np.inf))
        return np.where(waits > step * STEP_S, still, clipped(asked + own, HARDEST_MPS2, STRONGEST_MPS2))

    return accelerate
