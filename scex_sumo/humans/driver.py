"""Likely driver: a driver per vehicle and child, drawn from a population fitted to recordings.

It follows the Intelligent Driver Model with its own headway, additional acceleration, place in the lane,
path, start from standing and attention. All draws follow from `SceneHistory.route_draw` and the last second
before the seed moment, so all plans of a child have the same driver.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.base import PLAN_STEPS, check_path, check_positive
from scex_sumo.behaviors.driving.leaders import Leaders
from scex_sumo.behaviors.driving.motion import CURVE_TIME_S, REAR_AXLE_SHARE, Accelerate, curve_speeds, drive
from scex_sumo.behaviors.driving.paths import DS_M, PathChoice, SeedPaths, chosen_paths
from scex_sumo.behaviors.driving.projection import clipped, expected_way, foot_points
from scex_sumo.behaviors.models.idm import (
    CALIBRATED,
    HABIT_STEPS,
    IdmParameters,
    desired_speed,
    desired_speeds,
)
from scex_sumo.humans.attention import attention_of, kept_clear, respond
from scex_sumo.humans.lanes import change_shares, change_to, lanes_beside
from scex_sumo.humans.observations import (
    CREEPING_MPS,
    STANDING_MPS,
    PathObservations,
    behind_a_wave,
    demanded_acceleration,
    last_second,
    leaders_of,
    observations_of,
    path_edges,
    queue_leaders,
    room_beside,
    side_shown,
    start_features,
    stop_features,
)
from scex_sumo.humans.population import (
    FAR_M,
    MAX_ASIDE_M,
    MAX_CHANGE_M,
    node_shares,
    population,
    spread_of,
    students,
    uniforms,
    way_across,
)
from scex_sumo.humans.seed_state import estimated_history, heading_scatter
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, SeedScene, VehicleIndex

SUDDEN_S = 0.7  # time constant of the sudden part of a shown acceleration; set by the error
ANTICIPATION_S = 1.0  # of a leader that slows down (Treiber, Kesting, Helbing 2006); figure chosen
STARTING_MPS = 0.02  # a standing vehicle that gained this in the last step has started
HEADWAY_S = (0.1, 4.0)  # bounds
KEPT_SHARE = 0.9  # of the headway shown in the seed scene, the largest that a driver keeps
RELIEF_MPS2 = 3.0  # a driver who must brake this hard has no additional acceleration
STRONGEST_MPS2 = 4.0
HARDEST_MPS2 = -4.0
BRAKING_MPS2 = (0.5, 8.0)  # bounds
ROOM_SHARE = 0.4  # of the room to vehicles beside, the largest motion towards them
TURNING, MAX_TURNING_M = np.array([1.0, 3.0, 4.5]), 6.0  # weights of ``across`` off the mapped lanes
MAX_SPREAD = 100
CRAWL_S = 0.5  # time constant towards the crawling speed of a standing vehicle
TOWED_S, TOWED_MPS, TOWED_OPENING_MPS = 0.15, 3.0, 1.0  # headway, speed, and speed difference
QUEUE_GAP_M = 0.5  # smallest gap for crawling
STOP_S, STOP_SPREAD = 2.2, 0.4  # median time in which creeping vehicles come to rest, and log spread
WAVE_S, STARTING_S = 1.0, 4.0  # mean time from the leader's start, and time for which the rate counts
DRIVER, PATH, STARTS, START = 0, 7, 8, 10  # salts of draws; each plan has its own start


@dataclass(frozen=True, kw_only=True)
class LikelyProfile:
    """Parameters of `LikelyDriver`.

    Attributes:
        spread: factor on the variation between drivers; 1 as recorded, 0 the expected driver.
        inattention: factor on the time that drivers look away; 1 as observed, 0 never.
        path: as in `IdmProfile`, or ``fitted``: drawn per child and vehicle, by how well each path fits the
            vehicle's motion.
    """

    spread: float = 1.0
    inattention: float = 1.0
    path: PathChoice | str = "fitted"

    def __post_init__(self) -> None:
        check_positive(self, "spread", "inattention", zero=True)
        if self.spread > MAX_SPREAD:
            raise UsageError(f"spread: got {self.spread!r}; give a number up to {MAX_SPREAD}")
        if self.path != "fitted":
            check_path(self.path)


@dataclass(frozen=True, kw_only=True, eq=False)
class Drivers:
    """The n drawn drivers of a plan."""

    headway: FloatArray  # (n,) s
    braking: FloatArray  # (n,) comfortable deceleration behind a leader, m/s²
    additional: FloatArray  # (n, 3) m/s²
    aside: FloatArray  # (n, 31) wanted offset from the path, m, left positive
    crawl: FloatArray  # (n,) factor on the speed of a standing vehicle
    stop_s: FloatArray  # (n,) time in which a creeping vehicle comes to rest, s; inf: it does not
    leader: IntArray  # (n,) column of the leader in the seed scene
    gap: FloatArray  # (n,) to that leader in the seed scene, m
    opening: FloatArray  # (n,) its speed in the seed scene beyond that of the vehicle, m/s
    slack: FloatArray  # (n,) as in `PathObservations`
    habit: FloatArray  # (n,) lasting shown acceleration beyond that of the model, m/s²
    sudden: FloatArray  # (n,) shown acceleration beyond the lasting one, m/s²


class LikelyDriver:
    """A random driver for every vehicle of every child."""

    def __init__(self, profile: LikelyProfile) -> None:
        self.profile = profile
        self.population = population()

    def plan(
        self, history: SceneHistory, road: Road, who: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Plan 3 s; see `Behavior.plan`."""
        doubt = heading_scatter(history.scene, road)[who.vehicle]
        history = estimated_history(history, road)
        paths, row = self._paths(history, road, who)
        drivers = self._drivers(history, road, who, paths, row)
        now = history.now[who.child, who.vehicle]
        s, _, _ = foot_points(paths, row, now.x, now.y, expected_way(history, who))
        leaders = leaders_of(history, who, paths, row, s, drivers.aside[:, 0])
        waits = self._waits(history, who, paths, leaders)
        attention = attention_of(
            history, who, leaders, self.profile.inattention, min(self.profile.spread, 1.0)
        )
        accelerate = _acceleration(
            history, who, paths, row, leaders, drivers, waits, self.population.habit_s, attention.aware
        )
        aside = kept_clear(drivers.aside, history, road, who, paths, row, s)
        made = drive(history, who, paths, row, accelerate, aside=aside, parallel=True, doubt=doubt)
        return respond(made, history, road, who, attention)

    def _paths(self, history: SceneHistory, road: Road, who: VehicleIndex) -> tuple[SeedPaths, IntArray]:
        if self.profile.path != "fitted":
            return chosen_paths(history, road, who, self.profile.path)  # type: ignore[arg-type]
        paths, _ = chosen_paths(history, road, who, 0)
        edges = path_edges(history.scene, paths, self.population)
        draw = uniforms(history.route_draw[who.child, who.vehicle], 1, PATH)[:, 0]
        row = paths.first[who.vehicle]
        last = row + paths.count[who.vehicle] - 1
        for _ in range(int(paths.count.max(initial=1)) - 1):
            row = row + ((row < last) & (draw >= edges[row]))
        return paths, row

    def _drivers(
        self, history: SceneHistory, road: Road, who: VehicleIndex, paths: SeedPaths, row: IntArray
    ) -> Drivers:
        drawn = uniforms(history.route_draw[who.child, who.vehicle], 13, DRIVER)
        spread, people = self.profile.spread, self.population
        observed, speed = observations_of(history.scene, paths), last_second(history.scene).speed[who.vehicle]
        headway = np.exp(people.headway[0] + spread * people.headway[1] * ndtri(drawn[:, 5]))
        shown = np.maximum(KEPT_SHARE * observed.headway[row], HEADWAY_S[0])
        braking = np.exp(people.braking[0] + spread * people.braking[1] * ndtri(drawn[:, 7]))
        time_s = np.arange(history.step, history.step + PLAN_STEPS + 1, dtype=np.float64) * STEP_S
        off = spread * students(drawn[:, [6, 6, 6, 8, 9]])[:, 0]
        wills = drawn[:, 11] if spread else np.full(len(row), 0.5)
        side = self._side(history.scene, road, paths, who.vehicle, row, off, wills)
        headway, braking = np.clip(np.minimum(headway, shown), *HEADWAY_S), np.clip(braking, *BRAKING_MPS2)
        return Drivers(
            headway=headway,
            additional=people.additional_acceleration(
                speed, observed.features[row], observed.unsure[row], spread * students(drawn[:, :5])
            ),
            braking=braking,
            aside=way_across(observed.across[row], side, time_s),
            crawl=1 + np.minimum(spread, 1.0) * (2 * drawn[:, 10] - 1),
            stop_s=self._stops(history, who, observed, row, drawn[:, 12]),
            leader=observed.leader[row],
            gap=observed.gap[row] - observed.slack[row],
            opening=observed.leader_speed[row] - speed,
            slack=observed.slack[row],
            habit=_habit(history, who, observed, row, headway, braking),
            sudden=last_second(history.scene).sudden[who.vehicle],
        )

    def _stops(
        self,
        history: SceneHistory,
        who: VehicleIndex,
        observed: PathObservations,
        row: IntArray,
        draw: FloatArray,
    ) -> FloatArray:
        """Return (n,) times in which creeping vehicles come to rest, s; inf for others."""
        shown, spread = last_second(history.scene), min(self.profile.spread, 1.0)
        speed = shown.speed[who.vehicle]
        features = stop_features(
            speed, shown.acceleration[who.vehicle], observed.gap[row], observed.leader_speed[row]
        )
        share = 1 / (1 + np.exp(-features @ self.population.stop))
        draw = draw if spread else np.full_like(draw, 0.5)
        stops = (speed >= STANDING_MPS) & (speed < CREEPING_MPS) & (draw < share)
        time_s = STOP_S * np.exp(spread * STOP_SPREAD * ndtri(np.where(stops, draw / share, 0.5)))
        return np.where(stops, time_s, np.inf)

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
        """Return (n,) wanted offsets from the path after 3 s, m.

        Args:
            off: (n,) Student's draws.
            wills: (n,) in (0, 1): low ones change to the left, high ones to the right.
        """
        people, across = self.population, observations_of(scene, paths).across[row]
        wide = people.side_m * spread_of(side_shown(scene), people.side_noise, people.side_unsure)[vehicle, 0]
        right, left = (ROOM_SHARE * room_beside(scene)[vehicle]).T
        most = np.maximum(MAX_ASIDE_M, np.abs(across[:, 0]))
        keeps = np.clip(across @ people.keeps_side + wide * off, -most, most)
        # Vehicles beside each other share the space between them.
        keeps = across[:, 0] + np.clip(keeps - across[:, 0], -right, left)
        # Off the mapped lanes there is no lane to return to: the turn goes on.
        turning = np.clip(across @ TURNING, -MAX_TURNING_M, MAX_TURNING_M)
        keeps = np.where(paths.on_road[vehicle], keeps, turning)
        share = change_shares(scene, road, paths, people)[row]
        to = change_to(across, lanes_beside(scene, road, paths)[row], people) + people.change_m * off[:, None]
        to = np.clip(to, -MAX_CHANGE_M, MAX_CHANGE_M)
        return np.where(wills < share[:, 0], to[:, 0], np.where(wills > 1 - share[:, 1], to[:, 1], keeps))

    def _waits(
        self, history: SceneHistory, who: VehicleIndex, paths: SeedPaths, leaders: Leaders
    ) -> FloatArray:
        """Return (n,) s for which vehicles stand from now on."""
        speed = history.states.speed[who.child, who.vehicle]
        before = speed[:, -2] if history.step else speed[:, -1]
        stands = (speed[:, -1] < STANDING_MPS) & (speed[:, -1] - before < STARTING_MPS)
        route = history.route_draw[who.child, who.vehicle]
        starts, draw = uniforms(route, 1, STARTS)[:, 0], uniforms(route, 1, START + history.step)[:, 0]
        if self.profile.spread == 0:
            starts, draw = np.full_like(draw, 0.5), np.full_like(draw, 0.5)
        queue = queue_leaders(history.scene, paths)
        wave = behind_a_wave(history.now.speed, leaders, who.child, queue)
        rate = np.exp(start_features(speed[:, -1], leaders.gap, leaders.speed, wave) @ self.population.start)
        # The fitted rate says how many start soon; those that do follow the wave.
        # Waiting has no memory: draws of successive plans give one exponential time in all.
        wait = np.where(starts < 1 - np.exp(-rate * STARTING_S), -WAVE_S * np.log(draw), np.inf)
        return np.where(stands, wait, 0.0)


