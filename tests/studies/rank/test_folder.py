"""The folder of a ranking: whole parts, found again, and nobody else's."""

from __future__ import annotations

from pathlib import Path

import pyarrow.dataset as pds
import pyarrow.parquet as pq
import pytest

from scex_sumo.base.errors import ResultError
from scex_sumo.metrics.registry import COLUMNS
from scex_sumo.studies.moments.folder import Failure, Listing
from scex_sumo.studies.rank.futures import RankFolder
from scex_sumo.studies.rank.scores import pairs_of
from tests.studies.rank.parts import DRIVERS, moment_part, moment_ref

PLAN = {"futures": 4, "seed": 0}
ONE, TWO = moment_ref("one_t1.0"), moment_ref("two_t1.0", "there")


@pytest.fixture
def filled(tmp_path: Path) -> Path:
    """Two seeds of two sites, one with a second part."""
    with RankFolder(tmp_path / "out", PLAN) as folder:
        folder.append(ONE, moment_part(0, 4))
        folder.append(ONE, moment_part(4, 8))
        folder.append(TWO, moment_part(0, 4))
    return tmp_path / "out"


def test_a_part_tells_values_models_and_what_is_undefined(filled: Path) -> None:
    with RankFolder(filled, PLAN) as folder:
        table = folder.read(ONE, range(0, 4))
    assert table.column_names == [
        "future",
        *COLUMNS,
        *("fallbacks", "kept", "track_id", "model", "critical_pairs"),
    ]
    assert table[COLUMNS[1]].to_pylist() == [1.0, 101.0, 201.0, 301.0]
    assert table[COLUMNS[-1]].to_pylist() == [None, 111.0, 211.0, 311.0]
    assert table["track_id"].to_pylist() == [[7, 8, 9]] * 4
    assert table["model"].to_pylist() == [list(DRIVERS)] * 4
    assert [rows.tolist() for rows in pairs_of(table)] == [[[7, 9, 1, 500, 9000]], [[7, 9, 0, 0, 0]]] * 2


def test_a_part_that_is_there_is_never_written_again(filled: Path) -> None:
    (file,) = filled.glob("futures/location=there/seed=two_t1.0/*.parquet")
    before = file.stat().st_mtime_ns
    with RankFolder(filled, PLAN) as folder:
        folder.append(TWO, moment_part(0, 4))
    assert file.stat().st_mtime_ns == before


def test_a_part_cut_off_in_the_writing_does_not_count(filled: Path) -> None:
    (file,) = filled.glob("futures/location=there/seed=two_t1.0/*.parquet")
    file.rename(file.with_name(f".{file.name}.writing"))
    with RankFolder(filled, PLAN) as folder:
        assert not folder.has(TWO, range(0, 4))
        folder.append(TWO, moment_part(0, 4))
    assert [path.name for path in file.parent.iterdir()] == [file.name]


@pytest.mark.parametrize("content", [b"", b"PAR1"])
def test_a_damaged_part_runs_again(filled: Path, content: bytes) -> None:
    (file,) = filled.glob("futures/location=there/seed=two_t1.0/*.parquet")
    file.write_bytes(content)
    with RankFolder(filled, PLAN) as folder:
        assert not folder.has(TWO, range(0, 4))
        folder.append(TWO, moment_part(0, 4))
        assert folder.read(TWO, range(0, 4))["future"].to_pylist() == [0, 1, 2, 3]


def test_a_damaged_listing_or_failure_is_looked_at_again(filled: Path) -> None:
    with RankFolder(filled, PLAN) as folder:
        folder.save_listing(Listing(recording="r", moments=(ONE,)))
        folder.fail(Failure.of(ONE, "broken"))
    for file in (*filled.glob("seeds/*.json"), *filled.glob("failed/*.json")):
        file.write_bytes(file.read_bytes()[:9])
    with RankFolder(filled, PLAN) as folder:
        assert folder.listing("r") is None
        assert folder.failures() == {}


