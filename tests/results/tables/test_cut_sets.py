"""Cut sets of pairs: those of hand-made events, and of queues against all their assignments."""

from __future__ import annotations

from itertools import combinations, product
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.arrays import BoolArray
from scex_sumo.results.run import Run
from scex_sumo.results.tables.cut_sets import LEAST_FUTURES, DrawnModels, cut_set_words
from tests.queues import queues
from tests.runs import extrapolate

NAMES = np.array(["constant_velocity", "emergency_brake", "risky_driver"])
KEEPS, BRAKES, RISKY = range(3)
DRAWN = np.random.default_rng(0).integers(3, size=(400, 40))


def told(happens: BoolArray, levels: np.ndarray = DRAWN) -> list[str]:
    """The first two vehicles, 1 and 2, are the pair."""
    drawn = DrawnModels(np.arange(1, levels.shape[1] + 1), NAMES[levels])
    return cut_set_words({"track_id": 1, "other_id": 2, "cut_sets": drawn.cut_sets((0, 1), happens)})


def test_sets_are_the_smallest_and_the_most_frequent_is_first() -> None:
    one, other = DRAWN[:, :2].T
    both, alone = int(((one == BRAKES) & (other == KEEPS)).sum()), int((other == RISKY).sum())
    assert told((one == BRAKES) & (other == KEEPS) | (other == RISKY)) == [
        f"in {alone} of {alone} futures in which 2 drives riskily",
        f"in {both} of {both} futures in which 1 brakes hard and 2 keeps its speed",
    ]
    assert told(np.ones(400, dtype=bool)) == ["in all futures"]
    assert told(np.zeros(400, dtype=bool)) == []


def test_models_that_do_the_same_are_one_phrase() -> None:
    count = int((DRAWN[:, 0] != KEEPS).sum())
    (words,) = told(DRAWN[:, 0] != KEEPS)
    assert words == f"in {count} of {count} futures in which 1 brakes hard or drives riskily"
    three = [{"futures": 9, "track_ids": [1], "models": [name]} for name in ("stops", "mine", "replay")]
    assert cut_set_words({"track_id": 1, "other_id": 2, "cut_sets": three})[0].endswith(
        "which 1 stops, drives as mine or drives as recorded"
    )


def test_vehicles_beside_the_pair_count_if_they_decide_and_not_by_chance() -> None:
    """Of 38 other vehicles with 3 models some always go with an event that a coin throws."""
    decides = (DRAWN[:, 0] == BRAKES) & (DRAWN[:, 7] == KEEPS)
    count = int(decides.sum())
    assert told(decides) == [f"in {count} of {count} futures in which 1 brakes hard and 8 keeps its speed"]
    assert told(np.random.default_rng(1).random(400) < 0.5) == []


def test_a_set_needs_eight_futures_and_has_at_most_two_vehicles_beside_the_pair() -> None:
    levels = np.zeros((40, 5), dtype=np.int64)
    levels[:LEAST_FUTURES, 0] = BRAKES
    assert told(levels[:, 0] == BRAKES, levels) == ["in 8 of 8 futures in which 1 brakes hard"]
    assert told(levels[1:, 0] == BRAKES, levels[1:]) == []
    levels = np.array(list(product((KEEPS, BRAKES), repeat=5)) * 20)
    assert len(told((levels[:, 1:] == BRAKES).all(axis=1), levels)) == 0  # 2, and three more
    assert told((levels[:, 1:4] == BRAKES).all(axis=1), levels)[0].endswith("3 brakes hard and 4 brakes hard")


def test_lifts_are_those_of_single_models() -> None:
    drawn = DrawnModels(np.array([5, 6]), NAMES[np.array([[0, 0], [0, 1], [1, 0], [1, 1]])])
    rows = drawn.lifts((0, 1), np.array([False, False, False, True]))
    assert [(r["track_id"], r["model"], r["futures"], r["happened"], r["lift"]) for r in rows] == [
        (track, model, 2, hit, 2.0 * hit) for track in (5, 6) for hit, model in enumerate(NAMES[:2])
    ]


def sets_of(run: Run, pair: tuple[int, int], event: str) -> set[frozenset[tuple[int, str]]]:
    ids = run.info["seed_scene"]["track_ids"]
    models = np.array(run.assignments["model"].to_pylist()).reshape(run.futures, -1)
    happens = run.encounter(*pair).happens(event)
    rows = DrawnModels(np.array(ids), models).cut_sets((ids.index(pair[0]), ids.index(pair[1])), happens)
    return {frozenset(zip(row["track_ids"], row["models"], strict=True)) for row in rows}


def true_sets(every: Run, pair: tuple[int, int], event: str) -> set[frozenset[tuple[int, str]]]:
    """The minimal sets with which the event happens in all assignments."""
    ids, happens = every.info["seed_scene"]["track_ids"], every.encounter(*pair).happens(event)
    rows = [frozenset(zip(ids, every.models_of(future), strict=True)) for future in range(every.futures)]
    known: set[frozenset[tuple[int, str]]] = set()
    for size in range(len(ids) + 1):
        for one in {frozenset(part) for row in rows for part in combinations(sorted(row), size)}:
            if not any(part <= one for part in known) and happens[[one <= row for row in rows]].all():
                known.add(one)
    return known


@pytest.mark.parametrize(
    ("rows", "pair", "vehicles"), [((4,), (3, 4), {1, 2, 3, 4}), ((2, 2), (3, 4), {3, 4})]
)
def test_queues_have_the_sets_of_all_assignments(
    tmp_path: Path, rows: tuple[int, ...], pair: tuple[int, int], vehicles: set[int]
) -> None:
    """Whether the last car of four comes too close hangs on all ahead of it; two pairs apart do not count."""
    scene, options = queues(*rows), {"models": NAMES[:2].tolist(), "world": "plain", "metrics": ["gap"]}
    every = extrapolate(scene, futures="all", out=tmp_path / "all", **options)
    drawn = extrapolate(scene, futures=385, out=tmp_path / "drawn", **options)
    truth = true_sets(every, pair, "ttc")
    assert sets_of(drawn, pair, "ttc") == truth
    assert {track for one in truth for track, _ in one} == vehicles
