"""Conflicts in words: what happens, and how it comes to it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from scex_sumo.geometry.polylines import wrap
from scex_sumo.results.tables.pairs import NARROW
from scex_sumo.scene import STEP_S, SeedScene, States

REAR_END, MERGING, CROSSING, ONCOMING, BESIDE = "rear-end", "merging", "crossing", "oncoming", "beside"
WHAT: Final = (REAR_END, MERGING, CROSSING, ONCOMING, BESIDE, "person")
"""Kinds of conflicts: one follows; ways join, cross, are opposed, or do not touch; with a person."""

_ALONG_RAD, _OPPOSED_RAD, _TURNS_RAD = np.deg2rad(30.0), np.deg2rad(150.0), np.deg2rad(25.0)
_IN_LINE_RAD = np.deg2rad(45.0)
_STANDS_MPS, _STARTS_MPS = 0.5, 1.5
_BRAKES_MPS2, _HARD_MPS2 = -1.5, -4.0
_MEAN_STEPS = 5


def what(scene: SeedScene, one: int, other: int, meets_rad: float, *, person: bool = False) -> str:
    """Return the kind of a conflict, one of `WHAT`.

    Args:
        meets_rad: least angle of both headings where their ways touch; inf where they do not.
    """
    if person:
        return WHAT[-1]
    if math.isinf(meets_rad):
        return BESIDE
    now = abs(wrap(float(scene.now.heading[one] - scene.now.heading[other])))
    if meets_rad >= _OPPOSED_RAD or (now >= _OPPOSED_RAD and meets_rad >= _ALONG_RAD):
        return ONCOMING
    if meets_rad >= _ALONG_RAD:
        return CROSSING
    return REAR_END if now < _IN_LINE_RAD else MERGING


def how(states: States, axis: str, row: Mapping[str, Any], kind: str, names: tuple[str, str]) -> str:
    """Return how it comes to a conflict, in at most eight words.

    Args:
        states: (2, T) of the vehicle that responds and the other one, from the moment on.
        axis: ``contact``, ``braking``, ``margin`` or ``gap``: what decides.
        row: columns of `PAIRS`.
        names: of both.
    """
    own, other = names
    before = axis == "contact"  # what it does afterwards is the crash
    until = max(round(row["conflict_s"] / STEP_S) - before, 1)
    does = f"{other} {_does(states[:, : until + 1], kind)}"
    if axis == "contact":
        return f"{does}; {own} hits it"
    if axis == "braking":
        return f"{does}; {own} needs {row['needed_braking']:.1f}{NARROW}m/s²"
    if axis == "margin":
        return f"{does}; {own} passes {row['time_margin']:.1f}{NARROW}s behind"
    return f"{own} and {other} pass {row['gap_m']:.1f}{NARROW}m apart"


def _does(states: States, kind: str) -> str:
    """Return what the other vehicle does up to the conflict, by states (2, T) until then."""
    other = states[1]
    speed = other.speed
    least = (speed[_MEAN_STEPS:] - speed[:-_MEAN_STEPS]).min(initial=0.0) / (_MEAN_STEPS * STEP_S)
    if speed.max() < _STANDS_MPS:
        return "stands"
    if least < _BRAKES_MPS2 and kind != ONCOMING:
        return "brakes hard" if least < _HARD_MPS2 else "brakes"
    if speed[0] < _STARTS_MPS < speed[-1]:
        return "pulls out" if kind in (CROSSING, MERGING, ONCOMING) else "starts"
    turn = wrap(float(other.heading[-1] - other.heading[0]))
    if abs(turn) > _TURNS_RAD and kind in (CROSSING, ONCOMING):
        return "turns left" if turn > 0 else "turns right"
    if kind == REAR_END and states.speed[0, 0] - states.speed[1, 0] > _STANDS_MPS:
        return "is slower"
    moves = {CROSSING: "crosses", MERGING: "merges", ONCOMING: "comes towards it", "person": "crosses"}
    return moves.get(kind, "goes on")
