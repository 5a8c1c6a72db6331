"""Kinds of conflicts by hand-made encounters; the order of the two changes nothing."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.conflicts.braking import DrivenPaths
from scex_sumo.decision.moment import human_part, pairs_of_part
from scex_sumo.decision.typology import conflict_of, kinds_of
from scex_sumo.extrapolation.job import ruled
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.road import Lane, Road
from scex_sumo.scene import HISTORY_STEPS, SeedScene, States
from tests.decision import families
from tests.seeds import Vehicle, lane_along, seed_of

STRAIGHT, LEFT, RIGHT = (), (10.0, np.pi / 2), (10.0, -np.pi / 2)
RADIUS_M = 8.0
STEPS, PLANNED = 30, 30


@dataclass
class Found:
    """A scene, with the way that each drives in 3 s at its speed, and in the 3 s planned after these."""

    scene: SeedScene
    ways: DrivenPaths


def scene(
    *vehicles: Vehicle,
    turns: tuple[tuple[float, ...], ...] = (),
    road: Road | None = None,
    people: int = 0,
    before: float | None = None,
    turned: float = 0.0,
) -> Found:
    """Road users at x, y, with heading in degrees and speed.

    Args:
        turns: metres until a vehicle turns, and by how much, rad.
        people: number of the last ones that walk.
        before: speed of the first one before now.
        turned: how much less the heading of the second one was before now, degrees.
    """
    x, y, heading, speed = np.array(vehicles, dtype=float).T[..., None]
    heading, count = np.deg2rad(heading), len(vehicles)
    way = 0.1 * speed * np.arange(-HISTORY_STEPS, STEPS + PLANNED + 1)
    fine = np.arange(-20.0, 200.0, 0.1)
    lines = []
    for v in range(count):
        turn = turns[v] if turns and turns[v] else (0.0, 0.0)
        bent = heading[v] + turn[1] * np.clip((fine - turn[0]) / (RADIUS_M * np.pi / 2), 0.0, 1.0)
        xs, ys = (0.1 * np.cumsum(f(bent)) for f in (np.cos, np.sin))
        zero = np.searchsorted(fine, -1e-9)
        values = (x[v] + xs - xs[zero], y[v] + ys - ys[zero], bent)
        lines.append([np.interp(way[v], fine, each) for each in values])
    xs, ys, headings = np.array(lines).swapaxes(0, 1)
    speeds = np.broadcast_to(speed, xs.shape).copy()
    if before is not None:
        speeds[0, :HISTORY_STEPS] = before
    if count > 1:
        headings[1, :HISTORY_STEPS] -= np.deg2rad(turned)
    driven = States(x=xs, y=ys, heading=headings, speed=speeds)[:, : HISTORY_STEPS + 1 + STEPS]
    size = [np.where(np.arange(count) < count - people, full, 0.6) for full in (4.0, 2.0)]
    whole = seed_of(
        driven[:, : HISTORY_STEPS + 1],
        types=("car",) * (count - people) + ("pedestrian",) * people,
        length=size[0],
        width=size[1],
        people=np.arange(count) >= count - people,
        road=road or Road(name="plain", lanes={}),
    )
    after = slice(HISTORY_STEPS + 1 + STEPS, None)
    return Found(whole, DrivenPaths.of(driven, *size, np.stack([xs[:, after], ys[:, after]])))


def kind(found: Found) -> str:
    one, other = (conflict_of(found.scene, *pair, found.ways) for pair in ((0, 1), (1, 0)))
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
    found = scene((20.0, 0.0, 0.0, speed), (0.0, 0.0, 0.0, 10.0), before=before)
    assert kind(found) == f"lead vehicle {word}"


def test_a_vehicle_that_only_crosses_the_way_does_not_lead() -> None:
    """It is 20 m ahead now, and was 6 m beside the way a second ago."""
    assert not kind(scene((20.0, 0.0, 40.0, 10.0), (0.0, 0.0, 0.0, 10.0))).startswith("lead")


def test_two_that_pass_each_other_after_a_turn_do_not_cross() -> None:
    assert kind(scene((30.0, 3.5, 180.0, 6.0), (0.0, 0.0, 0.0, 6.0), turned=60.0)) == "head-on"


@pytest.mark.parametrize(
    ("vehicles", "turns", "expected"),
    [
        (((0.0, 3.2, 0.0, 9.0), (-5.0, 0.0, 0.0, 10.0)), (), "lane change"),
        (((0.0, 3.2, 180.0, 9.0), (-60.0, 0.0, 0.0, 10.0)), (), "head-on"),
        (((0.0, -20.0, 90.0, 9.0), (-20.0, 0.0, 0.0, 10.0)), (), "straight crossing paths"),
        (
            ((0.0, -20.0, 90.0, 9.0), (-30.0, 8.0, 0.0, 10.0)),
            ((10.0, np.pi / 2), STRAIGHT),
            "turn across path, lateral",
        ),
        (((15.0, 3.2, 180.0, 6.0), (-30.0, 0.0, 0.0, 10.0)), (LEFT, STRAIGHT), "turn across path, opposite"),
        (((5.0, -18.0, 90.0, 6.0), (-30.0, 0.0, 0.0, 10.0)), (RIGHT, STRAIGHT), "turn into path"),
        (((5.0, 18.0, -90.0, 6.0), (-30.0, 0.0, 0.0, 10.0)), (LEFT, STRAIGHT), "turn into path"),
    ],
)
def test_kinds_of_two_vehicles(
    vehicles: tuple[Vehicle, Vehicle], turns: tuple[tuple[float, ...], ...], expected: str
) -> None:
    assert kind(scene(*vehicles, turns=turns)) == expected
    mirrored = [(x, -y, -heading, speed) for x, y, heading, speed in vehicles]
    bent = tuple((turn[0], -turn[1]) if turn else turn for turn in turns)
    left_hand = Road(name="plain", lanes={}, left_hand=True)
    assert kind(scene(*mirrored, turns=bent, road=left_hand)) == expected


def quarter(number: int, radius: float = 20.0) -> Lane:
    angle = np.linspace(0.0, np.pi / 2, 16) + number * np.pi / 2
    line = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return lane_along(number + 1, line, width=5.0, speed_limit_mps=9.0, successors=((number + 1) % 4 + 1,))


def test_one_that_enters_a_roundabout_meets_one_on_it_at_the_entry() -> None:
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
    found = scene((0.0, 0.0, 0.0, 10.0), (30.0, 4.0, heading, speed), people=1)
    assert kind(found) == f"pedestrian {word}"


@pytest.mark.parametrize(
    ("seed_scene", "word"),
    [
        (families.behind_standing(10.0, 20.0), "lead vehicle stopped"),
        (families.behind_slower(10.0, 5.0, 15.0), "lead vehicle slower"),
        (families.behind_braking(10.0, 15.0, 3.0), "lead vehicle decelerating"),
        (families.crossing(8.0, 2.0), "straight crossing paths"),
        (families.merging(8.0, 2.0), "merge"),
        (families.oncoming(8.0, 2.0), "head-on"),
        (families.person(8.0, 2.0), "pedestrian crossing"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_pairs_of_human_like_futures_have_a_kind(seed_scene: SeedScene, word: str, tmp_path: Path) -> None:
    assert seed_scene.road is not None
    found, net = ruled(seed_scene, converted(seed_scene.road, tmp_path / "net.net.xml"), RunSettings())
    part = human_part(found, net, futures=16)
    assert part.plan_x is not None and part.plan_x.shape == (
        16,
        found.vehicles,
        PLANNED,
    )  # the last plans only
    rows = pairs_of_part(found, part).to_pylist()
    assert kinds_of(found, rows, part) == [word]
    assert kinds_of(found, [rows[0] | {"probability": 1e-9}], part) == [None]


@pytest.mark.parametrize("ahead", [0, 1])
def test_of_two_that_stand_in_a_queue_the_one_behind_comes_first(ahead: int) -> None:
    order = [(0.0, 0.0, 0.0, 0.0), (6.0, 0.0, 0.0, 0.0)][:: 1 if ahead else -1]
    (row,) = families.pairs(families.scene(families.street(), *order)).to_pylist()
    assert row["other_id"] == ahead + 1
