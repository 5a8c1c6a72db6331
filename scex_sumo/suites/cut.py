"""Seed scenes of candidates, cut from the recordings of a population, with the rules of their roads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from scex_sumo.base.errors import UsageError
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.converters.registries import Recording
from scex_sumo.evaluation.recordings import load_recording, seed_at
from scex_sumo.extrapolation.job import ruled
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.run import net_of, pack_road
from scex_sumo.suites.population import Population


def recordings_of(population: Population) -> dict[str, Recording]:
    """Return the recordings of a population by name."""
    return {recording.name: recording for recording in find_recordings(list(population.roots))}


class Cutter:
    """Recording that gives seed scenes."""

    def __init__(self, recordings: Mapping[str, Recording], name: str) -> None:
        """Load one of some recordings; raise a `UsageError` if it is gone."""
        if name not in recordings:
            raise UsageError(f"{name}: a recording of the ranking that is not found any more; rank again")
        self.name, self._loaded = name, load_recording(recordings[name])
        self._net = net_of(pack_road(self._loaded.road), True)
        self._bare = replace(self._loaded.road, net=None)

    def scene(self, row: Mapping[str, Any]) -> SeedScene:
        """Return the seed scene of a candidate with its rules, without the road's own net."""
        scene = seed_at(self._loaded, row["time_s"], case=row["case"] or None)
        return replace(ruled(scene, self._net, RunSettings())[0], road=self._bare)
