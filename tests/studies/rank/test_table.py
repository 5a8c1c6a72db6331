"""The rows of the moments of a ranking."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.studies.moments.folder import Failure
from scex_sumo.studies.rank.futures import MomentPart
from scex_sumo.studies.rank.places import Tally
from scex_sumo.studies.rank.scores import RankSettings
from scex_sumo.studies.rank.table import failed_row, moment_row, placed, tabulate, write_table
from tests.studies.rank.parts import moment_part, moment_ref

LIMITS = {"distance": 150.0, "ttc_mean": 250.0}
SETTINGS = RankSettings(
    run=RunSettings(models="standard_driver,risky_driver", preset="paper", thresholds=LIMITS)
)


def row(seed: str, *parts: MomentPart, score: float = 0.5) -> dict[str, Any]:
    tally = Tally(futures=4, score=score, error=0.01)
    return moment_row(moment_ref(seed), [part.futures for part in parts], tally, SETTINGS)


def table_of(rows: list[dict[str, Any]]) -> pa.Table:
    return placed(tabulate(rows, SETTINGS), SETTINGS.thresholds, seed=0)


def test_a_row_has_medians_and_shares_over_all_parts() -> None:
    """Futures 0 to 3: distance 0, 100, 200, 300; ttc_mean undefined, 111, undefined, 311."""
    found = row("s", moment_part(0, 2), moment_part(2, 4))
    assert found["futures"] == 4
    assert found["fallbacks"] == 0 + 1 + 0 + 1  # each part counts from 0
    assert found["median_distance"] == 150.0
    assert (found["critical_distance"], found["defined_distance"], found["p_distance"]) == (2, 4, 0.5)
    # Of the two that are defined, 311 is above 250; the undefined ones are not critical.
    assert (found["critical_ttc_mean"], found["defined_ttc_mean"], found["p_ttc_mean"]) == (1, 2, 0.25)
    assert found["p_distance_low"] < 0.5 < found["p_distance_high"]


def test_a_row_says_who_collides_and_how_often() -> None:
    """Vehicles 7 and 9 are critical in all four futures and collide in two of them."""
    found = row("s", moment_part(0, 4))
    assert (found["p_collision"], found["collisions"], found["encounters"]) == (0.5, 0.5, 1.0)
    assert (found["worst_track_id"], found["worst_other_id"]) == (7, 9)
    assert (found["worst_p_collision"], found["worst_p_critical"]) == (0.5, 1.0)


def test_of_equal_seeds_the_one_with_the_worse_median_is_first() -> None:
    """Medians of the distance are 650 and 550 m, and nearer is worse; all other metrics agree less."""
    table = table_of([row("further", moment_part(5, 9)), row("nearer", moment_part(4, 8))])
    by_distance = placed(table, {"distance": 150.0}, seed=0)
    assert by_distance["seed"].to_pylist() == ["nearer", "further"]


def test_what_failed_is_in_the_table_with_its_reason(tmp_path: Path) -> None:
    rows = [row("s", moment_part(0, 4)), failed_row(Failure.of(moment_ref("bad"), "off the map"))]
    write_table(tmp_path / "moments", tabulate(rows, SETTINGS))
    table = pq.read_table(tmp_path / "moments.parquet")
    assert table["failure"].to_pylist() == [None, "off the map"]
    assert table["rank"].to_pylist() == [None, None]
    text = pyarrow.csv.read_csv(tmp_path / "moments.csv")
    assert text.column_names == table.column_names
    assert text["seed"].to_pylist() == ["s", "bad"]