def _habit(
    history: SceneHistory,
    who: VehicleIndex,
    observed: PathObservations,
    row: IntArray,
    headway: FloatArray,
    braking: FloatArray,
) -> FloatArray:
    shown = last_second(history.scene)
    speed, acceleration = shown.speed[who.vehicle], shown.acceleration[who.vehicle]
    profile = IdmParameters.of(CALIBRATED, time_headway=headway, comfort_deceleration=braking)
    desired = desired_speed(CALIBRATED, observed.wished[row], speed, speed, acceleration, 0.0)
    leader = observed.leader[row]
    vehicle = (leader >= 0) & (leader < history.scene.vehicles)
    slows = np.where(vehicle, (np.minimum(shown.late, 0.0) * shown.calm)[np.where(vehicle, leader, 0)], 0.0)
    lead = _foreseen(observed.leader_speed[row], slows, ANTICIPATION_S)
    demanded = demanded_acceleration(profile, speed, desired, observed.gap[row], lead, observed.curve[row])
    habit = acceleration - shown.calm[who.vehicle] * np.clip(demanded, HARDEST_MPS2, STRONGEST_MPS2)
    return np.where(speed < STANDING_MPS, 0.0, habit)


def _foreseen(speed: FloatArray, slows: FloatArray, time_s: float) -> FloatArray:
    """Return (n,) speeds of leaders that go on slowing down for a time, m/s."""
    lead: FloatArray = np.maximum(speed + slows * time_s, np.minimum(speed, 0.0))
    return lead


