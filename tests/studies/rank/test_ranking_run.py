"""The rounds of a ranking with workers that answer at once: what is run, kept, and gone on with."""

from __future__ import annotations

import csv
import hashlib
import itertools
import shutil
import zlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

import scex_sumo
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.converters.registries import Recording
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.studies.moments.folder import Failure
from scex_sumo.studies.moments.workers import Done
from scex_sumo.studies.rank.exact import ExactScore
from scex_sumo.studies.rank.futures import (
    MomentPart,
    RankFolder,
    RankTask,
    choose_kept,
    futures_table,
    is_pairs,
)
from scex_sumo.studies.rank.places import distinct_moments
from scex_sumo.studies.rank.ranking_run import RankingRun
from scex_sumo.studies.rank.scores import RankSettings, score_of
from scex_sumo.studies.rank.table import moments_table
from tests.studies.moments.pairs import pairs_table

PAIRS = -1  # in the place of the first future
ONE_MODEL = RunSettings(models="standard_driver", futures=96)


class Instant:
    """Workers that make up values from the moment's name and the future's number.

    Attributes:
        asked: moment and first future of every task.
    """

    def __init__(
        self,
        *,
        back_to_front: int = 1,
        bad: str = "",
        bad_from: int = PAIRS,
        died: bool = False,
        stop: int = 10**9,
    ) -> None:
        self.asked: list[tuple[str, int]] = []
        self._size, self._bad, self._died, self._stop = back_to_front, bad, died, stop
        self._bad_from = bad_from

    def notes(self) -> list[str]:
        return []

    def run(self, tasks: Iterable[RankTask]) -> Iterator[Done]:
        waiting = iter(tasks)
        while group := list(itertools.islice(waiting, self._size)):
            for task in reversed(group):
                if len(self.asked) == self._stop:
                    raise KeyboardInterrupt
                self.asked.append((task.ref.moment, task.futures.start if task.futures.stop else PAIRS))
                if task.ref.moment == self._bad and self.asked[-1][1] >= self._bad_from:
                    yield task, Failure.of(task.ref, "bad luck", died=self._died)
                elif is_pairs(task.futures):
                    yield task, made_up_pairs(task)
                elif task.drawn is None:
                    yield task, made_up(task)
                else:
                    yield task, tables(task)

    def close(self) -> None:
        pass


def made_up_pairs(task: RankTask) -> pa.Table:
    """Vehicles 1 and 2: the greater the moment's number, the more severe."""
    return pairs_table(probability=(1 + zlib.crc32(task.ref.moment.encode()) % 7) * 1e-4)


def made_up(task: RankTask) -> MomentPart:
    futures = np.array(task.futures)
    number = int.from_bytes(hashlib.sha256(task.ref.moment.encode()).digest()[:4], "big")
    columns = task.settings.run.columns
    values = np.stack([np.random.default_rng([number, c]).random(len(columns)) for c in futures])
    # The more often vehicles 1 and 2 collide, at 3 m/s, the greater the moment's number.
    hit = values[:, 0] * 7 < number % 7
    pairs = tuple(np.array([[1, 2, 1, 300, 5000]] if h else np.zeros((0, 5)), dtype=np.int64) for h in hit)
    table = futures_table(
        futures,
        columns=columns,
        values=values,
        defined=np.ones(values.shape, dtype=bool),
        fallbacks=np.zeros(len(futures), dtype=np.int64),
        kept=choose_kept(score_of(pairs), task.settings.keep, task.spare),
        track_ids=task.scene.track_ids,
        models=(("standard_driver",) * task.scene.vehicles,) * len(futures),
        pairs=pairs,
    )
    tracks = pa.table({"case_id": futures[np.asarray(table["kept"])]})
    return MomentPart(futures=table, tracks=tracks if len(tracks) else None)


def tables(task: RankTask) -> ExactScore:
    """Tables that settle every other moment."""
    share = len([rows for rows in task.drawn or () if len(rows)]) / task.futures.stop
    even = zlib.crc32(task.ref.moment.encode()) % 2 == 0
    return ExactScore(
        mean=share * even,
        predicted=[share * even] * task.settings.futures,
        settled=even,
        p_collision=share if even else None,
        pairs=[(1, 2, "collision", share)] if even else [],
        extra=70,
        checked=task.futures.stop,
    )


