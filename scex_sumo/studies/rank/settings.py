"""Settings of a ranking."""

from __future__ import annotations

from dataclasses import dataclass

from scex_sumo.studies.moments.run import StudySettings


@dataclass(frozen=True, kw_only=True)
class RankSettings(StudySettings):
    """Settings of a ranking; ``run.futures`` are those of the moments on the page.

    Attributes:
        top: encounters on the page.
    """

    top: int = 10

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_positive("top")
