"""Kinds of conflicts by hand-made encounters; who acts changes nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.certainty.response.motion.blocked import Lines
from scex_sumo.certainty.response.motion.expected import Expected, with_people
from scex_sumo.certainty.response.typology import conflict_of
from scex_sumo.road import Lane, Road
from tests.certainty.response.scenes import beside, steady

Vehicle = tuple[float, float, float, float]
STRAIGHT, LEFT, RIGHT = (), (10.0, np.pi / 2), (10.0, -np.pi / 2)
RADIUS_M = 8.0


def scene(
    *vehicles: Vehicle, turns: tuple[tuple[float, ...], ...] = (), road: Road | None = None
) -> Expected:
    """Vehicles at x, y, with heading in degrees and speed; those with a turn begin it after so many m."""
    found = steady(*((x, y, np.deg2rad(h), v) for x, y, h, v in vehicles))
    s = found.lines.start[0] + np.arange(found.lines.x.shape[1])
    heading = found.lines.heading.copy()
    for v, turn in enumerate(turns):
        if turn:
            heading[v] += turn[1] * np.clip((s - turn[0]) / (RADIUS_M * np.pi / 2), 0.0, 1.0)
    x, y = (np.cumsum(np.pad(f(heading[:, :-1]), ((0, 0), (1, 0))), axis=1) for f in (np.cos, np.sin))
    now = int(np.flatnonzero(s == 0)[0])
    start = found.scene.now
    lines = Lines(
        x=x - x[:, [now]] + start.x[:, None],
        y=y - y[:, [now]] + start.y[:, None],
        heading=heading,
        start=found.lines.start,
        spacing_m=1.0,
    )
    here = replace(found.scene, road=road or Road(name="plain", lanes={}))
    return replace(found, scene=here, lines=lines)


def kind(expected: Expected) -> str:
    one, other = conflict_of(expected, 0, 1).kind, conflict_of(expected, 1, 0).kind
    assert one == other
    return one


@pytest.mark.parametrize(
    ("speed", "before", "word"),
    [
        (0.0, 0.0, "stopped"),
        (8.0, 10.0, "decelerating"),
        (8.0, 8.0, "slower"),
        (10.0, 10.0, "moving on"),
        (12.0, 11.0, "moving on"),
    ],
)
def test_a_leader_is_told_by_what_it_does(speed: float, before: float, word: str) -> None:
    found = scene((20.0, 0.0, 0.0, speed), (0.0, 0.0, 0.0, 10.0))
    found.scene.history.speed[0, :-1] = before
    assert kind(found) == f"lead vehicle {word}"


def test_who_only_crosses_the_way_does_not_lead() -> None:
    """It is 20 m ahead now, and was 6 m beside the way a second ago."""
    assert not kind(scene((20.0, 0.0, 40.0, 10.0), (0.0, 0.0, 0.0, 10.0))).startswith("lead")


def test_two_who_pass_each_other_after_a_turn_do_not_cross() -> None:
    found = scene((30.0, 3.5, 180.0, 6.0), (0.0, 0.0, 0.0, 6.0))
    found.scene.history.heading[1, :-1] -= np.deg2rad(60.0)
    assert kind(found) == "head-on"


@pytest.mark.parametrize(
    ("vehicles", "turns", "expected"),
    [
        (((0.0, 3.2, 0.0, 9.0), (-5.0, 0.0, 0.0, 10.0)), (), "lane change"),
        (((0.0, 3.2, 180.0, 9.0), (-60.0, 0.0, 0.0, 10.0)), (), "head-on"),
        (((0.0, -20.0, 90.0, 9.0), (-20.0, 0.0, 0.0, 10.0)), (), "straight crossing paths"),
        (
            ((0.0, -20.0, 90.0, 9.0), (-30.0, 8.0, 0.0, 10.0)),
            ((10.0, np.pi / 2), STRAIGHT),
            "left turn across path, lateral",
        ),
        (
            ((15.0, 3.2, 180.0, 6.0), (-30.0, 0.0, 0.0, 10.0)),
            (LEFT, STRAIGHT),
            "left turn across path, opposite",
        ),
        (
            ((5.0, -18.0, 90.0, 6.0), (-30.0, 0.0, 0.0, 10.0)),
            (RIGHT, STRAIGHT),
            "turn into path",
        ),
        (
            ((5.0, 18.0, -90.0, 6.0), (-30.0, 0.0, 0.0, 10.0)),
            (LEFT, STRAIGHT),
            "turn into path",
        ),
    ],
)
def test_kinds_of_two_vehicles(
    vehicles: tuple[Vehicle, Vehicle], turns: tuple[tuple[float, ...], ...], expected: str
) -> None:
    assert kind(scene(*vehicles, turns=turns)) == expected


def quarter(number: int, radius: float = 20.0) -> Lane:
    angle = np.linspace(0.0, np.pi / 2, 16) + number * np.pi / 2
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return Lane(
        lane_id=number + 1,
        centreline=radius * circle,
        left_bound=(radius - 2.5) * circle,
        right_bound=(radius + 2.5) * circle,
        width_m=5.0,
        speed_limit_mps=9.0,
        successors=((number + 1) % 4 + 1,),
    )


def test_who_enters_a_roundabout_and_who_is_on_it_meet_at_its_entry() -> None:
    road = Road(name="ring", lanes={k + 1: quarter(k) for k in range(4)})
    entering = (40.0, 0.0, 180.0, 6.0)
    circling = (20.0 * np.cos(-0.6), 20.0 * np.sin(-0.6), np.rad2deg(np.pi / 2 - 0.6), 7.0)
    assert kind(scene(entering, circling, road=road)) == "roundabout entry"
    assert kind(scene(entering, circling)) != "roundabout entry"


def test_one_that_turns_onto_the_ring_enters_though_both_are_on_it() -> None:
    """Both are on lanes of the ring, at right angles."""
    road = Road(name="ring", lanes={k + 1: quarter(k) for k in range(4)})
    assert kind(scene((19.0, 2.0, 180.0, 6.0), (20.0, -14.0, 90.0, 6.0), road=road)) == "roundabout entry"


def test_a_leader_may_be_a_little_beside_the_line_but_not_on_the_next_lane() -> None:
    assert kind(scene((20.0, 2.5, 0.0, 10.0), (0.0, 0.0, 0.0, 10.0))) == "lead vehicle moving on"
    assert kind(scene((20.0, 3.0, 0.0, 10.0), (0.0, 0.0, 0.0, 10.0))) == "lane change"


@pytest.mark.parametrize(
    ("heading", "speed", "word"), [(-90.0, 1.4, "crossing"), (0.0, 1.4, "along"), (-90.0, 0.0, "along")]
)
def test_people_cross_or_go_along(heading: float, speed: float, word: str) -> None:
    street = scene((0.0, 0.0, 0.0, 10.0))
    found = with_people(beside(street, (30.0, 4.0, np.deg2rad(heading), speed)))
    assert conflict_of(found, 1, 0).kind == f"pedestrian {word}"


def test_parameters_are_those_of_the_first_and_the_second() -> None:
    found = conflict_of(scene((0.0, -20.0, 90.0, 8.0), (-20.0, 0.0, 0.0, 10.0)), 0, 1)
    assert found.angle_deg == pytest.approx(90.0)
    assert found.speeds == (8.0, 10.0)
    assert found.accelerations == (0.0, 0.0)
    assert found.arrivals_s == pytest.approx((2.5, 2.0), abs=0.3)  # lines together 2 m before the crossing
    assert found.apart_m == pytest.approx(np.hypot(20 - 3, 20 - 3))  # 4 m x 2 m boxes at a right angle