def _rows_of(history: SceneHistory, who: VehicleIndex, leaders: Leaders) -> IntArray:
    """Return (n,) rows of leaders in `who`; -1 for others."""
    rows = np.full(history.now.shape, -1)
    rows[who.child, who.vehicle] = np.arange(len(who))
    vehicle = (leaders.index >= 0) & (leaders.index < history.scene.vehicles)
    return np.where(vehicle, rows[who.child, np.where(vehicle, leaders.index, 0)], -1)


def _leader_acceleration(history: SceneHistory, who: VehicleIndex, leaders: Leaders) -> FloatArray:
    """(n,) present acceleration of leaders, m/s²; 0 for pedestrians and cyclists."""
    result, steps = np.zeros(len(who)), 3 if history.step else HABIT_STEPS
    k = np.flatnonzero((leaders.index >= 0) & (leaders.index < history.scene.vehicles))
    speed = history.states.speed[who.child[k], leaders.index[k]]
    result[k] = (speed[:, -1] - speed[:, -1 - steps]) / (steps * STEP_S)
    return result


def effective_headway(speed: FloatArray, leaders: Leaders, drivers: Drivers) -> FloatArray:
    """Return (n,) headways, s; behind a new leader at most the present one."""
    there = (leaders.gap - CALIBRATED.minimum_gap) / np.maximum(speed, 1.0)
    limit = np.where(leaders.index == drivers.leader, np.inf, np.maximum(KEPT_SHARE * there, HEADWAY_S[0]))
    return np.minimum(drivers.headway, limit)


