"""The profiles are the paper's (Zipfl, Schütt, Zöllner 2024, table of behaviour models)."""

from __future__ import annotations

import pytest

from scex_sumo.drivers.registry import entry_of


@pytest.mark.parametrize(
    ("name", "deceleration", "headway", "gap"),
    [("standard_driver", 3.0, 3.1, 9.0), ("risky_driver", 8.0, 2.1, 5.0)],
)
def test_idm_profiles_are_the_papers(name: str, deceleration: float, headway: float, gap: float) -> None:
    profile = entry_of(name).profile
    assert (profile.comfort_deceleration, profile.time_headway, profile.minimum_gap) == (
        deceleration,
        headway,
        gap,
    )
    assert profile.clearance == 5.0


def test_the_emergency_brake_is_the_papers() -> None:
    assert entry_of("emergency_brake").profile.deceleration == 5.0
