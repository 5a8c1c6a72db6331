"""Lights inferred where the map has some and nobody recorded them: from who stands and who drives.

A signal group has one state in a future, so that a queue starts together or not at all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse.csgraph import connected_components

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.driving.paths import SeedPaths
from scex_sumo.geometry.polylines import heading, turn
from scex_sumo.road_rules import Rules
from scex_sumo.rules.passages import STANDS_MPS, Lit, ruled_ways, straight_traffic
from scex_sumo.scene import STEP_S, SceneHistory, SeedScene

SURE = 4.0  # log odds of green for a vehicle that drives in, of red for one that stands first at the line
LIKELY = 2.0  # the same for one that brakes for the line
NEAR_M, AT_LINE_M = 40.0, 8.0
DRIVES_MPS, GOES_MPS2 = 3.0, 2.5  # a vehicle that would have to brake harder drives in
ONCOMING_RAD = 2.4  # oncoming groups may be green together: left turns give way
YELLOW_S, CLEARED_S = 3.0, 2.0  # before the other groups of the junction become green


def is_unknown(rules: Rules) -> BoolArray:
    """Return (G,) whether the states of signal groups are unknown."""
    return np.array([not signal.letters for signal in rules.signals], dtype=np.bool_)


def expected_lights(history: SceneHistory, paths: SeedPaths, rules: Rules) -> Lit:
    """Return the most probable lights, the same in all futures; without evidence a light counts as none."""
    lit, odds = Lit.at(rules, history.step * STEP_S), evidence(history.scene, paths, rules)
    green = _greedy(odds[None], clashes(rules), odds[None] > 0)
    held = (odds < 0) | (green @ clashes(rules))[0]
    return _with(lit, is_unknown(rules), red=held[None], yellow=np.zeros_like(green), green=green)


def drawn_lights(
    history: SceneHistory, paths: SeedPaths, rules: Rules, noise: FloatArray, change_s: FloatArray
) -> Lit:
    """Return lights drawn for each future, with logistic noise (C, G) beside the evidence.

    ``change_s`` (C, G): times at which the other groups of a junction become green; the first one counts.
    """
    odds, clash, time_s = evidence(history.scene, paths, rules), clashes(rules), history.step * STEP_S
    score = odds + noise
    first = _greedy(score, clash, score > 0)
    second = _greedy(np.where(first, -np.inf, score), clash, ~first)
    count, junction = connected_components(clash, directed=False)
    change = change_s[:, [int(np.flatnonzero(junction == k)[0]) for k in range(count)]][:, junction]
    drives = np.isin(junction, junction[odds >= SURE])
    change = np.where(drives, np.maximum(change, YELLOW_S + CLEARED_S), change)
    ends = change - YELLOW_S - CLEARED_S
    yellow = first & (time_s >= ends) & (time_s < ends + YELLOW_S)
    green = (first & (time_s < ends)) | (second & (time_s >= change))
    lit = _with(Lit.at(rules, time_s), is_unknown(rules), red=~green & ~yellow, yellow=yellow, green=green)
    since = np.where(yellow, time_s - ends, np.where(green & second, time_s - change, 10.0))
    shown = np.broadcast_to(lit.since_s, lit.red.shape).copy()
    shown[:, :-1] = np.where(is_unknown(rules), since, shown[:, :-1])
    return replace(lit, since_s=shown)


def _with(lit: Lit, unknown: BoolArray, **states: BoolArray) -> Lit:
    """Return lights whose unknown ones have states (C, G)."""
    changed = {}
    for name, values in states.items():
        known = np.broadcast_to(getattr(lit, name), (len(values), len(unknown) + 1)).copy()
        known[:, :-1] = np.where(unknown, values, known[:, :-1])
        changed[name] = known
    return replace(lit, **changed)


def _greedy(score: FloatArray, clash: BoolArray, allowed: BoolArray) -> BoolArray:
    """Return (C, G) groups that are green together, those with the highest scores first."""
    green = np.zeros(score.shape, dtype=np.bool_)
    futures = np.arange(len(score))
    for group in np.argsort(-score, axis=1, kind="stable").T:
        green[futures, group] = ~(clash[group] & green).any(axis=1) & allowed[futures, group]
    return green


@owner_cache
def clashes(rules: Rules) -> BoolArray:
    """Return (G, G) whether two groups may not be green together."""
    clash = np.zeros((len(rules.signals),) * 2, dtype=np.bool_)
    for one in rules.passages:
        for other in (rules.passages[k] for k in one.yields_to):
            opposed = abs(turn(heading(one.line, end=False), heading(other.line, end=False))) > ONCOMING_RAD
            if min(one.signal, other.signal) >= 0 and one.signal != other.signal and not opposed:
                clash[one.signal, other.signal] = clash[other.signal, one.signal] = True
    return clash


@owner_cache
def evidence(scene: SeedScene, paths: SeedPaths, rules: Rules) -> FloatArray:
    """Return (G,) log odds of green from the vehicles of the seed scene on their straightest paths."""
    ruled, traffic = ruled_ways(paths, rules), straight_traffic(SceneHistory.of_scene(scene), paths)
    odds = np.zeros(len(rules.signals))
    for v, path in enumerate((paths.first + paths.straight).tolist()):
        front, rear, speed = (float(a[0, v]) for a in (traffic.front, traffic.rear, traffic.speed))
        for entry in range(int(ruled.first[path]), int(ruled.first[path + 1])):
            gap, group = float(ruled.stop[entry]) - front, int(ruled.signal[entry])
            if group < 0 or gap > NEAR_M or rear > ruled.end[entry]:
                continue
            odds[group] += _says(gap, speed, float(traffic.gained[0, v]))
            break  # only the next passage
    return odds


def _says(gap: float, speed: float, gained: float) -> float:
    """Return what a vehicle says of its light: log odds of green."""
    needed = speed**2 / (2 * max(gap, 0.1))
    if speed > DRIVES_MPS and (gap <= 0 or (needed > GOES_MPS2 and gained > -0.3)):
        return SURE
    if 0 < gap < AT_LINE_M and speed < STANDS_MPS:
        return -SURE
    if gap > 0 and gained < -0.3 and needed > GOES_MPS2 / 4:
        return -LIKELY
    return LIKELY if 0 < gap < AT_LINE_M and gained > 0.3 else 0.0
