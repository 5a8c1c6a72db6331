"""Models that the wing registers: drivers that obey the rules of the road, and drivers that break one."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

from scex_sumo.behaviors.spec import ModelEntry
from scex_sumo.rules.ruled import RuledDriver, RuledProfile

_rule = partial(ModelEntry, make=RuledDriver, may_fail=False, is_own=False)

# Parameters of the standard and the risky driver: Zipfl, Schütt, Zöllner 2024, except max_acceleration, which
# the paper does not state, and those of the rules.
_STANDARD = RuledProfile(
    comfort_deceleration=3.0, time_headway=3.1, minimum_gap=9.0, max_acceleration=1.5, clearance=5.0
)
_RISKY = RuledProfile(
    comfort_deceleration=8.0,
    time_headway=2.1,
    minimum_gap=5.0,
    max_acceleration=3.0,
    clearance=5.0,
    yellow_deceleration=0.0,
    red_delay=1.0,
    gap_factor=0.5,
)


def _violation(what: str, place: int, **changes: Any) -> ModelEntry:
    """Return the standard driver but for one thing."""
    summary = f"standard_driver that {what}"
    return _rule(profile=replace(_STANDARD, **changes), summary=summary, place=place)


STANDARD_DRIVER = _rule(
    profile=_STANDARD,
    summary="Intelligent Driver Model, the paper's standard profile; obeys lights and right of way",
    place=10,
)
RISKY_DRIVER = _rule(
    profile=_RISKY,
    summary="Intelligent Driver Model, the paper's risky profile: close, fast, in short gaps, at yellow",
    place=20,
)
RUNS_RED = _violation("does not stop at lights", 71, lights=False)
IGNORES_PRIORITY = _violation("gives way to nobody", 72, priority=False)
CUTS_IN = _violation("changes to a lane beside it without looking", 73, sideways="cuts_in")
DRIFTS = _violation("leaves its lane sideways", 74, sideways="drifts")
