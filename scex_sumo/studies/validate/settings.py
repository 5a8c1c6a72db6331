"""Validation settings, and the moments that are validated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.models.population import population_digest
from scex_sumo.converters.datasets.moment import PARTS, Moment, Split, split_moments
from scex_sumo.converters.datasets.recordings import LoadedRecording, Recording, recording_moments
from scex_sumo.scene import STEP_S
from scex_sumo.studies.moments.run import StudySettings

ALL = "all"


@dataclass(frozen=True, kw_only=True)
class ValidationSettings(StudySettings):
    """Settings of a validation.

    Attributes:
        part: ``train``, ``validation`` or ``test`` of each recording's time, as for learned drivers, or
            ``all``.
    """

    part: str = ALL

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.part not in (*PARTS, ALL):
            raise UsageError(f"--part {self.part}: unknown; choose {', '.join(PARTS)} or {ALL}")

    def to_json(self, recordings: Sequence[Recording]) -> dict[str, Any]:
        """Return the values that identify the validation of some recordings."""
        # first, top and keep as of a ranking that gives every moment all children
        shared = self.identity(recordings, first=self.children, top=10, keep="none")
        return {**shared, "part": self.part, "population": population_digest()}

    def moments(self, loaded: LoadedRecording) -> Sequence[Moment]:
        """Return the moments of the part of a recording, at least ``every`` seconds apart."""
        found = recording_moments(loaded, every_s=STEP_S)
        if self.part != ALL:
            found = split_moments(found, Split())[self.part]  # type: ignore[index]
        else:  # from the first that can be judged on: a recording shorter than ``every`` has one, too
            found = [moment for moment in found if moment.case or moment.complete]
        moments: list[Moment] = []
        for moment in found:
            if not moments or moment.case or moment.time_s >= moments[-1].time_s + self.every - 1e-6:
                moments.append(moment)
        return moments
