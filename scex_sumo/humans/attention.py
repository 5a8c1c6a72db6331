"""Attention: glances away from the road, reaction times, and braking for conflicts as people do.

A driver acts on what it saw one reaction time ago. If it looked away then, it follows no leader and brakes
late. Otherwise it brakes for a conflict as soon as that needs noticeable braking, and as hard as needed. It
keeps clear of boxes beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.special import ndtri

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.driving.beside import offsets_beside
from scex_sumo.behaviors.driving.leaders import Leaders
from scex_sumo.behaviors.driving.motion import REAR_AXLE_SHARE, SLOPE_SPEED, rear_axle
from scex_sumo.behaviors.driving.paths import SeedPaths
from scex_sumo.behaviors.driving.projection import foot_points
from scex_sumo.humans.guard.conflicts import StopLines
from scex_sumo.humans.guard.corridors import SAMPLE_S, GuardProfile, expected
from scex_sumo.humans.guard.guarded import arriving_later, line_motion, needed_braking, retimed
from scex_sumo.humans.population import uniforms
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, States, VehicleIndex

# In everyday driving, drivers look at the road for about 80 % of the time (Morando, Victor, Dozza 2020).
# Durations of glances are lognormal (Taoka 1990). Median and spread are our choice: 3 % last longer than
# 1.7 s, the tail that precedes crashes (Liang, Lee, Horrey 2014).
GLANCE_S, GLANCE_SPREAD = 0.7, 0.48
EVERY_S = 3.9  # one glance begins in each such interval: 20 % of the time are glances
# Response to brake lights: 0.7 s where they are expected, 1.25 s where not (Green 2000).
REACTION_S, REACTION_SPREAD = 0.9, 0.3
ONSET_MPS2, ONSET_SPREAD = 0.8, 0.4  # needed braking from which drivers respond; our choice
# From the corner of the eye, drivers notice a leader that looms, but late (Lamble, Laakso, Summala 1999).
LOOMING_MPS2, LOOMING_S, UNSEEN_S = 3.0, 1.5, 0.8  # the last one for drivers that look away
LOOMING_FACTOR = 1.6  # then they brake harder than needed by this
SAFE_ONSET = 3.0  # factor on the onset for vehicles that are missed with constant velocity and heading
MORE_THAN_NEEDED = 1.2
BESIDE_M = 0.3  # between boxes beside each other
MAX_SLOPE = 0.3  # of the way across over the way along
LOOKS = (0, 3, 6)  # of the samples of expected motion, for vehicles beside
ENTRY_GAP_M = 1.0  # to a vehicle that merges in front
STOP_GAP_M = 0.4  # beyond that of the guard, to a conflict
CREEP_S = 1.0  # time constant of closing a smaller gap
HARDEST_MPS2 = 8.0
MERGING_MPS2, MERGING_MPS = 3.0, 2.0  # for vehicles about as fast that merge in front: both make room
GENTLE_MPS2 = 2.0  # for vehicles beside that are missed with constant velocity and heading
# A driver whose leader asks for more looks ahead (Tijerina et al. 2004); the figure is our choice.
CALM_MPS2 = 0.3
MIN_GAP_M = 0.5
GLANCE, MANNER = 100_000, 90_000  # salts of draws, beyond those of all steps; glances may begin before 0 s
PROFILE = GuardProfile(
    comfort_deceleration=4.0,
    reaction_time=0.5,
    minimum_gap=0.3,
    margin=0.15,
    alongside_margin=0.05,
    time_margin=0.3,
    touching=1e-3,
    contact_time=2.4,
    braking_margin=0.3,
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Attention:
    """Attention of n drivers during a plan."""

    aware: BoolArray  # (n, H) whether the driver acts on the others in a step
    onset: FloatArray  # (n,) needed braking from which it responds, m/s²


def attention_of(
    history: SceneHistory, who: VehicleIndex, leaders: Leaders, factor: float, spread: float
) -> Attention:
    """Draw the attention of drivers; it follows from `SceneHistory.route_draw` and the time alone.

    A driver that was closing in on its leader a second ago does not look away.

    Args:
        factor: on the share of time of glances.
        spread: on the variation between drivers.
    """
    draw = history.route_draw[who.child, who.vehicle]
    manner = ndtri(uniforms(draw, 2, MANNER))
    reaction = REACTION_S * np.exp(REACTION_SPREAD * spread * manner[:, 0])
    seen = STEP_S * np.arange(history.step, history.step + PLAN_STEPS) - reaction[:, None]
    aware = ~looks_away(draw, seen, factor) | (_closed_in(history, who, leaders) > CALM_MPS2)[:, None]
    return Attention(aware=aware, onset=ONSET_MPS2 * np.exp(ONSET_SPREAD * spread * manner[:, 1]))


def _closed_in(history: SceneHistory, who: VehicleIndex, leaders: Leaders) -> FloatArray:
    """(n,) braking that the leader asked for a second ago, m/s²."""
    speed = history.states.speed[who.child, who.vehicle]
    vehicle = np.flatnonzero((leaders.index >= 0) & (leaders.index < history.scene.vehicles))
    before = np.repeat(leaders.speed[:, None], speed.shape[1], axis=1)
    before[vehicle] = history.states.speed[who.child[vehicle], leaders.index[vehicle]]
    gap = leaders.gap + STEP_S * (speed[:, 1:] - before[:, 1:]).sum(axis=1)
    closing = np.maximum(speed[:, 0] - before[:, 0], 0.0)
    return np.asarray(closing**2 / (2 * np.maximum(gap, MIN_GAP_M)))


def looks_away(draw: FloatArray, time_s: FloatArray, factor: float = 1.0) -> BoolArray:
    """(n, T) whether drivers look away from the road.

    One glance begins at a random time in each interval of `EVERY_S`, also before the seed moment.

    Args:
        draw: (n,) in [0, 1), one per driver.
        time_s: (n, T) since the seed moment.
        factor: on the rate of glances, up to 1, or on their durations beyond it.
    """
    away = np.zeros(time_s.shape, dtype=np.bool_)
    if not factor or not time_s.size:
        return away
    first, last = (int(np.floor(edge / EVERY_S)) for edge in (time_s.min(), time_s.max()))
    for number in range(first - 1, last + 1):
        begin, length, there = uniforms(draw, 3, GLANCE + number).T
        start = EVERY_S * (number + begin)
        lasts = GLANCE_S * max(factor, 1.0) * np.exp(GLANCE_SPREAD * ndtri(length))
        lasts = np.where(there < factor, lasts, 0.0)
        away |= (time_s >= start[:, None]) & (time_s < (start + lasts)[:, None])
    return away


def respond(plan: Plan, history: SceneHistory, road: Road, who: VehicleIndex, attention: Attention) -> Plan:
    """Return plans (n, H) slowed down for conflicts while their drivers are aware of them."""
    return retimed(plan, history, road, who, PROFILE, partial(_bounds, attention=attention))


def _bounds(
    holds: StopLines, first: IntArray, step: int, s: FloatArray, v: FloatArray, *, attention: Attention
) -> FloatArray:
    """Return the highest speed after a step of each vehicle with a stop line, m/s; see `Bounds`."""
    t = step * STEP_S
    needed = needed_braking(holds, t, s + STOP_GAP_M, v, ENTRY_GAP_M)
    # It is enough to arrive after one that crosses has left.
    k = np.flatnonzero((holds.speed == 0) & np.isfinite(holds.until))
    left, way = np.maximum(holds.until[k] - t, STEP_S), holds.position[k] - s[k] - STOP_GAP_M
    needed[k] = np.minimum(needed[k], arriving_later(way, left, v[k]))
    most = np.where(holds.firm, HARDEST_MPS2, PROFILE.yield_deceleration)
    most = np.where(holds.safe & (holds.position < s), GENTLE_MPS2, most)
    merges = (holds.enter > t) & (holds.speed > 0) & (v - holds.speed < MERGING_MPS)
    most = np.where(merges, np.minimum(most, MERGING_MPS2), most)
    onset = np.where(holds.safe, SAFE_ONSET, 1.0) * attention.onset[holds.row]
    aware = attention.aware[holds.row, step]
    onset = np.where(aware, onset, np.maximum(onset, LOOMING_MPS2))
    position, leader = line_motion(holds, t)
    time_s = np.where(aware, LOOMING_S, UNSEEN_S)
    looms = (position - s < time_s * (v - leader)) & (holds.enter <= t) & ~holds.safe
    onset = np.where(looms, 0.0, onset)
    braking = np.minimum(np.where(looms, LOOMING_FACTOR, MORE_THAN_NEEDED) * needed, most)
    acts = (needed > onset) & (holds.until > t)
    allowed = np.where(acts, v - braking * STEP_S, np.inf)
    gap = position - s
    close = (gap >= 0) & (gap < STOP_GAP_M) & (holds.enter <= t) & (holds.until > t)
    creeps = np.maximum(leader + gap / CREEP_S, v - HARDEST_MPS2 * STEP_S)
    allowed = np.where(close, np.minimum(allowed, creeps), allowed)
    lowest: FloatArray = np.minimum.reduceat(allowed, first)
    return lowest


def kept_clear(
    aside: FloatArray,
    history: SceneHistory,
    road: Road,
    who: VehicleIndex,
    paths: SeedPaths,
    row: IntArray,
    s: FloatArray,
) -> FloatArray:
    """Return wanted offsets (n, H + 1) of rear axles that keep the bodies within the room to boxes beside.

    The front of a long vehicle reaches further to the side than its rear axle, which follows it.
    """
    around = expected(history, road)
    states = [
        States(
            x=around.x[..., k],
            y=around.y[..., k],
            heading=around.heading[..., k],
            speed=around.others.states.speed,
        )
        for k in LOOKS
    ]
    time = STEP_S * np.arange(aside.shape[1])
    way = np.maximum(history.now[who.child, who.vehicle].speed, 0.0)[:, None] * time
    least, most = offsets_beside(
        history, who, paths, row, s, way, margin=BESIDE_M, later=(SAMPLE_S * np.array(LOOKS), states)
    )
    narrow = least > most
    middle = np.where(narrow, least, 0.0) / 2 + np.where(narrow, most, 0.0) / 2
    least, most = np.where(narrow, middle, least), np.where(narrow, middle, most)
    moved = np.maximum(np.diff(way, axis=1), SLOPE_SPEED * STEP_S)
    slope = np.clip(np.diff(aside, axis=1) / moved, -MAX_SLOPE, MAX_SLOPE)
    length = history.scene.length[who.vehicle]
    reach = (0.5 + REAR_AXLE_SHARE) * length
    front = aside[:, 1:] + reach[:, None] * slope
    held = np.clip(front, least[:, 1:], most[:, 1:])
    k = np.flatnonzero((held != front).any(axis=1))
    x, y = rear_axle(history.now[who.child[k], who.vehicle[k]], length[k])
    kept = aside.copy()
    kept[k, 0] = foot_points(paths, row[k], x, y, (s - REAR_AXLE_SHARE * length)[k])[1]
    follows = 1 - np.exp(-moved[k] / reach[k, None])
    for step in range(held.shape[1]):
        kept[k, step + 1] = kept[k, step] + (held[k, step] - kept[k, step]) * follows[:, step]
    return kept