@pytest.fixture(scope="module")
def recordings() -> tuple[Recording, ...]:
    return find_recordings([scex_sumo.example_path("roundabout"), scex_sumo.example_path("motorway_merge")])


def ranked(
    recordings: tuple[Recording, ...],
    path: Path,
    workers: Instant,
    *,
    keep: str = "none",
    top: int = 1,
    first: int = 32,
) -> RankingRun:
    settings = RankSettings(run=ONE_MODEL, every=2.0, top=top, keep=keep, first=first)
    with RankFolder(path, {"plan": 1}) as folder:
        result = RankingRun(recordings, settings, folder, workers)
        result.run()
    return result


def ranked_exactly(
    recordings: tuple[Recording, ...], path: Path, workers: Instant
) -> tuple[RankingRun, pa.Table]:
    run = RunSettings(models="standard_driver,risky_driver", futures=128)
    settings = RankSettings(run=run, every=2.0, top=9, first=32)
    with RankFolder(path, {"plan": 1}) as folder:
        result = RankingRun(recordings, settings, folder, workers)
        result.run()
        return result, moments_table(result)


def contents(path: Path) -> dict[str, bytes]:
    return {str(f.relative_to(path)): f.read_bytes() for f in sorted(path.rglob("*")) if f.is_file()}


def test_every_seed_has_its_first_futures_and_some_have_more(
    recordings: tuple[Recording, ...], tmp_path: Path
) -> None:
    workers = Instant()
    found = ranked(recordings, tmp_path / "out", workers)
    assert {ref.location for ref in found.refs} == {"roundabout", "motorway_merge"}
    first = [seed for seed, future in workers.asked if future == 0]
    assert first == [ref.moment for ref in found.listed]
    more = [seed for seed, future in workers.asked if future == 32]
    assert 0 < len(more) < len(first)
    assert {seed for seed, future in workers.asked if future == 64} <= set(more)


def test_nothing_is_run_twice(recordings: tuple[Recording, ...], tmp_path: Path) -> None:
    workers, again = Instant(), Instant()
    ranked(recordings, tmp_path / "out", workers)
    assert len(set(workers.asked)) == len(workers.asked)
    ranked(recordings, tmp_path / "out", again)
    assert again.asked == []


@pytest.mark.parametrize("size", [2, 5, 100])
def test_the_order_in_which_seeds_finish_changes_no_byte(
    recordings: tuple[Recording, ...], tmp_path: Path, size: int
) -> None:
    ranked(recordings, tmp_path / "one", Instant())
    ranked(recordings, tmp_path / "other", Instant(back_to_front=size))
    assert contents(tmp_path / "one") == contents(tmp_path / "other")


@pytest.mark.parametrize("stop", [0, 1, 7, 15, 17])
def test_wherever_it_is_interrupted_it_goes_on_to_the_same_bytes(
    recordings: tuple[Recording, ...], tmp_path: Path, stop: int
) -> None:
    whole, cut, rest = Instant(), Instant(stop=stop), Instant()
    ranked(recordings, tmp_path / "whole", whole)
    with pytest.raises(KeyboardInterrupt):
        ranked(recordings, tmp_path / "cut", cut)
    ranked(recordings, tmp_path / "cut", rest)
    assert contents(tmp_path / "cut") == contents(tmp_path / "whole")
    assert sorted(cut.asked + rest.asked) == sorted(whole.asked)


def test_without_first_futures_those_of_the_top_encounters_alone_run(
    recordings: tuple[Recording, ...], tmp_path: Path
) -> None:
    workers, again = Instant(), Instant()
    found = ranked(recordings, tmp_path / "out", workers, top=2, first=0)
    assert [moment for moment, start in workers.asked if start == PAIRS] == [r.moment for r in found.listed]
    top = found.encounters["seed"].slice(0, 2).to_pylist()
    assert {moment for moment, start in workers.asked if start == 0} == set(top)
    assert found.stress().keys() == set(top)
    table = moments_table(found).to_pylist()
    assert [row["futures"] for row in table] == [96] * len(set(top)) + [0] * (len(table) - len(set(top)))
    rest = [row["human_severity"] for row in table if not row["futures"]]
    assert rest == sorted(rest, reverse=True)
    ranked(recordings, tmp_path / "out", again, top=2, first=0)
    assert again.asked == []


