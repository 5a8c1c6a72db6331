"""What is usual at the sites of a validation, and how often people are expected to collide there."""

from __future__ import annotations

from pathlib import Path

import pytest

import scex_sumo
from scex_sumo.certainty.response.usual import Population
from scex_sumo.studies.moments.encounters import encounters_of
from scex_sumo.studies.validate.usual import collisions_an_hour, usual_rows
from tests.studies.moments.pairs import moment, pairs_table


def test_a_site_has_a_row_for_each_kind_with_its_worst_encounter_and_its_place() -> None:
    merges = [pairs_table((1, k), probability=(k - 1) * 1e-5) for k in range(2, 23)]
    ring = pairs_table((90, 91), probability=1e-3, kind="ring", to_test=False)
    far = pairs_table((92, 93), probability=1e-1, kind="ring", gap_m=11.0)
    merge_row, ring_row = usual_rows(encounters_of([moment(1.0, *merges, ring, far)], 1.0))
    assert (merge_row["encounters"], merge_row["to_test"]) == (21, 21)
    assert merge_row["median"] == pytest.approx(11e-5)
    assert merge_row["worst"] == "22 → 1, r__1.0"
    assert merge_row["place"] == "2 × the median at this site, 1st of 21"
    assert (ring_row["encounters"], ring_row["to_test"], ring_row["kind"]) == (1, 0, "ring")
    assert ring_row["place"].endswith("in the whole data set, 1st of 22")


def test_collisions_an_hour_are_those_of_moments_of_three_seconds() -> None:
    """One of two moments has 0.1: 1200 moments an hour with 0.05 on average; doubtful pairs do not count."""
    doubtful = pairs_table((3, 4), probability=0.5, doubt="boxes touch")
    moments = moment(1.0, pairs_table(probability=0.1), doubtful), moment(2.0, pairs_table().slice(0, 0))
    assert collisions_an_hour(moments) == pytest.approx(60)


def test_a_validation_knows_what_is_usual_if_asked(tmp_path: Path) -> None:
    done = scex_sumo.validate(
        scex_sumo.example_path("roundabout"), out=tmp_path, every=30, futures=1, usual=True
    )
    assert 0 < done.info["collisions_an_hour"] < 1
    assert Population.read(tmp_path).usual("roundabout", "ring", 1e-4) is not None
    assert "What is usual" in (tmp_path / "validation.html").read_text()
