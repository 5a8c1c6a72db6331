"""Models that the wing registers: the likely driver, and the mix of human-like drivers."""

from __future__ import annotations

from scex_sumo.behaviors.spec import ModelEntry
from scex_sumo.humans.driver import LikelyDriver, LikelyProfile

LIKELY_DRIVER = ModelEntry(
    make=LikelyDriver,
    profile=LikelyProfile(),
    summary="a driver drawn for every vehicle and future, as people were recorded",
    path_words=("fitted",),
    may_fail=False,
    is_own=False,
    place=40,
)
