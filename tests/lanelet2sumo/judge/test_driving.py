"""SUMO's cars drive on nets that are awkward to drive on, and errors of the file system are one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.base.errors import SimulationError
from scex_sumo.lanelet2sumo.judge.report import check_net, drive_net
from tests.converters.plain_net import crossing, write_net

HALVES = {"a": "-20,0 0,20 20,0", "b": "20,0 0,-20 -20,0"}


def closed_circuit(folder: Path) -> Path:
    """A ring of two edges that nothing leads into or out of."""
    edges = "".join(
        f'<edge id="{i}" from="{i}0" to="{j}0"><lane id="{i}_0" index="0" speed="9" length="56.5"'
        f' shape="{HALVES[i]}"/></edge>'
        for i, j in (("a", "b"), ("b", "a"))
    )
    junctions = "".join(
        f'<junction id="{i}0" type="priority" x="{x}" y="0" incLanes="{j}_0" intLanes=""'
        f' shape="{x},-2 {x},2">'
        '<request index="0" response="0" foes="0" cont="0"/></junction>'
        for i, j, x in (("a", "b", -20), ("b", "a", 20))
    )
    links = "".join(
        f'<connection from="{i}" to="{j}" fromLane="0" toLane="0" dir="s" state="M"/>'
        for i, j in ("ab", "ba")
    )
    path = folder / "ring.net.xml"
    path.write_text(f'<net version="1.20">{edges}{junctions}{links}</net>', encoding="utf-8")
    return path


def test_cars_drive_on_a_closed_circuit(tmp_path: Path) -> None:
    report = drive_net(closed_circuit(tmp_path), vehicles=6)
    assert (report["arrived"], report["routes"]) == (6, 2)


def test_a_full_temporary_folder_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def cut_short(_: Path, folder: Path, __: float) -> list[str]:
        """SUMO itself ends well when the disk is full."""
        (folder / "fcd.xml").write_text("<fcd-export><timestep", encoding="utf-8")
        return []

    net = write_net(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr("scex_sumo.lanelet2sumo.judge.driving._simulate", cut_short)
        with pytest.raises(SimulationError, match=r"^[^\n]*free some space[^\n]*$"):
            drive_net(net, vehicles=2)
    monkeypatch.setattr("tempfile.tempdir", "/dev/full")
    with pytest.raises(SimulationError, match=r"^[^\n]*free some space[^\n]*$"):
        drive_net(net, vehicles=2)


def test_commas_in_paths_reach_sumo_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "one,two"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    assert drive_net(write_net(folder), vehicles=2)["arrived"] == 2


def test_a_net_with_a_comma_in_its_name_is_refused_in_one_line(tmp_path: Path) -> None:
    net = write_net(tmp_path).rename(tmp_path / "a,b.net.xml")
    with pytest.raises(SimulationError, match=r"^a,b\.net\.xml: SUMO splits paths at commas"):
        check_net(net, crossing())
