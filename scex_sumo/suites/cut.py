"""Seed scenes of candidates, cut from the recordings of a population."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from scex_sumo.base.errors import UsageError
from scex_sumo.certainty.response.answer import with_rules
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.converters.registries import Recording
from scex_sumo.evaluation.recordings import load_recording, seed_at
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene
from scex_sumo.suites.population import Population
from scex_sumo.suites.situation import Situation, situation_of


def recordings_of(population: Population) -> dict[str, Recording]:
    """Return the recordings of a population by name."""
    return {recording.name: recording for recording in find_recordings(list(population.roots))}


def cutter_of(recordings: Mapping[str, Recording], name: str) -> Cutter:
    """Return one of the recordings of a population; raise a `UsageError` if it is gone."""
    if name not in recordings:
        raise UsageError(f"{name}: a recording of the ranking that is not found any more; rank again")
    return Cutter(recordings[name])


class Cutter:
    """Recording that gives seed scenes."""

    def __init__(self, recording: Recording) -> None:
        self.name, self.loaded = recording.name, load_recording(recording)
        self._bare: dict[Road, Road] = {}

    def situation(self, row: Mapping[str, Any]) -> tuple[SeedScene, Situation]:
        """Return the seed scene of a candidate, with rules, and what happens in it."""
        scene = with_rules(seed_at(self.loaded, row["time_s"], case=row["case"] or None))
        assert scene.road is not None
        if scene.road not in self._bare:
            self._bare = {scene.road: replace(scene.road, net=None)}
        bare = replace(scene, road=self._bare[scene.road])
        return scene, situation_of(bare, row["track_id"], row["other_id"])
