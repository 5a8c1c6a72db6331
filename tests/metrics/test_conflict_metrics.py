"""Needed braking and time margins of two in straight motion, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.metrics.base import PlannedPaths
from scex_sumo.metrics.evaluate import evaluate
from scex_sumo.metrics.registry import metrics_asked
from tests.metrics.straight import straight

LENGTH = 4.0  # of all vehicles, m


def worst(*vehicles: dict[str, float], steps: int = 30) -> tuple[float | None, float | None]:
    """Return the largest needed braking and the least time margin; None where undefined."""
    values = evaluate(straight(*vehicles, steps=steps), None, metrics=("needed_braking", "time_margin"))
    columns = [values.column(name) for name in ("needed_braking", "time_margin")]
    found = [float(value[0]) if defined[0] else None for value, defined in columns]
    return found[0], found[1]


@pytest.mark.parametrize(("speed", "gap"), [(20.0, 60.0), (10.0, 40.0), (30.0, 120.0)])
def test_behind_a_standing_vehicle_it_is_half_the_squared_speed_over_the_gap(
    speed: float, gap: float
) -> None:
    braking, margin = worst({"speed": speed}, {"x": gap + LENGTH}, steps=2)
    assert braking == pytest.approx(speed**2 / (2 * gap), rel=0.03)
    assert margin is None


def test_oncoming_vehicles_share_the_braking() -> None:
    braking, _ = worst({"speed": 20.0}, {"x": 160.0 + LENGTH, "heading": np.pi, "speed": 20.0}, steps=2)
    assert braking == pytest.approx((20.0**2 + 20.0**2) / (2 * 160.0), rel=0.05)


def test_what_goes_on_into_contact_needs_more_and_more_until_nothing_helps() -> None:
    assert worst({"speed": 20.0}, {"x": 30.0 + LENGTH})[0] == 20.0


def test_vehicles_that_part_need_nothing() -> None:
    assert worst({"speed": 10.0}, {"x": 20.0, "speed": 15.0}) == (None, None)


def test_the_margin_of_a_crossing_is_from_leaving_to_entering() -> None:
    """Both at 10 m/s; the first leaves the place after 1.3 s, the second enters 1 s later."""
    one = {"x": -10.0, "speed": 10.0}  # its rear passes x = 1 when its centre is at 3
    other = {
        "y": -26.0,
        "heading": np.pi / 2,
        "speed": 10.0,
    }  # its front is at y = -1 when its centre is at -3
    assert worst(one, other, steps=60)[1] == pytest.approx(1.0, abs=0.11)


def test_they_are_a_set_of_their_own_and_no_part_of_both() -> None:
    assert [one.name for one in metrics_asked("conflicts")] == ["needed_braking", "time_margin"]
    assert "needed_braking" not in {one.name for one in metrics_asked("both")}


def test_what_is_absent_in_a_step_has_none() -> None:
    tracks = straight({"speed": 20.0}, {"x": 40.0}, steps=10)
    present = np.ones(tracks.states.shape, np.bool_)
    present[0, 4, 1] = False
    gone = type(tracks)(states=tracks.states, length=tracks.length, width=tracks.width, present=present)
    plans = PlannedPaths.from_tracks(gone)
    assert not evaluate(gone, plans, metrics=("needed_braking",)).column("needed_braking")[1].any()
