"""Holds: how far drivers may go by lights, priority and crosswalks, from the states of all vehicles.

Critical headways: Highway Capacity Manual, 7th edition (TRB 2022): 4.5 s for a permitted left turn at a light
(chapter 31), 6.5 s for a minor street that crosses (chapter 20), 5.0 s for the entry of a roundabout (chapter
22), which counts for all merging.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.driving.paths import OnPath, SeedPaths, seed_paths
from scex_sumo.road import Road
from scex_sumo.rules.passages import (
    NO_SIGN,
    STANDS_MPS,
    Lit,
    RuledWays,
    Traffic,
    ruled_ways,
    straight_traffic,
)
from scex_sumo.scene import STEP_S, SceneHistory, SeedScene, VehicleIndex

REACH_M = 100.0  # holds further ahead count later
PASSED_M = 0.5  # a front that is so far beyond a line has passed it,
CREPT_M = 3.0  # unless the vehicle stands: it waits
BEFORE_ZONE_M = 1.0  # of a conflict, for a vehicle that waits within the junction
AT_LINE_M = 4.0  # a vehicle that stands so near before a line waits at it
FIRST_M = 10.0  # a vehicle that stands so near before an open line, with nobody ahead, starts
GAIN_MPS = 0.3  # a vehicle that gained or lost so much speed in three steps goes or brakes
SLOW_MPS, GOES_MPS2 = 6.0, 1.0  # a slower vehicle that gains speed with so little room to stop goes on
START_MPS2 = 1.5  # acceleration of a vehicle that goes
COMING_MPS2 = 3.0  # a vehicle that would brake harder than this does not stop at its red light
GOING_MPS = 5.0  # least speed of a vehicle that goes, after it has started
LONG_RED_S, HARDEST_MPS2 = 3.0, 9.0  # nobody hopes to pass so long after red begins: all brake as they can
CLEAR_S = 1.0  # between a vehicle that leaves a conflict and the next one
PERMITTED_S, CROSSING_S, MERGING_S = 4.5, 6.5, 5.0  # critical headways
MUST_YIELD, HAS_RED = "must yield", "has red"  # words of `precedence`


@dataclass(frozen=True, kw_only=True, eq=False)
class Manner:
    """How n drivers obey; numbers, or one (n,) for each."""

    lights: FloatArray | bool = True  # whether lights count
    priority: FloatArray | bool = True  # whether it gives way
    yellow_mps2: FloatArray | float = 3.0  # a driver stops at yellow if that needs no harder braking, and
    yellow_s: FloatArray | float = 0.0  # if it was no nearer to the line, in time, when yellow began
    red_mps2: FloatArray | float = 9.0  # the same as the braking for yellow
    red_delay_s: FloatArray | float = 0.0  # time for which red counts as yellow
    gaps: FloatArray | float = 1.0  # factor on critical headways
    priority_mps2: FloatArray | float = 4.0  # a driver gives way if that needs no harder braking
    stands_mps: FloatArray | float = STANDS_MPS  # below it a driver has stopped at a stop sign
    ready: bool = False  # whether a driver that stands or is slow goes at red and yellow


def lights(history: SceneHistory, paths: SeedPaths) -> Lit:
    """Return the lights now, the most probable ones where they are unknown."""
    rules = history.scene.rules
    assert rules is not None
    if all(signal.letters for signal in rules.signals):
        return Lit.at(rules, history.step * STEP_S)
    from scex_sumo.rules.inferred import expected_lights

    return expected_lights(history, paths, rules)


class Obeyed(NamedTuple):
    """What rules ask of n drivers."""

    hold: FloatArray  # way of the front to the next place where a driver has to stop, m; inf without
    # whether it may enter the passage that it is at: a light shows green, or all others leave it time, and
    # it has to stop nowhere near behind the line
    released: BoolArray


def obeyed(on: OnPath, traffic: Traffic, manner: Manner, lit: Lit) -> Obeyed:
    """Return what the rules of the scene ask of n drivers, with traffic of all and lights now."""
    history, vehicles, paths, row = on
    rules = history.scene.rules
    assert rules is not None
    ruled, me = ruled_ways(paths, rules), _Drivers(vehicles, row, traffic, manner)
    gap, opened = _at_lights(me, ruled, lit)
    gap = np.minimum(gap, _giving_way(me, ruled, traffic, lit))
    gap = np.minimum(gap, _at_crosswalks(me, ruled, history))
    return Obeyed(hold=gap, released=(opened < FIRST_M) & (gap > opened + AT_LINE_M))


class _Drivers:
    """n drivers with their places."""

    def __init__(self, vehicles: VehicleIndex, row: IntArray, traffic: Traffic, manner: Manner) -> None:
        current = vehicles.future, vehicles.vehicle
        self.vehicles, self.row, self.manner = vehicles, row, manner
        self.front, self.speed = traffic.front[current], traffic.speed[current]
        self.stood = traffic.slowest[current] < manner.stands_mps
        self.brakes = traffic.gained[current] < -GAIN_MPS
        self.goes = (traffic.gained[current] > GAIN_MPS) & (self.speed < SLOW_MPS)

    def goes_on(self, driver: IntArray, gap: FloatArray) -> BoolArray:
        """Return (m,) whether drivers have decided to go: they gain speed where others would brake."""
        return np.asarray(self.goes[driver] & (self.needed(driver, gap) > GOES_MPS2))

    def of(self, name: str, driver: IntArray) -> FloatArray:
        """Return a manner of drivers, (m,)."""
        return np.broadcast_to(np.asarray(getattr(self.manner, name)), self.row.shape)[driver]

    def least(self, driver: IntArray, gap: FloatArray, stops: BoolArray) -> FloatArray:
        """Return the smallest gap (n,) of those (m,) at which drivers stop."""
        result = np.full(len(self.row), np.inf)
        np.minimum.at(result, driver[stops], np.maximum(gap[stops], 0.0))
        return result

    def needed(self, driver: IntArray, gap: FloatArray) -> FloatArray:
        """Return braking (m,) to stop within gaps (m,), m/s²; half of it for drivers that brake already."""
        needed = self.speed[driver] ** 2 / (2 * np.maximum(gap, 0.1))
        return np.asarray(np.where(self.brakes[driver], needed / 2, needed))


def _spread(first: IntArray, count: IntArray) -> tuple[IntArray, IntArray]:
    """Return the index of each of n ranges of so many numbers, and the numbers, concatenated."""
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count) + np.repeat(first, count)


def _at_lights(me: _Drivers, ruled: RuledWays, lit: Lit) -> tuple[FloatArray, FloatArray]:
    """Return the ways (n,) to stop for lights and stop signs, and to the next open line; inf without."""
    driver, entry = _spread(ruled.first[me.row], ruled.first[me.row + 1] - ruled.first[me.row])
    gap, light = ruled.stop[entry] - me.front[driver], (me.vehicles.future[driver], ruled.signal[entry])
    stands = me.speed[driver] < STANDS_MPS
    ahead = (gap > np.where(stands, -CREPT_M, -PASSED_M)) & (gap < REACH_M)
    needed, since = me.needed(driver, gap), lit.of("since_s", *light)
    ready = lit.of("ready", *light) & (me.speed[driver] < SLOW_MPS) & me.manner.ready
    red, yellow = lit.of("red", *light) & ~ready, lit.of("yellow", *light)
    early = red & (since < me.of("red_delay_s", driver))
    away_s = gap / np.maximum(me.speed[driver], STANDS_MPS) + since * ~early
    stops = (yellow | early) & (needed <= me.of("yellow_mps2", driver))
    stops &= away_s >= me.of("yellow_s", driver)
    hardest = np.where(since > LONG_RED_S, HARDEST_MPS2, me.of("red_mps2", driver))
    stops |= red & ~early & (needed <= hardest)
    stops &= me.of("lights", driver) != 0
    # A stop sign holds everyone once.
    state = ruled.state[entry]
    sign = lit.of("stop", *light) | ((light[1] < 0) & np.isin(state, ["s", "w"]))
    waited = (me.stood[driver] & (gap < AT_LINE_M)) | me.goes_on(driver, gap)
    sign &= ~waited & (needed <= me.of("priority_mps2", driver))
    stops |= sign & (me.of("priority", driver) != 0)
    opened = ready | lit.of("green", *light) | ((light[1] < 0) & np.isin(state, [*"smw=", NO_SIGN]))
    return me.least(driver, gap, stops & ahead), me.least(driver, gap, opened & ahead)


def _giving_way(me: _Drivers, ruled: RuledWays, traffic: Traffic, lit: Lit) -> FloatArray:
    """Return the ways (n,) to stop for vehicles on passages with priority."""
    driver, pair = _meetings(me, ruled, traffic, lit)
    entry, other, future = ruled.own[pair], ruled.other[pair], me.vehicles.future[driver]
    vehicle, v, gap = ruled.vehicle[ruled.row[other]], me.speed[driver], _way_to_stop(me, ruled, driver, pair)
    front, speed = traffic.front[future, vehicle], traffic.speed[future, vehicle]
    rear, line = traffic.rear[future, vehicle], ruled.stop[other] - front
    coming = speed**2 / (2 * np.maximum(line, 0.1)) > COMING_MPS2
    light = future, ruled.signal[other]
    held = (line > -PASSED_M) & (lit.of("red", *light) | lit.of("yellow", *light)) & ~coming
    held |= ruled.unsigned[entry] & (speed < STANDS_MPS)  # it may see a red light
    arrives = _time(ruled.other_span[pair, 0] - front, speed, speed)
    leaves = _time(ruled.other_span[pair, 1] - rear, speed, speed)
    going = np.maximum(v, GOING_MPS)
    own_arrives = _time(ruled.own_span[pair, 0] - me.front[driver], v, going)
    at_line = np.where(gap < AT_LINE_M, 0.0, _time(gap, v, going))
    critical = np.where(ruled.merges[pair], MERGING_S, CROSSING_S)
    critical = np.where(ruled.signal[entry] >= 0, PERMITTED_S, critical) * me.of("gaps", driver)
    left_before = leaves + CLEAR_S * np.minimum(me.of("gaps", driver), 1.0) < own_arrives
    gone = ruled.other_span[pair, 1] < rear
    gives = ~(held | gone | left_before) & (arrives - at_line < critical)
    stood = (traffic.slowest[future, vehicle] < STANDS_MPS) & (line < AT_LINE_M)
    # Of two that must both give way, the one that stopped first goes first; of two that stand, by number.
    mine = me.stood[driver] & (gap < AT_LINE_M)
    first = np.where(mine == stood, me.vehicles.vehicle[driver] < vehicle, mine)
    first = np.where(~mine & ~stood, gap < line, first) & (line >= -PASSED_M)
    gives &= ~(ruled.mutual[pair] & first)
    gives &= me.needed(driver, gap) <= me.of("priority_mps2", driver)
    gives &= ~me.goes_on(driver, gap)
    return me.least(driver, gap, gives)


def _meetings(me: _Drivers, ruled: RuledWays, traffic: Traffic, lit: Lit) -> tuple[IntArray, IntArray]:
    """Return drivers (m,) and pairs of passages (m,) in which another vehicle takes that with priority."""
    first = np.searchsorted(ruled.own, ruled.first)
    driver, pair = _spread(first[me.row], first[me.row + 1] - first[me.row])
    row = ruled.row[ruled.other[pair]]
    vehicle, gap = ruled.vehicle[row], _way_to_stop(me, ruled, driver, pair)
    counts = (gap > -PASSED_M) & (gap < REACH_M) & (vehicle != me.vehicles.vehicle[driver])
    counts &= traffic.row[me.vehicles.future[driver], vehicle] == row
    counts &= ~lit.of("free", me.vehicles.future[driver], ruled.signal[ruled.own[pair]])
    counts &= me.of("priority", driver) != 0
    return driver[counts], pair[counts]


def _way_to_stop(me: _Drivers, ruled: RuledWays, driver: IntArray, pair: IntArray) -> FloatArray:
    """Return (m,) ways to the lines, m; to the conflict within the junction, and where no line is told."""
    line = ruled.stop[ruled.own[pair]] - me.front[driver]
    zone = ruled.own_span[pair, 0] - BEFORE_ZONE_M - me.front[driver]
    return np.where((line <= -PASSED_M) | ruled.unsigned[ruled.own[pair]], zone, line)


def _time(distance_m: FloatArray, v: FloatArray, most: FloatArray) -> FloatArray:
    """Return (m,) times for a way at a speed, or from near standing with an acceleration, s; 0 if passed."""
    distance_m = np.maximum(distance_m, 0.0)
    starting = (np.sqrt(v**2 + 2 * START_MPS2 * distance_m) - v) / START_MPS2
    return np.where(v > 1.0, distance_m / np.maximum(most, 0.1), starting)


def _at_crosswalks(me: _Drivers, ruled: RuledWays, history: SceneHistory) -> FloatArray:
    """Return the ways (n,) to stop for people on crosswalks, or who step on them."""
    scene = history.scene
    if not len(ruled.walks) or (scene.obstacles is None and scene.people is None):
        return np.full(len(me.row), np.inf)
    from scex_sumo.rules.crosswalks import used_crosswalks

    used = used_crosswalks(history, np.unique(ruled.walks[:, 3].astype(int)))
    walks = ruled.walks[np.asarray(used.any(axis=0))[ruled.walks[:, 3].astype(int)]]
    first = np.searchsorted(walks[:, 0], np.arange(len(ruled.first)))
    driver, walk = _spread(first[me.row], first[me.row + 1] - first[me.row])
    gap = walks[walk, 1] - BEFORE_ZONE_M - me.front[driver]
    stops = used[me.vehicles.future[driver], walks[walk, 3].astype(int)] & (gap > -PASSED_M)
    stops &= (gap < REACH_M) & (me.needed(driver, gap) <= me.of("priority_mps2", driver))
    return me.least(driver, gap, stops & (me.of("priority", driver) != 0))


def precedence(scene: SeedScene, road: Road) -> list[tuple[int, int, str]]:
    """Return (track, other track, what rules say of the first) where straightest paths conflict."""
    rules = scene.rules
    if rules is None:
        return []
    paths, history = seed_paths(scene, road), SceneHistory.of_scene(scene)
    ruled, traffic, lit = ruled_ways(paths, rules), straight_traffic(history, paths), lights(history, paths)
    straight, tracks, rules_of = paths.first + paths.straight, scene.track_ids.tolist(), {}
    for k, (own, other) in enumerate(zip(ruled.own.tolist(), ruled.other.tolist(), strict=True)):
        one, two = (int(ruled.vehicle[ruled.row[entry]]) for entry in (own, other))
        ahead = all(
            straight[v] == ruled.row[entry] and traffic.rear[0, v] < span[k, 1]
            for v, entry, span in ((one, own, ruled.own_span), (two, other, ruled.other_span))
        )
        red = [
            lit.red[0, ruled.signal[entry]] and traffic.front[0, v] < ruled.stop[entry]
            for v, entry in ((one, own), (two, other))
        ]
        if not ahead or one == two or all(red):
            continue
        if red[1]:
            rules_of[two, one] = HAS_RED
        elif red[0] or not (ruled.mutual[k] or lit.free[0, ruled.signal[own]]):
            rules_of[one, two] = HAS_RED if red[0] else MUST_YIELD
    return [(tracks[one], tracks[two], what) for (one, two), what in rules_of.items()]
