"""Runs of a ranking with workers that answer at once: what is run, kept, and gone on with."""

from __future__ import annotations

import csv
import dataclasses
import itertools
import shutil
import zlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import pyarrow as pa
import pytest

import scex_sumo
from scex_sumo.base.errors import TrackError
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.converters.registries import Recording
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.studies.moments.folder import Failure, MomentRef
from scex_sumo.studies.moments.run import Done, MomentTask, StudySettings, Work
from scex_sumo.studies.moments.study import MomentRun
from scex_sumo.studies.rank.rank import MOMENTS, RankFolder, moments_table, run_moment
from tests.studies.moments.pairs import pairs_table

SETTINGS = StudySettings(run=RunSettings(models="standard_driver", futures=96), every=2.0)


class Instant:
    """Workers that make up pairs: the greater the moment's number, the more severe.

    Attributes:
        asked: moment of every task.
    """

    def __init__(
        self, *, back_to_front: int = 1, bad: str = "", died: bool = False, stop: int = 10**9
    ) -> None:
        self.asked: list[str] = []
        self._size, self._bad, self._died, self._stop = back_to_front, bad, died, stop

    def run_each(self, work: Work, tasks: Iterable[MomentTask]) -> Iterator[Done]:
        waiting = iter(tasks)
        while group := list(itertools.islice(waiting, self._size)):
            for task in reversed(group):
                if len(self.asked) == self._stop:
                    raise KeyboardInterrupt
                name = task.ref.moment
                self.asked.append(name)
                if name == self._bad:
                    yield task, Failure.of(task.ref, "bad luck", died=self._died)
                else:
                    yield task, pairs_table(probability=(1 + zlib.crc32(name.encode()) % 7) * 1e-4)


@pytest.fixture(scope="module")
def recordings() -> tuple[Recording, ...]:
    return find_recordings([scex_sumo.example_path("roundabout"), scex_sumo.example_path("motorway_merge")])


def ranked(recordings: tuple[Recording, ...], path: Path, workers: Instant) -> MomentRun:
    with RankFolder(path, {"plan": 1}) as folder:
        result = MomentRun(recordings, SETTINGS, folder, workers)
        result.run(run_moment)
    return result


def pairs_of(run: MomentRun) -> list[tuple[MomentRef, pa.Table]]:
    assert isinstance(run.folder, RankFolder)
    return [(ref, run.folder.pairs(ref)) for ref in run.refs]


def contents(path: Path) -> dict[str, bytes]:
    return {str(f.relative_to(path)): f.read_bytes() for f in sorted(path.rglob("*")) if f.is_file()}


def test_every_moment_is_run_once(recordings: tuple[Recording, ...], tmp_path: Path) -> None:
    workers, again = Instant(), Instant()
    found = ranked(recordings, tmp_path / "out", workers)
    assert {ref.location for ref in found.refs} == {"roundabout", "motorway_merge"}
    assert workers.asked == [ref.moment for ref in found.listed] == [ref.moment for ref in found.refs]
    ranked(recordings, tmp_path / "out", again)
    assert again.asked == []


def test_moments_are_in_the_table_by_p_then_what_failed(
    recordings: tuple[Recording, ...], tmp_path: Path
) -> None:
    bad = "roundabout_t6.1"
    found = ranked(recordings, tmp_path / "out", Instant(bad=bad))
    table = moments_table(found, pairs_of(found))
    assert table.schema == MOMENTS
    *rows, last = table.to_pylist()
    chances = [row["human_p_collision"] for row in rows]
    assert len(rows) == len(found.refs) and chances == sorted(chances, reverse=True)
    assert (last["seed"], last["failure"], last["human_p_collision"]) == (bad, "bad luck", None)
    assert {row["failure"] for row in rows} == {None}


def test_recordings_without_a_moment_are_refused_with_the_reason(tmp_path: Path) -> None:
    (one,) = find_recordings([scex_sumo.example_path("roundabout")])
    broken = dataclasses.replace(one, name="broken", track_paths=(tmp_path / "nowhere.csv",))
    with pytest.raises(TrackError, match=r"the first of 1 failures: .*nowhere\.csv"):
        moments_table(ranked((broken,), tmp_path / "out", Instant()), [])


@pytest.mark.parametrize("size", [2, 5, 100])
def test_the_order_in_which_seeds_finish_changes_no_byte(
    recordings: tuple[Recording, ...], tmp_path: Path, size: int
) -> None:
    ranked(recordings, tmp_path / "one", Instant())
    ranked(recordings, tmp_path / "other", Instant(back_to_front=size))
    assert contents(tmp_path / "one") == contents(tmp_path / "other")


@pytest.mark.parametrize("stop", [0, 1, 7])
def test_wherever_it_is_interrupted_it_goes_on_to_the_same_bytes(
    recordings: tuple[Recording, ...], tmp_path: Path, stop: int
) -> None:
    whole, cut, rest = Instant(), Instant(stop=stop), Instant(back_to_front=3)
    ranked(recordings, tmp_path / "whole", whole)
    with pytest.raises(KeyboardInterrupt):
        ranked(recordings, tmp_path / "cut", cut)
    ranked(recordings, tmp_path / "cut", rest)
    assert contents(tmp_path / "cut") == contents(tmp_path / "whole")
    assert sorted(cut.asked + rest.asked) == sorted(whole.asked)


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


def test_whichever_file_is_damaged_it_goes_on_to_the_same_bytes(
    recordings: tuple[Recording, ...], tmp_path: Path
) -> None:
    """Pairs, their records, listings and failures."""
    whole, bad = tmp_path / "whole", "roundabout_t6.1"
    ranked(recordings, whole, Instant(bad=bad))
    expected = contents(whole)
    of_kind: dict[str, list[str]] = {}
    for name in sorted(expected):
        of_kind.setdefault(name.split("/")[0], []).append(name)
    assert {"pairs", "parts", "seeds", "failed"} <= of_kind.keys()
    how = itertools.cycle(DAMAGE)
    for kind in of_kind:
        for name in {of_kind[kind][0], of_kind[kind][-1]}:
            cut = tmp_path / "cut"
            shutil.copytree(whole, cut)
            damage(cut / name, next(how))
            ranked(recordings, cut, Instant(bad=bad))
            assert contents(cut) == expected, name
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


@pytest.mark.parametrize("bad", ["roundabout_t6.1", "motorway_merge_t10.1"])
def test_a_seed_whose_workers_died_is_tried_again_to_the_bytes_of_a_ranking_without_a_death(
    recordings: tuple[Recording, ...], tmp_path: Path, bad: str
) -> None:
    ranked(recordings, tmp_path / "whole", Instant())
    ranked(recordings, tmp_path / "out", Instant(bad=bad, died=True))
    again = Instant()
    found = ranked(recordings, tmp_path / "out", again)
    assert again.asked == [bad]
    assert found.failures == {}
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


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
    found = ranked(find_recordings([tmp_path]), tmp_path / "out", Instant())
    assert [ref.case for ref in found.refs] == ["1.0", "2.0", "3.0", "4.0"]
    assert {ref.time_s for ref in found.refs} == {1.0}
    assert len({ref.moment for ref in found.refs}) == 4
    assert found.failures == {}
