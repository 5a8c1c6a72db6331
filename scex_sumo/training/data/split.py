"""Split of a recording: which moments are for training, which for validation, which for test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from scex_sumo.converters.moments.moments import Moment
from scex_sumo.errors import UsageError

Part: TypeAlias = Literal["train", "validation", "test"]
PARTS: tuple[Part, ...] = ("train", "validation", "test")
ROUNDING_S = 1e-6
TARGET_S = 3.0


@dataclass(frozen=True, kw_only=True)
class Split:
    """A split by time: training first, then validation, then test, each part of one piece.

    Attributes:
        validation: share of the recording's time for validation.
        test: share at its end for test.
        history_s: what a sample sees before its moment, s.
        future_s: what a sample may use after its moment, s: 3 s of target and 2 s of driving in between.
        kept_validation: names of short recordings (`whole_part`) that are for validation as a whole.
        kept_test: names of those for test.
    """

    validation: float = 0.1
    test: float = 0.2
    history_s: float = 1.0
    future_s: float = 5.0
    kept_validation: tuple[str, ...] = ()
    kept_test: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not (self.validation >= 0 and self.test >= 0 and self.validation + self.test < 1):
            raise UsageError(
                f"split: validation {self.validation:g} and test {self.test:g} must be shares that leave "
                "something for training"
            )

    def whole_part(self, name: str, span_s: float) -> Part | None:
        """The part that a recording is in as a whole: one too short to have a sample in a part for test.

        None for a longer one, which is cut. Short ones that are kept for nothing else are for training.
        """
        if not self.test or self.test * span_s >= self.history_s + TARGET_S:
            return None
        if name in self.kept_test:
            return "test"
        return "validation" if name in self.kept_validation else "train"

    def part(self, time_s: float, first_s: float, last_s: float) -> Part | None:
        """The part that a moment belongs to, or None in the gaps between the parts.

        All that a sample sees and may use lies within its part, but at the end of the test part, where the
        recording itself ends.

        Args:
            time_s: the moment.
            first_s: begin of the recording.
            last_s: its end.
        """
        span = last_s - first_s
        validation_s = first_s + (1 - self.validation - self.test) * span
        test_s = first_s + (1 - self.test) * span
        begin, end = time_s - self.history_s + ROUNDING_S, time_s + self.future_s - ROUNDING_S
        if end <= validation_s:
            return "train"
        if begin >= test_s:
            return "test"
        if begin >= validation_s and end <= test_s:
            return "validation"
        return None


def split_moments(moments: Sequence[Moment], split: Split) -> dict[Part, list[Moment]]:
    """Moments by part.

    The cases of a file of cases (INTERACTION v1.2) are split by their order, with one case left out between
    two parts, for neighbours may overlap in time.

    Args:
        moments: of one recording, in order.
    """
    parts: dict[Part, list[Moment]] = {part: [] for part in PARTS}
    if not moments:
        return parts
    if moments[0].case:
        count = len(moments)
        validation, test = round((1 - split.validation - split.test) * count), round((1 - split.test) * count)
        parts["train"] = list(moments[: max(0, validation - 1)])
        parts["validation"] = list(moments[validation : max(validation, test - 1)])
        parts["test"] = list(moments[test:])
        return parts
    first_s, last_s = moments[0].time_s, moments[-1].time_s
    for moment in moments:
        part = split.part(moment.time_s, first_s, last_s)
        if part is not None:
            parts[part].append(moment)
    return parts
