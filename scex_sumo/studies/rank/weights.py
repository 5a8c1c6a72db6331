"""Weights of the models fitted to the recordings of a ranking, and P of a collision with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from typing import Any

from scex_sumo.base.errors import ScexError
from scex_sumo.behaviors.spec import ModelSpec
from scex_sumo.certainty.fitted import FittedWeights, weights_of
from scex_sumo.certainty.results import TooFewFuturesError, weighted_probability
from scex_sumo.converters.datasets.scene import CleanRecording
from scex_sumo.converters.registries import Recording
from scex_sumo.evaluation.recordings import load_recording
from scex_sumo.metrics.registry import COLLISION
from scex_sumo.results.run import Run


class RecordingWeights:
    """Weights fitted to recordings, each once; notes say why some have none."""

    def __init__(self, models: Sequence[str | ModelSpec]) -> None:
        """Take the models of a study."""
        self._models = [str(model).partition("@")[0] for model in models]
        self._found: dict[str, FittedWeights | None] = {}
        self.notes: list[str] = []

    def of(self, recording: Recording) -> FittedWeights | None:
        """Return the weights of a recording; None if they cannot be fitted."""
        name = recording.name
        if name not in self._found:
            self._found[name] = None
            try:
                loaded = load_recording(recording)
                clean = CleanRecording(table=loaded.table, findings=loaded.findings, repair=True)
                self._found[name] = weights_of(clean, loaded.road, self._models)
            except ScexError as error:  # the ranking is finished
                self.notes.append(f"weights of {name} are not fitted: {error}")
        return self._found[name]

    def to_json(self) -> dict[str, Any]:
        """Return the weights by recording."""
        return {name: one and asdict(one) for name, one in self._found.items()}


def p_fitted(run: Run, row: Mapping[str, Any], fitted: FittedWeights | None) -> float | None:
    """Return P(collision) of an encounter with fitted weights; None where it is not known."""
    if fitted is None or row["person"] is not None:
        return None
    with suppress(TooFewFuturesError):
        return weighted_probability(run, fitted.weights, COLLISION, (row["track_id"], row["other_id"]))
    return None
