"""Files of a ranking's tables."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from scex_sumo.studies.rank.page import stress_words
from scex_sumo.studies.rank.rank import MOMENTS, write_table


def test_a_table_is_written_twice_alike(tmp_path: Path) -> None:
    rows = [
        {"seed": "s", "vehicles": 3, "human_p_collision": 1e-6},
        {"seed": "bad", "failure": "off the map"},
    ]
    write_table(tmp_path / "moments", pa.Table.from_pylist(rows, schema=MOMENTS))
    table, text = (
        pq.read_table(tmp_path / "moments.parquet"),
        pyarrow.csv.read_csv(tmp_path / "moments.csv"),
    )
    assert table["failure"].to_pylist() == [None, "off the map"]
    assert text.column_names == table.column_names
    assert text["seed"].to_pylist() == ["s", "bad"]


def test_a_moment_without_futures_says_nothing_of_the_stress_test() -> None:
    assert stress_words({"stress_p_collision": 0.125}) == "12%"
    assert stress_words({"stress_p_collision": None}) is None