def test_a_listing_of_which_one_letter_was_changed_is_looked_at_again(filled: Path) -> None:
    with RankFolder(filled, PLAN) as folder:
        folder.save_listing(Listing(recording="r", moments=(ONE,)))
    (file,) = filled.glob("seeds/*.json")
    file.write_text(file.read_text().replace("one_t1.0", "one_t7.0"))
    with RankFolder(filled, PLAN) as folder:
        assert folder.listing("r") is None


def test_failures_and_listings_are_kept(tmp_path: Path) -> None:
    failure = Failure.of(ONE, "off the map")
    listing = Listing(recording="recording", moments=(ONE, TWO))
    with RankFolder(tmp_path / "out", PLAN) as folder:
        folder.fail(failure)
        folder.save_listing(listing)
    with RankFolder(tmp_path / "out", PLAN) as folder:
        assert folder.failures() == {ONE.moment: failure}
        assert folder.listing("recording") == listing
        assert folder.listing("another") is None
        folder.clear_failure(ONE.moment)
        assert folder.failures() == {}


def test_the_record_of_a_part_comes_after_its_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that a part that is there is whole, whenever a run is cut off."""
    tracks = pq.read_table(_tracks(tmp_path / "t.parquet"))
    written: list[str] = []
    replace = Path.replace
    monkeypatch.setattr(
        Path,
        "replace",
        lambda path, to: written.append(to.relative_to(tmp_path).parts[1]) or replace(path, to),
    )
    with RankFolder(tmp_path / "out", PLAN) as folder:
        folder.append(ONE, moment_part(0, 4, tracks=tracks))
    assert written[-3:] == ["tracks", "futures", "parts"]


def _tracks(path: Path) -> Path:
    import pyarrow as pa

    pq.write_table(pa.table({"case_id": [0, 1], "x": [0.0, 1.0]}), path)
    return path


def test_pyarrow_reads_all_futures_in_one_line(filled: Path) -> None:
    table = pds.dataset(filled / "futures", partitioning="hive").to_table()
    assert table.num_rows == 12
    assert set(table["seed"].to_pylist()) == {"one_t1.0", "two_t1.0"}


def test_duckdb_reads_all_futures_in_one_line(filled: Path) -> None:
    duckdb = pytest.importorskip("duckdb")
    query = f"FROM '{filled}/futures/**/*.parquet' SELECT seed, count(*) GROUP BY seed ORDER BY seed"
    assert duckdb.sql(query).fetchall() == [("one_t1.0", 8), ("two_t1.0", 4)]


def test_files_of_others_in_its_folders_stay(filled: Path) -> None:
    mine = [filled / "futures/mine.parquet", filled / "pairs/notes/mine.parquet"]
    for file in mine:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("mine")
    with RankFolder(filled, PLAN) as folder:
        assert folder.has(ONE, range(0, 4))
    with RankFolder(filled, {"seed": 1}, overwrite=True) as folder:
        assert not folder.has(ONE, range(0, 4))
    assert sorted(filled.rglob("*.parquet")) == sorted(mine)


def test_links_in_its_folders_are_not_followed(filled: Path, tmp_path: Path) -> None:
    big = (filled / "futures").rename(tmp_path / "big")
    there = sorted(big.rglob("*"))
    (filled / "futures").symlink_to(big)
    for plan in (PLAN, {"seed": 1}):
        with pytest.raises(ResultError, match=r"out/futures: is a link"):
            RankFolder(filled, plan, overwrite=True)
    assert sorted(big.rglob("*")) == there


def test_a_part_that_a_crash_cut_off_is_removed_by_its_record(
    filled: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def crash(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with RankFolder(filled, PLAN) as folder, pytest.raises(KeyboardInterrupt):
        monkeypatch.setattr("scex_sumo.studies.moments.folder.sha256_of", crash)
        folder.append(TWO, moment_part(4, 8))
    monkeypatch.undo()
    cut = filled / "futures/location=there/seed=two_t1.0/futures-00004-00007.parquet"
    assert cut.is_file()
    with RankFolder(filled, PLAN) as folder:
        assert not cut.exists() and not folder.has(TWO, range(4, 8)) and folder.has(TWO, range(0, 4))
