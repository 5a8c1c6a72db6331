"""Kept nets: the same as converted ones, found again only for the same map, whole, and not too many."""

from __future__ import annotations

from pathlib import Path

import pytest

import scex_sumo
from scex_sumo.converters.net.sumo_net import SumoNet, WrittenNet
from scex_sumo.lanelet2sumo import net as writer
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.road import Road
from scex_sumo.scenarios import EXAMPLES


@pytest.fixture
def conversions(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[str]:
    """The roads that were converted, from an empty cache on."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    real, made = writer.write_net, []

    def counted(road: Road, signals: Path | None) -> WrittenNet:
        made.append(road.name)
        return real(road, signals)

    monkeypatch.setattr(writer, "write_net", counted)
    return made


def road_of(name: str = "roundabout") -> Road:
    road = scex_sumo.read_seed(scex_sumo.example_path(name)).road
    assert road is not None
    return road


def content(net: SumoNet) -> object:
    folder = sorted(net.path.parent.iterdir())
    files = {file.name: file.read_bytes() for file in folder if file.is_file()}
    lanes = {lanelet: net.lanes.sumo_lanes(lanelet) for lanelet, _ in net.lanes.rows}
    return files, net.extras is not None, net.lanes.rows, net.lanes.ends, lanes, net.notes


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_kept_net_is_the_converted_one(name: str, tmp_path: Path, conversions: list[str]) -> None:
    contents = []
    for number, keep in enumerate((False, True, True)):
        folder = tmp_path / f"{number}"
        folder.mkdir()
        contents.append(content(converted(road_of(name), folder / "a.net.xml", keep=keep)))
    assert len(conversions) == 2
    assert contents[0] == contents[1] == contents[2]


@pytest.mark.parametrize("keep", [True, False])
def test_recorded_lights_that_cannot_be_used_are_left_out_with_a_note(tmp_path: Path, keep: bool) -> None:
    signals = tmp_path / "signal_phases_000.csv"
    signals.write_text("rubbish,x\n")
    net = converted(road_of(), tmp_path / "lit.net.xml", keep=keep, signals=signals)
    (note,) = net.notes
    assert note.startswith("recorded lights are left out: ") and "signal_phases_000.csv" in note
    plain = converted(road_of(), tmp_path / "net.net.xml", keep=keep)
    assert net.path.read_bytes() == plain.path.read_bytes() and net.lanes.rows == plain.lanes.rows
