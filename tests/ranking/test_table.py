"""The rows of a ranking."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet as pq

from scex_sumo.metrics.registry import COLUMNS
from scex_sumo.ranking.folder import children_table
from scex_sumo.ranking.moments import Failure
from scex_sumo.ranking.table import failed_row, moment_row, placed, tabulate, write_ranking
from tests.ranking.parts import moment_part, moment_ref

LIMITS = {"distance": 150.0, "ttc_mean": 250.0}


def row(seed: str, first: int, stop: int) -> dict[str, object]:
    return moment_row(moment_ref(seed), [children_table(moment_part(first, stop))], LIMITS)


def test_a_row_has_medians_and_shares_over_all_parts() -> None:
    """Children 0 to 3: distance 0, 100, 200, 300; ttc_mean undefined, 111, 211, 311."""
    parts = [children_table(moment_part(0, 2)), children_table(moment_part(2, 4))]
    found = moment_row(moment_ref("s"), parts, LIMITS)
    assert found["children"] == 4
    assert found["fallbacks"] == 0 + 1 + 0 + 1  # each part counts from 0
    assert found["median_distance"] == 150.0
    assert (found["critical_distance"], found["defined_distance"], found["p_distance"]) == (2, 4, 0.5)
    # Each part's first child has no ttc_mean: 111 and 311 remain, and 311 is above 250.
    assert (found["critical_ttc_mean"], found["defined_ttc_mean"], found["p_ttc_mean"]) == (1, 2, 0.5)
    assert found["p_distance_low"] < 0.5 < found["p_distance_high"]


def test_the_most_critical_seed_is_first() -> None:
    """Within 150 m are 2 of 2, 1 of 3 and 0 of 4 children."""
    limits = {"distance": 150.0}
    rows = [row("far", 5, 9), row("near", 0, 2), row("both", 1, 4)]
    table = placed(tabulate(rows, limits), limits, seed=0)
    assert table["seed"].to_pylist() == ["near", "both", "far"]
    assert table["rank"].to_pylist() == [1, 2, 3]
    assert table["score"].to_pylist() == [1.0, 1 / 3, 0.0]


def test_of_equal_seeds_the_one_with_the_worse_median_is_first() -> None:
    """No child is within 150 m; medians are 650 and 550 m, and nearer is worse."""
    limits = {"distance": 150.0}
    table = placed(tabulate([row("further", 5, 9), row("nearer", 4, 8)], limits), limits, seed=0)
    assert table["seed"].to_pylist() == ["nearer", "further"]


def test_what_failed_is_in_the_table_with_its_reason(tmp_path: Path) -> None:
    rows = [row("s", 0, 4), failed_row(Failure.of(moment_ref("bad"), "off the map"))]
    write_ranking(tmp_path, tabulate(rows, LIMITS))
    table = pq.read_table(tmp_path / "ranking.parquet")
    assert table["failure"].to_pylist() == [None, "off the map"]
    assert table["rank"].to_pylist() == [None, None]
    text = pyarrow.csv.read_csv(tmp_path / "ranking.csv")
    assert text.column_names == table.column_names
    assert text["seed"].to_pylist() == ["s", "bad"]


def test_a_metric_defined_in_no_child_has_no_median_and_no_share() -> None:
    part = moment_part(0, 1)  # its only child has no ttc_mean
    found = moment_row(moment_ref("s"), [children_table(part)], LIMITS)
    assert (found["median_ttc_mean"], found["p_ttc_mean"], found["defined_ttc_mean"]) == (None, None, 0)
    assert np.isfinite(found["median_distance"])


def test_there_are_twelve_medians() -> None:
    names = tabulate([], LIMITS).column_names
    assert [name for name in names if name.startswith("median_")] == [f"median_{c}" for c in COLUMNS]
