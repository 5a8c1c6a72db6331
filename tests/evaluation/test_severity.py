"""Severity and fault of collisions, by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.metrics.collisions import CONTACT_M2, find_collisions
from scex_sumo.results.tables.outcomes import Severity, severity_of
from scex_sumo.road import Regulation, Road
from tests.metrics.straight import straight
from tests.seeds import lane_along

NORTH = math.pi / 2


def severity(*vehicles: dict[str, float], types: tuple[str, str] = ("car", "car"), road: Road | None = None):  # type: ignore[no-untyped-def]
    tracks = straight(*vehicles)
    hits = find_collisions(tracks, limit_m2=CONTACT_M2)
    found = severity_of(tracks, hits, types, road)
    assert len(hits) == 1
    return hits, found


def test_the_published_oracle_is_met() -> None:
    """Two equal cars head-on, closing at 99 km/h: each changes by 49.5 km/h, P(MAIS 3+) 12.8 %."""
    speed = 99 / 3.6 / 2
    _, found = severity({"speed": speed}, {"x": 40, "heading": math.pi, "speed": speed})
    assert found.delta_v * 3.6 == pytest.approx([49.5])
    assert found.p_mais3 == pytest.approx([0.128], abs=5e-4)
    assert found.p_mais3_other == pytest.approx(found.p_mais3)


def test_a_truck_changes_less_than_the_car_that_it_hits() -> None:
    """4 500 kg at 20 m/s hit 1 500 kg at 8 m/s from behind: 12 m/s in the ratio 3 to 1."""
    hits, found = severity(
        {"speed": 20, "length": 7.1}, {"x": 30, "speed": 8, "length": 5}, types=("truck", "car")
    )
    assert (found.delta_v, found.delta_v_other) == (pytest.approx([3.0]), pytest.approx([9.0]))
    assert np.isnan(found.p_mais3).all() and found.p_mais3_other > 0  # no curve for occupants of trucks
    assert found.faults() == ["hits from behind"] and hits.first.tolist() == [0]


def test_a_front_that_hits_a_side_has_the_fault_where_no_rule_decides() -> None:
    """The one from the south is 4 m short of the crossing when the other one's front is there."""
    east, north = {"x": -30.0, "speed": 10.0}, {"y": -34.0, "heading": NORTH, "speed": 10.0}
    for road in (None, replace(crossroads(), regulations=())):
        assert severity(east, north, road=road)[1].faults() == ["other hits the side"]
        assert severity(north, east, road=road)[1].faults() == ["hits the side"]


def crossroads() -> Road:
    """A road to the east with priority over one to the north."""
    lanes = {1: lane_along(1, [(-100, 0), (100, 0)]), 2: lane_along(2, [(0, -100), (0, 100)])}
    rule = Regulation(element_id=9, kind="right_of_way", lanes=(1, 2), yielding=(2,), priority=(1,))
    return Road(name="crossroads", lanes=lanes, regulations=(rule,))


def faults(*vehicles: dict[str, float]) -> list[str | None]:
    found: Severity = severity(*vehicles, road=crossroads())[1]
    return found.faults()


def test_who_crosses_against_priority_has_the_fault() -> None:
    east, north = {"x": -30.0, "speed": 10.0}, {"y": -28.0, "heading": NORTH, "speed": 10.0}
    assert faults(east, north) == ["other against priority"]
    assert faults(north, east) == ["against priority"]


@pytest.mark.parametrize(("kind", "tenth_kmh"), [("pedestrian", 29.0), ("cyclist", 44.0)])
def test_one_of_ten_people_is_injured_severely_at_the_published_speed(kind: str, tenth_kmh: float) -> None:
    """Of Lubbe, Wu, Jeppsson 2022, a crash of a car's front; the car's occupant is not injured."""
    speed = tenth_kmh / 3.6
    car, person = {"x": -30.0, "speed": speed}, {"heading": NORTH, "length": 0.6, "width": 0.6}
    _, found = severity(car, person, types=("car", kind))
    assert found.p_mais3_other == pytest.approx(0.1)
    assert found.p_mais3 == 0.0
    assert found.delta_v_other == pytest.approx(speed * 1500 / 1580, rel=0.05)