@pytest.mark.parametrize("stop", [1, 14, 15])
def test_interrupted_among_pairs_or_their_futures_it_goes_on_to_the_same_bytes(
    recordings: tuple[Recording, ...], tmp_path: Path, stop: int
) -> None:
    whole, cut, rest = Instant(), Instant(stop=stop), Instant(back_to_front=3)
    ranked(recordings, tmp_path / "whole", whole, top=3, first=0)
    with pytest.raises(KeyboardInterrupt):
        ranked(recordings, tmp_path / "cut", cut, top=3, first=0)
    ranked(recordings, tmp_path / "cut", rest, top=3, first=0)
    assert contents(tmp_path / "cut") == contents(tmp_path / "whole")
    assert sorted(cut.asked + rest.asked) == sorted(whole.asked)


def test_a_moment_whose_futures_fail_keeps_its_encounters(
    recordings: tuple[Recording, ...], tmp_path: Path
) -> None:
    bad = ranked(recordings, tmp_path / "whole", Instant(), first=0).encounters["seed"][0].as_py()
    found = ranked(recordings, tmp_path / "out", Instant(bad=bad, bad_from=0), first=0)
    assert found.encounters["seed"][0].as_py() == bad
    rows = {row["seed"]: row for row in moments_table(found).to_pylist()}
    assert (rows[bad]["failure"], rows[bad]["futures"]) == ("bad luck", 0)
    assert bad not in {task.ref.moment for task in found.tasks(found.refs)}  # for the page


def flipped(at: int) -> Callable[[bytes], bytes]:
    """Flip a bit of the byte ``at``."""

    def flip(content: bytes) -> bytes:
        changed = bytearray(content)
        changed[at] ^= 1
        return bytes(changed)

    return flip


