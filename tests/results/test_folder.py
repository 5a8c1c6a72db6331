"""A result folder is whole or says that it is not; an interrupted run goes on where it was."""

from __future__ import annotations

import dataclasses
import io
import os
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from scex_sumo.base.errors import ResultError
from scex_sumo.base.files import unlock
from scex_sumo.results.folder import ResultFolder, tracks_table
from scex_sumo.results.parts import PARTS, Part, Parts, joined_parts, save_part
from scex_sumo.results.run import open_run
from scex_sumo.results.tables.states import StateBlocks
from scex_sumo.scene import States
from tests.seeds import straight_seed


def part_of(futures: list[int], steps: int = 3, vehicles: int = 2) -> Part:
    """States and values that tell which future they belong to."""
    numbers = np.asarray(futures)
    x = np.broadcast_to(100.0 * numbers[:, None, None], (len(futures), steps, vehicles)).copy()
    states = States(x=x, y=x + 1, heading=np.zeros_like(x), speed=np.full_like(x, 2.0))
    values = np.broadcast_to(numbers[:, None].astype(float), (len(futures), 12)).copy()
    defined = np.ones((len(futures), 12), dtype=bool)
    defined[:, 3] = False
    worst = pa.table({"future": numbers[::-1], "metric": ["distance"] * len(numbers)})
    return Part(futures=numbers, states=states, values=values, defined=defined, worst=worst)


def test_futures_are_read_some_at_a_time_in_order_from_parts_that_interlock(tmp_path: Path) -> None:
    folder = ResultFolder(tmp_path / "out", {"seed": 1})
    for numbers in ([0, 2, 6], [1, 4], [3, 5]):
        tested = np.stack([np.full((len(numbers), 12), 1.0), part_of(numbers).values], axis=1)
        save_part(folder.path, dataclasses.replace(part_of(numbers), tested=tested))
    pieces = list(folder.in_order(7, size=3))
    assert [piece.futures.tolist() for piece in pieces] == [[0, 1, 2], [3, 4, 5], [6]]
    assert [piece.worst["future"].to_pylist() for piece in pieces] == [[0, 1, 2], [3, 4, 5], [6]]
    assert [piece.states.y[:, 2, 1].tolist() for piece in pieces] == [[1, 101, 201], [301, 401, 501], [601]]
    whole = joined_parts(pieces)
    assert whole.values[:, 0].tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert whole.tested is not None
    assert whole.tested[:, :, 0].T.tolist() == [[1] * 7, [0, 1, 2, 3, 4, 5, 6]]


def test_a_table_written_in_pieces_is_there_whole_or_not_at_all(tmp_path: Path) -> None:
    folder = ResultFolder(tmp_path / "out", {"seed": 1})
    with folder.writer("metrics.parquet") as write:
        write(pa.table({"future": [0, 1]}))
        write(pa.table({"future": [2]}))
    assert pq.read_table(folder.path / "metrics.parquet")["future"].to_pylist() == [0, 1, 2]
    with folder.writer("tracks.parquet"):
        pass
    with pytest.raises(ValueError), folder.writer("plans.parquet") as write:
        write(pa.table({"future": [0]}))
        raise ValueError
    assert sorted(file.name for file in folder.path.glob("*.parquet")) == ["metrics.parquet"]


def test_the_same_run_goes_on_after_an_interruption(tmp_path: Path) -> None:
    save_part(ResultFolder(tmp_path / "out", {"seed": 1}).path, part_of([0, 1]))
    with pytest.raises(ResultError, match="interrupted; the same command resumes it"):
        open_run(tmp_path / "out")
    again = ResultFolder(tmp_path / "out", {"seed": 1})
    assert Parts(again.path).futures.tolist() == [0, 1]


@pytest.mark.parametrize("cut", ["_prepare", "write_atomic"])
def test_a_run_killed_while_it_makes_its_folder_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cut: str
) -> None:
    def killed(target: Path | ResultFolder, *_: object) -> None:
        if isinstance(target, Path):
            (target.parent / f".{target.name}.writing").touch()
        else:
            (target.path / "sumo").mkdir()
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        place = "scex_sumo.results.folder" + ("" if cut == "write_atomic" else ".ResultFolder")
        patch.setattr(f"{place}.{cut}", killed)
        with pytest.raises(KeyboardInterrupt):
            ResultFolder(tmp_path / "out", {"seed": 1})
    unlock(tmp_path / "out")
    assert ResultFolder(tmp_path / "out", {"seed": 1}).path.is_dir()


