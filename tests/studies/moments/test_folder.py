"""Parts of studies: whole and of their moment, or not there."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq
import pytest

from scex_sumo.base.errors import ResultError
from scex_sumo.studies.moments.folder import Failure
from scex_sumo.studies.rank.rank import RankFolder
from tests.studies.moments.pairs import moment_ref, pairs_table

PLAN = {"seed": 0}
REF = moment_ref("one_t1.0")


@pytest.fixture
def filled(tmp_path: Path) -> Path:
    with RankFolder(tmp_path / "out", PLAN) as folder:
        folder.save(REF, pairs_table((1, 2), (2, 3)))
        folder.fail(Failure.of(moment_ref("two_t1.0"), "off the map"))
    return tmp_path / "out"


def part_of(folder: Path) -> Path:
    (file,) = folder.glob("pairs/*/*/*.parquet")
    return file


def test_no_flipped_bit_changes_what_a_ranking_reads(filled: Path) -> None:
    for file in (part_of(filled), *filled.glob("parts/*.json")):
        before = {name: name.read_bytes() for name in (part_of(filled), *filled.glob("parts/*.json"))}
        for at in range(0, len(before[file]), 23):
            for name, content in before.items():
                name.write_bytes(content)
            content = before[file]
            file.write_bytes(content[:at] + bytes([content[at] ^ 1 << at % 8]) + content[at + 1 :])
            with RankFolder(filled, PLAN) as folder:
                assert not folder.has(REF), at
        for name, content in before.items():
            name.write_bytes(content)


def test_a_part_under_the_name_of_another_moment_runs_again(filled: Path) -> None:
    other = moment_ref("three_t1.0")
    with RankFolder(filled, PLAN) as folder:
        folder.save(other, pairs_table((1, 2), (1, 3)))
    one, three = (next(filled.glob(f"pairs/*/seed={name}_t1.0/*")) for name in ("one", "three"))
    three.write_bytes(one.read_bytes())
    (filled / "parts/four_t1.0.json").write_bytes((filled / "parts/one_t1.0.json").read_bytes())
    with RankFolder(filled, PLAN) as folder:
        assert folder.has(REF) and not folder.has(other)
        assert not folder.has(moment_ref("four_t1.0"))


def test_a_part_that_changes_while_a_ranking_runs_is_named(filled: Path) -> None:
    with RankFolder(filled, PLAN) as folder:
        pq.write_table(pairs_table((2, 3)), part_of(filled))
        with pytest.raises(ResultError, match="was changed meanwhile; run the same command again"):
            folder.pairs(REF)


def test_a_folder_of_the_users_with_such_a_file_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "moments").mkdir()
    for name in ("rank.json", "moments/notes.txt"):
        (tmp_path / name).write_text("mine")
    with pytest.raises(ResultError, match="rank"):
        RankFolder(tmp_path, PLAN)
    assert {file.read_text() for file in tmp_path.rglob("*.*")} == {"mine"}