def _acceleration(
    history: SceneHistory,
    who: VehicleIndex,
    paths: SeedPaths,
    row: IntArray,
    leaders: Leaders,
    drivers: Drivers,
    waits: FloatArray,
    habit_s: float,
    aware: BoolArray,
) -> Accelerate:
    """Return the acceleration of drawn drivers for `drive`; `aware` (n, H) of their leaders."""
    wished = desired_speeds(paths, CALIBRATED.speed, CALIBRATED.speed_factor)
    curves = curve_speeds(paths, CALIBRATED.curve_acceleration, CALIBRATED.curve_deceleration)
    first, last = row * paths.samples, paths.samples - 1
    ahead = REAR_AXLE_SHARE * history.scene.length[who.vehicle]
    shown = last_second(history.scene)
    motion = (shown.speed[who.vehicle], shown.acceleration[who.vehicle])
    stood = motion[0] < STANDING_MPS
    headway = effective_headway(history.states.speed[who.child, who.vehicle, -1], leaders, drivers)
    profile = IdmParameters.of(CALIBRATED, time_headway=headway, comfort_deceleration=drivers.braking)
    away = leaders.gap + np.where(leaders.index == drivers.leader, drivers.slack, 0.0)
    crawl = np.where(stood, np.minimum(motion[0] * drivers.crawl, STANDING_MPS), 0.0)
    # It brakes until it stands; from then on, it waits as others do that stand.
    stops = np.isfinite(drivers.stop_s) & (history.step * STEP_S < drivers.stop_s)
    no_gap = np.full_like(away, np.inf)
    # Nobody follows at such a headway: it is a trailer, or a box is too long.
    tow, there = np.minimum(drivers.gap, 1e3), np.minimum(leaders.gap, 1e3)
    towed = (leaders.index == drivers.leader) & (tow < TOWED_S * motion[0]) & (motion[0] > TOWED_MPS)
    towed &= np.abs(drivers.opening) < TOWED_OPENING_MPS
    pulled = _leader_acceleration(history, who, leaders)
    begun = np.where(stood, np.maximum(pulled, 0.0), 0.0)  # starting in a queue, drivers expect this to go on
    # A driver foresees that a leader goes on slowing down, as far as that is not noise.
    slows = np.minimum(pulled, 0.0) * shown.calm[np.clip(leaders.index, 0, history.scene.vehicles - 1)]
    pullers = _rows_of(history, who, leaders)
    follower = np.flatnonzero(towed & (pullers >= 0))
    puller = pullers[follower]

    def at(s: FloatArray) -> IntArray:
        return first + clipped((s + ahead) * (1 / DS_M), 0.0, last).astype(np.int64)

    def accelerate(step: int, v: FloatArray, travelled: FloatArray, s: FloatArray) -> FloatArray:
        time_s = (history.step + step) * STEP_S
        limit = wished[at(s)]
        # The motion of a standing vehicle is no habit.
        desired = np.where(stood, limit, desired_speed(CALIBRATED, limit, v, *motion, time_s))
        gap = away + (leaders.speed + begun * step * STEP_S / 2) * step * STEP_S - travelled
        lead = _foreseen(leaders.speed, slows, step * STEP_S + ANTICIPATION_S)
        gap = gap + (lead - leaders.speed) * step * STEP_S / 2
        gap_to_tow = there + (leaders.speed + pulled * step * STEP_S / 2) * step * STEP_S - travelled
        curve = curves[at(s + v * CURVE_TIME_S)]
        demanded = demanded_acceleration(profile, v, desired, gap, lead, curve)
        alone = demanded_acceleration(profile, v, desired, no_gap, leaders.speed, curve)
        sees = aware[:, step]
        demanded = np.where(sees, demanded, alone)
        more = np.where(waits > 0, 0.0, drivers.additional @ node_shares(time_s))
        more = np.where(more > 0, more * clipped(1 + demanded / RELIEF_MPS2, 0.0, 1.0), more)
        demanded = demanded + drivers.habit * np.exp(-time_s / habit_s)
        demanded = demanded + drivers.sudden * np.exp(-time_s / SUDDEN_S)
        still = clipped((crawl - v) / CRAWL_S, -STRONGEST_MPS2, STRONGEST_MPS2)
        still = np.minimum(still, np.where(gap < QUEUE_GAP_M, -v / CRAWL_S, np.inf))
        a = clipped(
            demanded + more,
            HARDEST_MPS2,
            np.where(sees | (v < leaders.speed) | (gap > FAR_M), STRONGEST_MPS2, 0.0),
        )
        a = np.where(stops, np.minimum(a, -motion[0] / drivers.stop_s), a)
        a = np.where(towed, pulled + 2 * (leaders.speed + pulled * step * STEP_S - v) + gap_to_tow - tow, a)
        apart = (there - tow - travelled)[follower] + travelled[puller]
        a[follower] = a[puller] + 2 * (v[puller] - v[follower]) + apart
        return np.where(waits > step * STEP_S, still, a)

    return accelerate
