"""Candidates of encounters: who may be driven, which are rare, and for how long was recorded."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.suites.population import candidates_of, read_population, recorded_hours

ROW: dict[str, Any] = {
    "location": "here",
    "recording": "a",
    "case": "",
    "seed": "a_t1.0",
    "time_s": 1.0,
    "track_id": 1,
    "other_id": 2,
    "person": None,
    "probability": 3e-4,
    "conflict": "merge",
    "doubt": None,
}


def ranking(folder: Path, *rows: dict[str, Any]) -> Path:
    """Write a ranking with rows that differ from `ROW`."""
    schema = pa.schema([(name, pa.string()) for name in ROW if isinstance(ROW[name] or "", str)])
    table = pa.Table.from_pylist([ROW | row for row in rows])
    for name in schema.names:
        index = table.schema.get_field_index(name)
        table = table.set_column(index, schema.field(name), table[name].cast(pa.string()))
    pq.write_table(table, folder / "ranking.parquet")
    moments = {"recording": ["a", "a"], "case": ["", ""], "time_s": [0.0, 1799.0]}
    pq.write_table(pa.table(moments), folder / "moments.parquet")
    (folder / "rank.json").write_text(json.dumps({"roots": ["recordings"], "every_s": 1.0, "seeds": 2}))
    return folder


def test_of_two_that_both_could_respond_each_is_a_candidate_for_half_of_the_encounter() -> None:
    told, back = candidates_of(ROW)
    assert (told["track_id"], told["other_id"], told["share"]) == (1, 2, 0.5)
    assert (back["track_id"], back["other_id"], back["share"]) == (2, 1, 0.5)
    assert told["probability"] == back["probability"] == 3e-4


@pytest.mark.parametrize(
    "row",
    [{"person": "pedestrian P1", "conflict": "pedestrian crossing"}, {"conflict": "lead vehicle stopped"}],
)
def test_people_and_leaders_are_not_driven(row: dict[str, Any]) -> None:
    (one,) = candidates_of(ROW | row)
    assert (one["track_id"], one["share"]) == (1, 1.0)


def test_rare_encounters_are_candidates_only_where_their_kind_has_no_other(tmp_path: Path) -> None:
    rows = [
        {"conflict": "lead vehicle stopped", "probability": 1e-4},
        {"conflict": "lead vehicle stopped", "probability": 9e-7},
        {"conflict": "lead vehicle slower", "probability": 5e-7},
        {"conflict": None, "probability": 1e-9},
        {"conflict": "lead vehicle slower", "probability": 1e-3, "doubt": "off the mapped lanes"},
    ]
    found = read_population([ranking(tmp_path, *rows)])
    assert found.column("probability").tolist() == [1e-4, 5e-7]
    assert (found.encounters, found.rare, found.doubtful) == (2, 2, 1)
    assert found.hours == pytest.approx(0.5)


def test_exposure_counts_encounters_once_and_candidates(tmp_path: Path) -> None:
    found = read_population([ranking(tmp_path, {}, {"probability": 2e-6})])
    (row,) = found.exposure()
    assert row == {
        "kind": "merge",
        "encounters": 2.0,
        "people_collide_per_hour": pytest.approx(3.02e-4 / 0.5),
        "candidates": 4,
    }


def test_hours_are_from_the_first_to_the_last_moment_of_each_recording() -> None:
    rows = [("a", "", 0.0), ("a", "", 1799.0), ("b", "1", 4.0), ("b", "1", None)]
    moments = pa.table(dict(zip(("recording", "case", "time_s"), zip(*rows, strict=True), strict=True)))
    assert recorded_hours(moments, 1.0) == pytest.approx(1801 / 3600)


def test_what_is_no_ranking_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no finished ranking"):
        read_population([tmp_path])
    with pytest.raises(UsageError, match="no encounter without doubt"):
        read_population([ranking(tmp_path, {"doubt": "off the mapped lanes"})])