@pytest.mark.parametrize("damage", ["empty", "cut", "flipped", "shifted", "locked", "foreign"])
def test_a_part_that_a_power_loss_left_broken_is_run_again(tmp_path: Path, damage: str) -> None:
    ResultFolder(tmp_path / "out", {"seed": 1})
    save_part(tmp_path / "out", part_of([0, 1]))
    save_part(tmp_path / "out", part_of([2, 3]))
    broken = sorted((tmp_path / "out" / PARTS).glob("*.npz"))[1]
    whole = broken.read_bytes()
    content = bytearray(whole)
    content[len(content) // 2] ^= 0xFF
    left = {"empty": b"", "cut": bytes(content[: len(content) // 2]), "flipped": bytes(content)}
    flags = whole.index(b"PK\x01\x02") + 8  # of the first file of the archive
    left |= {"shifted": whole[1:], "locked": whole[:flags] + b"\x01" + whole[flags + 1 :]}
    if damage == "foreign":
        with np.load(io.BytesIO(whole)) as data:
            np.savez(broken, **{name: data[name] for name in data if name != "values"})
    else:
        broken.write_bytes(left[damage])
    (broken.parent / ".00000004-00000005.npz.writing").write_bytes(b"half")
    ResultFolder(tmp_path / "out", {"seed": 1})
    assert Parts(tmp_path / "out").futures.tolist() == [0, 1]
    assert len(list(broken.parent.iterdir())) == 1


def test_a_part_with_the_tested_vehicles_in_another_order_of_axes_is_run_again(tmp_path: Path) -> None:
    ResultFolder(tmp_path / "out", {"seed": 1})
    save_part(tmp_path / "out", dataclasses.replace(part_of([0, 1, 2]), tested=np.zeros((2, 3, 12))))
    ResultFolder(tmp_path / "out", {"seed": 1})
    assert not len(Parts(tmp_path / "out").futures)


def test_another_runs_result_is_not_overwritten_unasked(tmp_path: Path) -> None:
    ResultFolder(tmp_path / "out", {"seed": 1}).finish({})
    with pytest.raises(ResultError, match="another run; give another folder"):
        ResultFolder(tmp_path / "out", {"seed": 2})
    other = ResultFolder(tmp_path / "out", {"seed": 2}, overwrite=True)
    assert len(Parts(other.path).futures) == 0


def test_a_folder_of_other_files_is_never_touched(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    for overwrite in (False, True):
        with pytest.raises(ResultError, match="not empty, and no result of scex-sumo"):
            ResultFolder(tmp_path, {"seed": 1}, overwrite=overwrite)
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


def test_overwriting_leaves_files_of_others_alone(tmp_path: Path) -> None:
    ResultFolder(tmp_path / "out", {"seed": 1}).finish({})
    mine = [tmp_path / "out" / name for name in ("explained_by_me.txt", "densities.bib", "sample_size.md")]
    for file in (*mine, tmp_path / "out" / "density.svg"):
        file.write_text("mine")
    ResultFolder(tmp_path / "out", {"seed": 2}, overwrite=True)
    assert not (tmp_path / "out" / "density.svg").exists()
    assert all(file.read_text() == "mine" for file in mine)


def test_a_link_in_a_result_folder_is_never_followed(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "mine.net.xml").write_text("mine")
    ResultFolder(tmp_path / "out", {"seed": 1}).finish({})
    (tmp_path / "out" / "sumo").rmdir()
    (tmp_path / "out" / "sumo").symlink_to(elsewhere)
    with pytest.raises(ResultError, match=r"out/sumo: is a link; remove it, or give another folder"):
        ResultFolder(tmp_path / "out", {"seed": 1})
    ResultFolder(tmp_path / "out", {"seed": 2}, overwrite=True)
    assert [file.name for file in elsewhere.iterdir()] == ["mine.net.xml"]


def test_a_pipe_in_a_result_folder_is_named_and_not_waited_for(tmp_path: Path) -> None:
    ResultFolder(tmp_path / "out", {"seed": 1}).finish({})
    os.mkfifo(tmp_path / "out" / "sumo" / "road.net.xml")
    says = r"out/sumo/road\.net\.xml: is no regular file, but a pipe or a device; remove it"
    with pytest.raises(ResultError, match=says):
        open_run(tmp_path / "out")
    with pytest.raises(ResultError, match=says):
        ResultFolder(tmp_path / "out", {"seed": 1})
    (tmp_path / "out" / "sumo" / "road.net.xml").unlink()
    (tmp_path / "out" / "gone").symlink_to(tmp_path / "nowhere")
    open_run(tmp_path / "out")


def test_tracks_are_interaction_cases_with_the_seed_scene_at_frame_ten() -> None:
    scene = straight_seed()
    table = tracks_table(scene, part_of([0, 1])).to_pydict()
    rows = [i for i in range(len(table["x"])) if table["case_id"][i] == 1 and table["track_id"][i] == 1]
    assert [table["frame_id"][i] for i in rows] == list(range(1, 14))
    assert [table["timestamp_ms"][i] for i in rows][:2] == [100, 200]
    x = [table["x"][i] for i in rows]
    assert x[:10] == pytest.approx(scene.history.x[1, 1:])
    assert x[10:] == [100.0] * 3


@pytest.mark.parametrize("row_group", [9, 18, 100])
def test_states_are_read_a_row_group_at_a_time(tmp_path: Path, row_group: int) -> None:
    """Of four futures with three vehicles and three frames."""
    columns = {name: np.arange(36.0) + k for k, name in enumerate(("x", "y", "vx", "vy", "psi_rad"))}
    file = tmp_path / "tracks.parquet"
    pq.write_table(pa.table(columns), file, row_group_size=row_group)
    blocks = StateBlocks(file, futures=4, vehicles=3, frames=3)
    assert blocks.ends.tolist() == {9: [1, 2, 3, 4], 18: [2, 4]}.get(row_group, [4])
    for future in (3, 0, 1, 2):
        assert blocks.future(future).x.tolist() == columns["x"].reshape(4, 3, 3)[future].tolist()
        assert blocks.future(future).heading.tolist() == columns["psi_rad"].reshape(4, 3, 3)[future].tolist()
    with pytest.raises(ResultError, match=r"has 36 rows, run\.json says 45; run again"):
        StateBlocks(file, futures=5, vehicles=3, frames=3)
