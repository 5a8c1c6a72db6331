"""Kept tables of studies: whole and of their schema, or not there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from scex_sumo.base.errors import ResultError
from scex_sumo.studies.moments.folder import Failure, Listing, read_table, write_table
from scex_sumo.studies.rank.children import RankFolder
from scex_sumo.studies.rank.table import write_ranking
from tests.studies.rank.parts import SETTINGS, moment_part, moment_ref

PLAN = {"seed": 0}
REF = moment_ref("one_t1.0")
SCHEMA = pa.schema([("child", pa.int32()), ("ttc", pa.float64()), ("model", pa.list_(pa.string()))])


def table() -> pa.Table:
    columns = {"child": [0, 1], "ttc": [0.5, None], "model": [["a", "b"], ["b", "a"]]}
    return pa.table(columns, schema=SCHEMA)


def replaced(name: str, values: pa.Array) -> pa.Table:
    return table().set_column(SCHEMA.get_field_index(name), name, values)


def test_a_kept_table_is_read_as_it_was_written(tmp_path: Path) -> None:
    write_table(tmp_path / "new" / "t.parquet", table(), store_schema=False)
    assert read_table(tmp_path / "new" / "t.parquet", SCHEMA, ["ttc"]).equals(table())


@pytest.mark.parametrize(
    ("edited", "words"),
    [
        (table().drop_columns(["ttc"]), "has no single column ttc"),
        (replaced("ttc", pa.array(["x", "y"])), "column ttc has type string, needs double"),
        (replaced("child", pa.array([0, None], pa.int32())), "column child has empty values"),
        (replaced("model", pa.array([["a", None], ["b"]])), "column model has empty values"),
        (replaced("model", pa.array([["a", "b"], None])), "column model has empty values"),
    ],
)
def test_an_edited_table_is_refused_with_its_file_and_what_to_do(
    tmp_path: Path, edited: pa.Table, words: str
) -> None:
    file = tmp_path / "t.parquet"
    pq.write_table(edited, file)
    with pytest.raises(ResultError) as error:
        read_table(file, SCHEMA, ["ttc"])
    assert str(error.value) == f"{file}: {words}; remove it and run again"


@pytest.fixture
def filled(tmp_path: Path) -> Path:
    with RankFolder(tmp_path / "out", PLAN, SETTINGS) as folder:
        folder.append(REF, moment_part(0, 4))
        folder.fail(Failure.of(moment_ref("two_t1.0"), "off the map"))
    return tmp_path / "out"


def part_of(folder: Path) -> Path:
    (file,) = folder.glob("children/*/*/*.parquet")
    return file


def test_no_flipped_bit_changes_what_a_ranking_reads(filled: Path) -> None:
    file, expected = part_of(filled), moment_part(0, 4).children
    content = file.read_bytes()
    for at in range(0, len(content), 23):
        file.write_bytes(content[:at] + bytes([content[at] ^ 1 << at % 8]) + content[at + 1 :])
        with RankFolder(filled, PLAN, SETTINGS) as folder:
            assert not folder.has(REF, 0) or folder.read(REF, 0).equals(expected), at


def changed(name: str, change: Callable[[list[list[object]]], list[list[object]]]) -> pa.Table:
    children = moment_part(0, 4).children
    values = pa.array(change(children[name].to_pylist()), children[name].type)
    return children.set_column(children.column_names.index(name), name, values)


@pytest.mark.parametrize(
    "edited",
    [
        changed("model", lambda rows: [["granny", *row[1:]] for row in rows]),
        changed("model", lambda rows: [rows[0][:1], *rows[1:]]),
        changed("track_id", lambda rows: [rows[0][:2], *rows[1:]]),
        changed("critical_pairs", lambda rows: [[*rows[0], 7], *rows[1:]]),
        moment_part(0, 4).children.slice(1),
        moment_part(0, 4).children.drop_columns(["ttc"]),
    ],
    ids=["another model", "fewer models", "fewer vehicles", "half a pair", "fewer children", "no column"],
)
def test_an_edited_part_of_a_ranking_runs_again(filled: Path, edited: pa.Table) -> None:
    pq.write_table(edited, part_of(filled))
    with RankFolder(filled, PLAN, SETTINGS) as folder:
        assert not folder.has(REF, 0)


@pytest.mark.parametrize(
    ("old", "new"), [('"time_s": 1.0', '"time_s": "1"'), ('"vehicles": 3', '"vehicles": 4')]
)
def test_an_edited_failure_is_tried_again(filled: Path, old: str, new: str) -> None:
    (file,) = filled.glob("failed/*.json")
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))
    with RankFolder(filled, PLAN, SETTINGS) as folder:
        assert folder.failures() == {}


OTHER = '{"identity": "' + 64 * "0" + '"}'
DAMAGED = ["", "{", '{"identity": 7}', "[]", "\x00"]


@pytest.mark.parametrize("content", [*DAMAGED, OTHER])
def test_a_damaged_mark_of_an_interruption_does_not_stop_it_from_going_on(filled: Path, content: str) -> None:
    (filled / "incomplete.json").write_text(content)
    with RankFolder(filled, PLAN, SETTINGS) as folder:
        assert folder.has(REF, 0)


@pytest.mark.parametrize("content", DAMAGED)
def test_a_finished_ranking_whose_contents_are_damaged_runs_again(filled: Path, content: str) -> None:
    with RankFolder(filled, PLAN, SETTINGS) as folder:
        folder.save_listing(Listing(recording="r", moments=(REF,)))
        write_ranking(filled, table().select(["child", "ttc"]))
        folder.finish({})
    (filled / "rank.json").write_text(content)
    with RankFolder(filled, PLAN, SETTINGS) as folder:
        assert not folder.has(REF, 0)


def test_a_folder_of_the_users_with_such_a_file_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "moments").mkdir()
    for name in ("rank.json", "moments/notes.txt"):
        (tmp_path / name).write_text("mine")
    with pytest.raises(ResultError, match="rank"):
        RankFolder(tmp_path, PLAN, SETTINGS)
    assert {file.read_text() for file in tmp_path.rglob("*.*")} == {"mine"}
