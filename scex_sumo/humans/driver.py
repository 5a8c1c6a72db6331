"""Human-like driver: one per vehicle and future, drawn from a population fitted to recordings.

It follows leaders with its own headway and acceleration (`terms`), and has its own place in the lane, path,
start from standing and attention. All draws follow from `SceneHistory.route_draw` and the last second before
the seed scene, so all plans of a future have the same driver.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.draws import normal_quantiles, uniforms
from scex_sumo.base.errors import UsageError
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.base import PLAN_STEPS, Driver, check_path, check_positive
from scex_sumo.behaviors.driving.leaders import Leaders
from scex_sumo.behaviors.driving.motion import CURVE_TIME_S, REAR_AXLE_SHARE, Accelerate, curve_speeds, drive
from scex_sumo.behaviors.driving.paths import PathChoice, SeedPaths, chosen_paths, path_positions
from scex_sumo.behaviors.models.idm import desired_speeds
from scex_sumo.behaviors.spec import ModelEntry
from scex_sumo.humans.attention import awareness, kept_clear, still_unaware, unchanged
from scex_sumo.humans.guard.guarded import yielding
from scex_sumo.humans.lines.driven_line import redrawn
from scex_sumo.humans.lines.lanes import change_offsets, change_shares, lanes_beside
from scex_sumo.humans.observed.observations import (
    LEADER_MOVES,
    View,
    behind_a_wave,
    keep_features,
    kept_headway,
    leaders_of,
    offset_limits,
    path_edges,
    place_features,
    queue_leaders,
    start_features,
)
from scex_sumo.humans.observed.seed_state import estimated_history
from scex_sumo.humans.parameters import SUMO_ACCELERATION_MPS2, HumanParameters, human_parameters, simulated
from scex_sumo.humans.terms import (
    Drivers,
    Situation,
    acceleration,
    demanded,
    drawn_variation,
    lateral_offsets,
    students,
)
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, SeedScene, VehicleIndex

if TYPE_CHECKING:
    from scex_sumo.rules.holds import Obeyed

MAX_SPREAD = 100
DRIVER, PATH, STARTS, START = 0, 7, 8, 10  # salts of draws; each plan has its own start


@dataclass(frozen=True, kw_only=True)
class LikelyProfile:
    """Parameters of `LikelyDriver`.

    Attributes:
        spread: factor on the variation between drivers; 1 as recorded, 0 the expected driver.
        inattention: factor on the time that drivers look away; 1 as observed, 0 never.
        path: index, ``straight`` or ``random``; or ``fitted``: drawn by how well paths fit the motion.
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


class Draws(NamedTuple):
    """Random numbers in [0, 1) of n drivers, the same in all plans of a future."""

    variation: FloatArray  # (n, 4) of accelerations, see `students`
    side: FloatArray  # (n, 3) of the place in the lane
    headway: FloatArray  # (n,)
    crawl: FloatArray  # (n,) speed of one that stands
    change: FloatArray  # (n,) of lanes
    pull: FloatArray  # (n,) acceleration from standing

    @classmethod
    def of(cls, route_draw: FloatArray) -> Draws:
        """Draw for drivers by their `SceneHistory.route_draw` (n,)."""
        drawn = uniforms(route_draw, 11, DRIVER)
        return cls(drawn[:, :4], drawn[:, 4:7], *drawn[:, 7:].T)


