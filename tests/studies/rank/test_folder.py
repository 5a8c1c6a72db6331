"""The folder of a ranking: whole parts, found again, and nobody else's."""

from __future__ import annotations

from pathlib import Path

import pyarrow.dataset as pds
import pytest

from scex_sumo.base.errors import ResultError
from scex_sumo.studies.rank.rank import RankFolder
from tests.studies.moments.pairs import moment_ref, pairs_table

PLAN = {"futures": 4, "seed": 0}
ONE, TWO = moment_ref("one_t1.0"), moment_ref("two_t1.0", "there")
PAIRS = pairs_table((1, 2), (2, 3))


@pytest.fixture
def filled(tmp_path: Path) -> Path:
    """Two seeds of two sites."""
    with RankFolder(tmp_path / "out", PLAN) as folder:
        folder.save(ONE, pairs_table())
        folder.save(TWO, PAIRS)
    return tmp_path / "out"


def file_of(filled: Path) -> Path:
    (file,) = filled.glob("pairs/location=there/seed=two_t1.0/*.parquet")
    return file


def test_pairs_that_are_there_are_never_written_again(filled: Path) -> None:
    before = file_of(filled).stat().st_mtime_ns
    with RankFolder(filled, PLAN) as folder:
        folder.save(TWO, PAIRS)
    assert file_of(filled).stat().st_mtime_ns == before


def test_pairs_cut_off_in_the_writing_do_not_count(filled: Path) -> None:
    file = file_of(filled)
    file.rename(file.with_name(f".{file.name}.writing"))
    with RankFolder(filled, PLAN) as folder:
        assert not folder.has(TWO)
        folder.save(TWO, PAIRS)
    assert [path.name for path in file.parent.iterdir()] == [file.name]


@pytest.mark.parametrize("content", [b"", b"PAR1"])
def test_damaged_pairs_run_again(filled: Path, content: bytes) -> None:
    file_of(filled).write_bytes(content)
    with RankFolder(filled, PLAN) as folder:
        assert not folder.has(TWO)
        folder.save(TWO, PAIRS)
        assert folder.pairs(TWO)["other_id"].to_pylist() == [2, 3]


def test_a_stray_copy_of_a_record_changes_nothing(filled: Path) -> None:
    record = filled / "parts" / "two_t1.0.json"
    record.with_name("two_t1.0 (1).json").write_bytes(record.read_bytes())
    with RankFolder(filled, PLAN) as folder:
        assert folder.has(ONE) and folder.has(TWO)


def test_a_listing_of_which_one_letter_was_changed_is_looked_at_again(filled: Path) -> None:
    with RankFolder(filled, PLAN) as folder:
        folder.save_listing("r", (ONE,))
    (file,) = filled.glob("seeds/*.json")
    file.write_text(file.read_text().replace("one_t1.0", "one_t7.0"))
    with RankFolder(filled, PLAN) as folder:
        assert folder.listing("r") is None


def test_the_record_of_a_part_comes_after_its_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that a part that is there is whole, whenever a run is cut off."""
    written: list[str] = []
    replace = Path.replace
    monkeypatch.setattr(
        Path,
        "replace",
        lambda path, to: written.append(to.relative_to(tmp_path).parts[1]) or replace(path, to),
    )
    with RankFolder(tmp_path / "out", PLAN) as folder:
        folder.save(ONE, PAIRS)
    assert written[-2:] == ["pairs", "parts"]


def test_pyarrow_reads_all_pairs_in_one_line(filled: Path) -> None:
    table = pds.dataset(filled / "pairs", partitioning="hive").to_table()
    assert table.num_rows == 3
    assert set(table["seed"].to_pylist()) == {"one_t1.0", "two_t1.0"}


def test_duckdb_reads_all_pairs_in_one_line(filled: Path) -> None:
    duckdb = pytest.importorskip("duckdb")
    query = f"FROM '{filled}/pairs/**/*.parquet' SELECT seed, count(*) GROUP BY seed ORDER BY seed"
    assert duckdb.sql(query).fetchall() == [("one_t1.0", 1), ("two_t1.0", 2)]


def test_files_of_others_in_its_folders_stay(filled: Path) -> None:
    mine = [filled / "pairs/mine.parquet", filled / "pairs/notes/mine.parquet"]
    for file in mine:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("mine")
    with RankFolder(filled, PLAN) as folder:
        assert folder.has(ONE)
    with RankFolder(filled, {"seed": 1}, overwrite=True) as folder:
        assert not folder.has(ONE)
    assert sorted(filled.rglob("*.parquet")) == sorted(mine)


def test_links_in_its_folders_are_not_followed(filled: Path, tmp_path: Path) -> None:
    big = (filled / "pairs").rename(tmp_path / "big")
    there = sorted(big.rglob("*"))
    (filled / "pairs").symlink_to(big)
    for plan in (PLAN, {"seed": 1}):
        with pytest.raises(ResultError, match=r"out/pairs: is a link"):
            RankFolder(filled, plan, overwrite=True)
    assert sorted(big.rglob("*")) == there


def test_pairs_that_a_crash_cut_off_are_removed_by_their_record(
    filled: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def crash(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    three = moment_ref("three_t1.0", "there")
    with RankFolder(filled, PLAN) as folder, pytest.raises(KeyboardInterrupt):
        monkeypatch.setattr("scex_sumo.studies.moments.folder.sha256_of", crash)
        folder.save(three, PAIRS)
    monkeypatch.undo()
    cut = filled / "pairs/location=there/seed=three_t1.0/pairs.parquet"
    assert cut.is_file()
    with RankFolder(filled, PLAN) as folder:
        assert not cut.exists() and not folder.has(three) and folder.has(TWO)
