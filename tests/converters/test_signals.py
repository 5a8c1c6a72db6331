"""Recordings of signal phases that belong to a scene."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from scex_sumo.converters.registries import signals_of
from tests.behaviors.roads import scene_of


def test_phases_beside_the_tracks_belong_to_their_scene(tmp_path: Path) -> None:
    tracks, phases = tmp_path / "vehicle_tracks_003.csv", tmp_path / "signal_phases_003.csv"
    scene = replace(scene_of((0.0, 0.0, 0.0, 1.0)), source={"tracks": str(tracks)})
    assert signals_of(scene) is None
    phases.write_text("signal_group_id,timestamp_ms,movement_state\n")
    assert signals_of(scene) == phases
    assert signals_of(replace(scene, source={})) is None