class LikelyDriver(Driver):
    """A random driver for every vehicle of every future."""

    def __init__(self, profile: LikelyProfile) -> None:
        self.profile = profile

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Plan 3 s; see `BatchBehavior.plan`."""
        history = estimated_history(history, road)
        paths, row = self._paths(history, road, vehicles)
        s, _, _ = path_positions(history, vehicles, paths, row)
        view = View(history, vehicles, paths, row, s, human_of(history.scene))
        draws = Draws.of(history.route_draw[vehicles.future, vehicles.vehicle])
        drivers, offsets = self._drivers(view, draws), self._offsets(view, road, draws)
        leaders, obeyed = leaders_of(view, offsets[:, 0]), self._obeyed(view, road)
        aware = awareness(view, leaders, self.profile.inattention)
        waits_s = self._waits(view, leaders, obeyed)
        hold = np.inf if obeyed is None else obeyed.hold
        unaware = still_unaware(history, paths, vehicles, self.profile.spread)
        accelerate = accelerations(view, drivers, leaders, aware=aware, waits_s=waits_s, hold=hold)
        accelerate, aside = unchanged(accelerate, unaware), kept_clear(offsets, view)
        plan = drive(history, vehicles, paths, row, accelerate, aside=aside, parallel=True)
        yielded = yielding(plan, history, road, vehicles, view.human, aware)
        yielded.assign(unaware, plan[unaware])
        return yielded

    def _paths(self, history: SceneHistory, road: Road, vehicles: VehicleIndex) -> tuple[SeedPaths, IntArray]:
        if self.profile.path != "fitted":
            return chosen_paths(history, road, vehicles, self.profile.path, redraw=redrawn)  # type: ignore[arg-type]
        paths, _ = chosen_paths(history, road, vehicles, 0, redraw=redrawn)
        edges = path_edges(history.scene, paths, human_of(history.scene))
        draw = uniforms(history.route_draw[vehicles.future, vehicles.vehicle], 1, PATH)[:, 0]
        return paths, paths.drawn(vehicles.vehicle, draw, edges)

    def _obeyed(self, view: View, road: Road) -> Obeyed | None:
        """Return what rules ask of drivers; None without rules."""
        history = view.history
        if history.scene.rules is None:
            return None
        from scex_sumo.humans.obedience import obedience

        _, rows = self._paths(history, road, VehicleIndex.everyone(history))
        return obedience(view, rows.reshape(history.now.shape), self.profile.spread)

    def _drivers(self, view: View, draws: Draws) -> Drivers:
        human, spread, observed, row = view.human, self.profile.spread, view.observed, view.row
        shown, vehicle = view.shown, view.vehicles.vehicle
        speed = shown.speed[vehicle]
        mean, deviation = human.headway_log
        headway = np.exp(mean + spread * deviation * normal_quantiles(draws.headway))
        crawl = speed * (1 + np.minimum(spread, 1.0) * (2 * draws.crawl - 1))
        pull = np.exp(spread * human.pull_spread * normal_quantiles(draws.pull))
        stands = speed < human.standing_mps
        share, top = vehicle_types(view.scene)[vehicle].T
        normal = spread * students(draws.variation)
        shows = speed, observed.mean_features[row], observed.spread_features[row]
        drivers = Drivers(
            speed=speed,
            acceleration=shown.acceleration[vehicle],
            headway=np.minimum(np.minimum(headway, human.most_headway_s), observed.headway[row]),
            rest=np.clip(observed.gap[row], 0.0, human.rest_m),
            sudden=shown.sudden[vehicle],
            variation=share[:, None] * drawn_variation(*shows, normal, human),
            crawl=np.where(stands, np.minimum(crawl, human.standing_mps), 0.0),
            limit=np.minimum(observed.limit[row], top),
            pull=np.where(stands, pull, 1.0) * share,
            top=top,
        )
        return replace(drivers, habit=shown_habit(view, drivers))

    def _offsets(self, view: View, road: Road, draws: Draws) -> FloatArray:
        """Return (n, 31) wanted offsets from the path now and after each step, m, left positive."""
        human, spread, step = view.human, self.profile.spread, view.history.step
        deviation = spread * students(draws.side)[:, 0]
        choice = draws.change if spread else np.full(len(draws.change), 0.5)
        left, right = change_shares(view.scene, road, view.paths, human)[view.row].T
        lateral = view.observed.lateral[view.row]
        beside = lanes_beside(view.scene, road, view.paths, human)[view.row]
        changes = change_offsets(lateral, beside, human) + human.change_scale_m * deviation[:, None]
        changes = np.clip(changes, -human.max_change_m, human.max_change_m)
        keeps = np.where(choice > 1 - right, changes[:, 1], lane_offsets(view, deviation))
        time_s = np.arange(step, step + PLAN_STEPS + 1, dtype=np.float64) * STEP_S
        return lateral_offsets(lateral, np.where(choice < left, changes[:, 0], keeps), time_s, human)

    def _waits(self, view: View, leaders: Leaders, obeyed: Obeyed | None) -> FloatArray:
        """Return (n,) s for which vehicles stand from now on."""
        human, history, vehicles = view.human, view.history, view.vehicles
        speed = history.states.speed[vehicles.future, vehicles.vehicle]
        now, before = speed[:, -1], speed[:, -2] if history.step else speed[:, -1]
        stands = (now < human.standing_mps) & (now - before < human.starting_mps)
        route = history.route_draw[vehicles.future, vehicles.vehicle]
        starts, draw = uniforms(route, 1, STARTS)[:, 0], uniforms(route, 1, START + history.step)[:, 0]
        if self.profile.spread == 0:
            starts, draw = np.full_like(draw, 0.5), np.full_like(draw, 0.5)
        queue = queue_leaders(history.scene, view.paths, human)
        wave = behind_a_wave(history.now.speed, leaders, vehicles.future, queue, human)
        features = start_features(now, leaders.gap, leaders.speed, wave, human)
        rate = np.exp(features @ human.start_weights)
        # The fitted rate says how many start soon; those that do follow the wave.
        # Waiting has no memory: draws of successive plans give one exponential time in all.
        soon = starts < 1 - np.exp(-rate * human.start_within_s)
        waits_s = np.where(stands, np.where(soon, -human.start_wave_s * np.log(draw), np.inf), 0.0)
        if obeyed is None:
            return waits_s
        from scex_sumo.humans.obedience import waits_for

        near, moves = leaders.gap < human.queue_m, features[:, LEADER_MOVES] > 0
        return waits_for(obeyed, view, waits_s, np.where(near, moves, obeyed.released))


def human_of(scene: SeedScene) -> HumanParameters:
    """Return the parameters of the drivers of a scene."""
    return simulated(human_parameters()) if scene.intentions else human_parameters()


@owner_cache
def vehicle_types(scene: SeedScene) -> FloatArray:
    """Return (V, 2) accelerations over those of SUMO's default type, and speeds that vehicles reach, m/s."""
    types = [{} if known is None else known.parameters for known in scene.intentions]
    types = types or [{}] * scene.vehicles
    most = [float(given.get("accel", SUMO_ACCELERATION_MPS2)) / SUMO_ACCELERATION_MPS2 for given in types]
    return np.column_stack([most, [float(given.get("maxSpeed", np.inf)) for given in types]])


