"""Properties of P: it rises with danger, reaches 1, and forgets nothing that is under way."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise

import pytest

from scex_sumo.decision.decide import TEST_FROM, decide
from scex_sumo.scene import SeedScene
from tests.decision.families import (
    FUTURES,
    behind_braking,
    behind_slower,
    behind_standing,
    crossing,
    merging,
    oncoming,
    pairs,
    person,
)

GAPS_M = (60, 30, 15, 8, 4)
TTCS_S = (5.0, 2.5, 1.6, 1.0, 0.5)
FAMILIES: dict[str, tuple[Callable[[float], SeedScene], Sequence[float]]] = {
    "behind a standing one at 5 m/s": (partial(behind_standing, 5.0), GAPS_M[1:]),
    "behind a standing one at 20 m/s": (partial(behind_standing, 20.0), (100, *GAPS_M)),
    "behind a standing one at 35 m/s": (partial(behind_standing, 35.0), (200, 100, 50, 20)),
    "behind a slower one": (partial(behind_slower, 20.0, 10.0), GAPS_M),
    "behind one that brakes with 4 m/s²": (lambda gap: behind_braking(15.0, gap, 4.0), GAPS_M),
    "behind one that brakes harder": (partial(behind_braking, 15.0, 12.0), (0, 2, 4, 6, 8)),
    "crossing without priority": (partial(crossing, 14.0), TTCS_S),
    "crossing with priority": (partial(crossing, 14.0, priority=True), TTCS_S),
    "merging": (partial(merging, 14.0), TTCS_S),
    "oncoming on one's lane": (partial(oncoming, 12.0), TTCS_S),
    "a person that crosses": (partial(person, 10.0), TTCS_S),
}
NOISE = 0.5  # of a few futures, where everybody brakes in time


@pytest.mark.parametrize("family", FAMILIES)
def test_p_does_not_fall_as_danger_grows(family: str) -> None:
    scene_of, values = FAMILIES[family]
    tables = [pairs(scene_of(value)).to_pylist() for value in values]
    chances = [max((row["probability"] for row in rows), default=0.0) for rows in tables]
    for milder, worse in pairwise(chances):
        assert worse >= milder * (NOISE if milder < TEST_FROM else 1.0), dict(
            zip(values, chances, strict=True)
        )
    assert chances[-1] > 10 * chances[0]
    for rows in tables:
        for row in rows:  # nothing under way is forgotten
            assert row["least"] <= row["probability"] <= row["most"]
            assert row["probability"] >= 0.1 or row["collide"] < 0.5


@pytest.mark.parametrize(("speed", "gap"), [(10.0, 4.0), (20.0, 20.0), (30.0, 40.0)])
def test_it_is_certain_where_more_is_needed_than_one_can_brake(speed: float, gap: float) -> None:
    table = pairs(behind_standing(speed, gap)).to_pylist()  # needs 12.5, 10 and 11.25 m/s²
    verdict = decide(table, futures=FUTURES)
    assert verdict.probability > 0.99 and verdict.kind == "test" and verdict.pair == (1, 2)
    assert verdict.what == "rear-end" and "stands" in str(verdict.how)


@pytest.mark.parametrize("ttc_s", [0.6, 1.0])
def test_one_that_drives_on_the_opposite_lane_is_no_doubt(ttc_s: float) -> None:
    verdict = decide(pairs(oncoming(12.0, ttc_s)).to_pylist(), futures=FUTURES)
    assert verdict.kind == "test" and verdict.doubt is None and verdict.what == "oncoming"


def test_a_person_is_named(  # and is the other one of a pair
) -> None:
    row = pairs(person(10.0, 1.0)).to_pylist()[0]
    assert row["person"] == "pedestrian 900" and row["track_id"] == 1 and row["what"] == "person"