DAMAGE: dict[str, Callable[[bytes], bytes] | None] = {
    "gone": None,
    "empty": lambda content: b"",
    "cut": lambda content: content[: len(content) // 2],
    "first byte": flipped(0),
    "last byte": flipped(-1),
}


def damage(file: Path, how: str) -> None:
    change, content = DAMAGE[how], file.read_bytes()
    file.unlink()
    if change is not None:
        file.write_bytes(change(content))


@pytest.mark.parametrize("exactly", [False, True])
def test_whichever_file_is_damaged_it_goes_on_to_the_same_bytes(
    recordings: tuple[Recording, ...], tmp_path: Path, exactly: bool
) -> None:
    """Also the first part of a moment while a later one is kept, tracks, listings, failures, tables."""
    whole, bad = tmp_path / "whole", "roundabout_t6.1"

    def run(path: Path) -> pa.Table | None:
        if exactly:
            return ranked_exactly(recordings, path, Instant(bad=bad))[1]
        ranked(recordings, path, Instant(bad=bad), keep="critical")
        return None

    table = run(whole)
    expected = contents(whole)
    of_kind: dict[str, list[str]] = {}
    for name in sorted(expected, key=lambda name: (name.count("/"), name)):
        of_kind.setdefault(name.split("/")[0], []).append(name)
    later = next(name for name in of_kind["futures"] if "-00064-" in name)
    of_kind["first part"] = [str(next((whole / later).parent.glob("futures-00000-*")).relative_to(whole))]
    how = itertools.cycle(DAMAGE)
    for kind in ("exact", "first part") if exactly else of_kind:
        for name in {of_kind[kind][0], of_kind[kind][-1]}:
            cut = tmp_path / "cut"
            shutil.copytree(whole, cut)
            damage(cut / name, next(how))
            again = run(cut)
            assert contents(cut) == expected, name
            assert again is None or again.equals(table), name
            shutil.rmtree(cut)


def test_a_seed_that_fails_is_recorded_and_not_tried_again(
    recordings: tuple[Recording, ...], tmp_path: Path
) -> None:
    bad = "roundabout_t6.1"
    found = ranked(recordings, tmp_path / "out", Instant(bad=bad))
    assert found.failures[bad].reason == "bad luck"
    assert bad not in {ref.moment for ref in found.refs}
    again = Instant()
    assert ranked(recordings, tmp_path / "out", again).failures == found.failures
    assert again.asked == []


def test_a_seed_whose_workers_died_is_tried_again(recordings: tuple[Recording, ...], tmp_path: Path) -> None:
    bad = "roundabout_t6.1"
    ranked(recordings, tmp_path / "out", Instant(bad=bad, died=True))
    again = Instant()
    found = ranked(recordings, tmp_path / "out", again)
    assert again.asked[0] == (bad, PAIRS)
    assert found.failures == {}
    assert not list((tmp_path / "out" / "failed").iterdir())


@pytest.mark.parametrize("bad", ["roundabout_t6.1", "roundabout_t10.1", "motorway_merge_t10.1"])
def test_after_a_death_it_goes_on_to_the_bytes_of_a_ranking_without_one(
    recordings: tuple[Recording, ...], tmp_path: Path, bad: str
) -> None:
    """Moments that were undecided only because another one was missing lose their further futures."""
    whole = ranked(recordings, tmp_path / "whole", Instant())
    assert bad in {ref.moment for ref in whole.refs}
    ranked(recordings, tmp_path / "out", Instant(bad=bad, died=True))
    ranked(recordings, tmp_path / "out", Instant())
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_at_most_five_futures_of_a_seed_are_kept(recordings: tuple[Recording, ...], tmp_path: Path) -> None:
    found = ranked(recordings, tmp_path / "out", Instant(), keep="critical")
    kept = [sum(tally.kept for tally in found.tallies[ref.moment]) for ref in found.refs]
    assert max(kept) == 5


def test_every_case_of_a_file_of_cases_is_a_seed(tmp_path: Path) -> None:
    """Four cases of 4 s each, cut from the recording of 18 s; each case is its own situation."""
    source = scex_sumo.example_path("roundabout")
    (tmp_path / "maps").mkdir()
    (tmp_path / "train").mkdir()
    shutil.copy(source, tmp_path / "maps" / "roundabout.osm")
    with source.with_suffix(".csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    with (tmp_path / "train" / "roundabout_train.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, ["case_id", *rows[0]])
        writer.writeheader()
        for case in range(4):
            for row in rows:
                frame = int(row["frame_id"]) - 40 * case
                if 1 <= frame <= 40:
                    own = {"case_id": f"{case + 1}.0", "frame_id": frame, "timestamp_ms": 100 * frame}
                    writer.writerow(row | own)
    workers = Instant()
    found = ranked(find_recordings([tmp_path]), tmp_path / "out", workers, top=4)
    assert [ref.case for ref in found.refs] == ["1.0", "2.0", "3.0", "4.0"]
    assert {ref.time_s for ref in found.refs} == {1.0}
    assert len({ref.moment for ref in found.refs}) == 4
    assert found.failures == {}
    assert len(distinct_moments(found.refs, range(4), 4)) == 4


def test_a_moment_with_an_exact_score_gets_no_more_futures(
    recordings: tuple[Recording, ...], tmp_path: Path
) -> None:
    workers = Instant()
    found, table = ranked_exactly(recordings, tmp_path / "out", workers)
    rows = {row["seed"]: row for row in table.to_pylist()}
    exact = {ref.moment: found.tallies[ref.moment][-1].exact for ref in found.refs}
    settled = {name for name, one in exact.items() if one is not None and one.settled}
    open_ = {name for name, one in exact.items() if one is not None and not one.settled}
    assert settled
    assert {rows[name]["futures"] for name in settled} == {64}
    assert {rows[name]["remainder"] for name in settled} == {3 / 64}
    assert all(rows[name]["p_collision_low"] == rows[name]["p_collision_high"] for name in settled)
    assert max(rows[name]["futures"] for name in open_) > 64
    assert {rows[name]["remainder"] for name in open_} == {None}
    assert {rows[name]["extra"] for name in settled | open_} == {70}


def test_interrupted_among_its_tables_it_goes_on_to_the_same_bytes(
    recordings: tuple[Recording, ...], tmp_path: Path
) -> None:
    whole, rest = Instant(), Instant(back_to_front=3)
    _, table = ranked_exactly(recordings, tmp_path / "whole", whole)
    cut = Instant(stop=int(0.6 * len(whole.asked)))
    with pytest.raises(KeyboardInterrupt):
        ranked_exactly(recordings, tmp_path / "cut", cut)
    _, again = ranked_exactly(recordings, tmp_path / "cut", rest)
    assert contents(tmp_path / "cut") == contents(tmp_path / "whole")
    assert again.equals(table)
    assert sorted(cut.asked + rest.asked) == sorted(whole.asked)
