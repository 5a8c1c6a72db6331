"""Split of the moments of recordings into training, validation and test, by time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from scex_sumo.base.errors import UsageError
from scex_sumo.converters.datasets.moment import Moment

Part: TypeAlias = Literal["train", "validation", "test"]
PARTS: tuple[Part, ...] = ("train", "validation", "test")
ROUNDING_S = 1e-6
TARGET_S = 3.0


@dataclass(frozen=True, kw_only=True)
class Split:
    """Split by time into three continuous parts: training, validation, test.

    Attributes:
        validation: share of the recording's time; ``test`` too.
        history_s: time before its moment that a sample sees.
        future_s: time after its moment that a sample uses: 3 s of target and 2 s of driving in between.
        kept_validation: names of short recordings (`whole_part`) for validation.
        kept_test: names of short recordings for test.
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
        """Return the part of a recording that is too short to be cut; None for others."""
        if not self.test or self.test * span_s >= self.history_s + TARGET_S:
            return None
        if name in self.kept_test:
            return "test"
        return "validation" if name in self.kept_validation else "train"

    def part(self, time_s: float, first_s: float, last_s: float) -> Part | None:
        """Return the part of a moment in a recording; None in the gaps between parts."""
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


def split_moments(
    moments: Sequence[Moment], split: Split, name: str | None = None
) -> dict[Part, list[Moment]]:
    """Split the moments of one recording into parts; with its ``name``, a short one is in one part.

    Cases are split by order, one left out between two parts, because neighbours may overlap in time.
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
    whole_part = None if name is None else split.whole_part(name, last_s - first_s)
    for moment in moments:
        part = whole_part or split.part(moment.time_s, first_s, last_s)
        if part is not None:
            parts[part].append(moment)
    return parts