def lane_offsets(view: View, deviation: FloatArray) -> FloatArray:
    """Return (n,) offsets from the path after 3 s without a lane change, m, by Student's draws (n,)."""
    human, vehicle, observed = view.human, view.vehicles.vehicle, view.observed
    lateral, bends, room = (values[view.row] for values in (observed.lateral, observed.bends, observed.room))
    spread = np.exp(keep_features(view.shown.speed[vehicle], bends, room, human) @ human.keep_growth)
    leftmost, rightmost = np.maximum(offset_limits(room[:, 1], human), np.abs(lateral[:, :1])).T
    keeps = place_features(lateral, bends, room) @ human.keep_weights
    keeps = np.clip(keeps + human.keep_scale_m * spread * deviation, -rightmost, leftmost)
    # Off the mapped lanes there is no lane to return to: the turn goes on.
    turn = lateral @ np.array([1.0, human.lateral_s, human.lateral_s**2 / 2])
    goes_on: FloatArray = np.clip(turn, -human.max_turning_m, human.max_turning_m)
    return np.where(view.paths.on_road[vehicle], keeps, goes_on)


def shown_habit(view: View, drivers: Drivers) -> FloatArray:
    """Return (n,) lasting shown accelerations beyond the demanded ones in the seed scene, m/s²."""
    human, observed, row = view.human, view.observed, view.row
    now = Situation(
        driver=drivers,
        speed=drivers.speed,
        limit=observed.limit[row],
        headway=drivers.headway,
        curve_speed=observed.curve[row],
        gap=observed.gap[row],
        leader_speed=observed.leader_speed[row],
    )
    asked = np.clip(demanded(now, human), -human.max_braking_mps2, human.max_acceleration_mps2)
    trust = view.shown.trust[view.vehicles.vehicle]
    return np.where(drivers.speed < human.standing_mps, 0.0, drivers.acceleration - trust * asked)


def accelerations(
    view: View,
    drivers: Drivers,
    leaders: Leaders,
    *,
    aware: BoolArray,
    waits_s: FloatArray | float = 0.0,
    hold: FloatArray | float = np.inf,
) -> Accelerate:
    """Return the acceleration of drawn drivers for `drive`; leaders are expected to keep their speed.

    ``aware``: (n, H) whether they act on their leaders; ``waits_s``: (n,) for which standing ones wait;
    ``hold``: (n,) ways to places where rules make them stop, m.
    """
    human, paths, begin_s = view.human, view.paths, view.history.step * STEP_S
    limits = desired_speeds(paths, human.idm.speed, human.idm.speed_factor)
    curves = curve_speeds(paths, human.idm.curve_acceleration, human.idm.curve_deceleration)
    ahead = REAR_AXLE_SHARE * view.scene.length[view.vehicles.vehicle]
    # behind a leader other than in the seed scene at most the present headway
    speed = view.history.now.speed[view.vehicles.future, view.vehicles.vehicle]
    kept = np.minimum(drivers.headway, kept_headway(leaders.gap, speed, human))
    headway = np.where(leaders.index == view.observed.leader[view.row], drivers.headway, kept)

    def at(s: FloatArray) -> IntArray:
        return paths.sample_at(view.row, s + ahead)

    def accelerate(step: int, v: FloatArray, travelled: FloatArray, s: FloatArray) -> FloatArray:
        now = Situation(
            driver=drivers,
            speed=v,
            limit=np.minimum(limits[at(s)], drivers.top),
            headway=headway,
            curve_speed=curves[at(s + v * CURVE_TIME_S)],
            gap=leaders.gap + leaders.speed * (step * STEP_S) - travelled,
            leader_speed=leaders.speed,
            hold=hold - travelled,
            aware=aware[:, step],
            waits=np.asarray(waits_s > step * STEP_S),
            time_s=begin_s + step * STEP_S,
        )
        return acceleration(now, human)

    return accelerate


LIKELY_DRIVER = ModelEntry(
    make=LikelyDriver,
    profile=LikelyProfile(),
    summary="a driver drawn for every vehicle and future, as people were recorded",
    path_words=("fitted",),
    may_fail=False,
    is_own=False,
    place=40,
)
