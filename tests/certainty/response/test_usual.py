"""What is usual: the median of the class of an encounter, and its place by P."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.certainty.response.usual import Population, Usual, ordinal


def encounters(
    *classes: tuple[str, str, list[float]], gap_m: float = 1.0, doubt: str | None = None
) -> pa.Table:
    rows = [
        {"location": site, "kind": kind, "probability": p, "gap_m": gap_m, "doubt": doubt}
        for site, kind, values in classes
        for p in values
    ]
    return pa.Table.from_pylist(rows, schema=SCHEMA)


SCHEMA = pa.schema(
    {"location": pa.string(), "kind": pa.string(), "probability": pa.float64()}
    | {"gap_m": pa.float64(), "doubt": pa.string()}
)
HERE = ("here", "merge", [k * 1e-5 for k in range(1, 22)])  # 21 encounters, median 11e-5
THERE = ("there", "ring", [1e-3] * 3)


def test_encounters_of_the_same_site_and_kind_are_the_class() -> None:
    found = Population(encounters(HERE, THERE)).usual("here", "merge", 20.5e-5)
    assert found == Usual(median=pytest.approx(11e-5), rank=2, of=22, what="at this site")  # type: ignore[arg-type]


def test_with_fewer_than_twenty_the_whole_data_set_is_the_class_and_is_said() -> None:
    found = Population(encounters(HERE, THERE)).usual("there", "ring", 1e-3, counted=True)
    assert found == Usual(median=pytest.approx(12.5e-5), rank=1, of=24, what="in the whole data set")  # type: ignore[arg-type]


def test_an_encounter_that_is_counted_is_not_counted_twice() -> None:
    found = Population(encounters(HERE)).usual("here", "merge", 21e-5, counted=True)
    assert found is not None and (found.rank, found.of) == (1, 21)


def test_distant_and_doubtful_encounters_say_nothing() -> None:
    for others in (encounters(HERE, gap_m=10.1), encounters(HERE, doubt="boxes touch")):
        assert Population(others).usual("here", "merge", 1e-3) is None


def test_a_ranking_is_read_by_its_folder_or_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no finished ranking"):
        Population.read(tmp_path)
    pq.write_table(encounters(HERE), tmp_path / "ranking.parquet")
    assert Population.read(tmp_path).usual("here", "merge", 1e-3) is not None


def test_a_scenario_of_a_site_is_at_this_site() -> None:
    population = Population(encounters(HERE, ("here_2", "merge", [1e-3] * 20)))
    assert population.site_of("here_1_T-79") == "here"
    assert population.site_of("here_2_T-1") == "here_2"
    assert population.site_of("elsewhere") == "elsewhere"


def test_times_the_median_have_one_digit() -> None:
    usual = Usual(median=1e-5, rank=2, of=148, what="at this site")
    assert usual.words(2.96e-4) == "30 × the median at this site, 2nd of 148"
    assert usual.words(0.113) == "10 000 × the median at this site, 2nd of 148"
    assert usual.words(4e-6) == "0.4 × the median at this site, 2nd of 148"


@pytest.mark.parametrize(
    ("number", "words"), [(1, "1st"), (3, "3rd"), (11, "11th"), (22, "22nd"), (112, "112th")]
)
def test_ordinals(number: int, words: str) -> None:
    assert ordinal(number) == words
