"""Without registered repairs a recording is read, resampled and cut all the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo.converters.datasets import repairs
from scex_sumo.converters.datasets.recordings import recorded_scene
from scex_sumo.converters.datasets.repairs import Repair
from scex_sumo.converters.maps import read_map
from tests.converters.maps import straight, write_map
from tests.converters.track_files import straight as tracks_along
from tests.converters.track_files import write_rows


def test_without_repairs_a_recording_stays_as_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(repairs, "_repairs", lambda: ())
    road = read_map(write_map(tmp_path / "road.osm", [straight(1, -50, 300)]))
    tracks = write_rows(tmp_path / "tracks.csv", tracks_along(1, range(61), start=10.0))
    raw = recorded_scene(tmp_path / "road.osm", tracks=tracks, road=road, repair=False, align=False)
    scene = recorded_scene(tmp_path / "road.osm", tracks=tracks, road=road)
    assert scene.notes == raw.notes and np.array_equal(scene.history.x, raw.history.x)


def test_repairs_come_in_their_order_whatever_their_names(monkeypatch: pytest.MonkeyPatch) -> None:
    def said(word: str, order: int) -> Repair:
        return Repair(order=order, tracks=lambda table, exact: (table, (word,)))

    entries = {"a": said("last", 2), "b": said("first", 0), "c": said("second", 0)}
    monkeypatch.setattr(type(repairs.REPAIRS), "paths", property(lambda self: dict.fromkeys(entries, "")))
    monkeypatch.setattr(type(repairs.REPAIRS), "load", lambda self, name: entries[name])
    repairs._repairs.cache_clear()
    try:
        assert repairs.repair_tracks(None)[1] == ("first", "second", "last")  # type: ignore[arg-type]
    finally:
        repairs._repairs.cache_clear()
