"""Models that the wing registers: the likely driver, and the mix of human-like drivers."""

from __future__ import annotations

from scex_sumo.behaviors.spec import ModelEntry
from scex_sumo.humans.driver import LikelyDriver, LikelyProfile
from scex_sumo.humans.guard.corridors import GuardProfile

LIKELY_DRIVER = ModelEntry(
    make=LikelyDriver,
    profile=LikelyProfile(),
    summary="a driver drawn for every vehicle and future, as people were recorded",
    path_words=("fitted",),
    # People drive closer together than the default guard allows.
    guard=GuardProfile(
        comfort_deceleration=6.5,
        reaction_time=0.2,
        minimum_gap=0.3,
        margin=0.15,
        alongside_margin=0.05,
        time_margin=0.3,
        touching=0.3,
    ),
    may_fail=False,
    is_own=False,
    place=40,
)
