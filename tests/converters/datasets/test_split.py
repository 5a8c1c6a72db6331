"""No moment of one part sees or uses anything of another."""

from __future__ import annotations

import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.converters.datasets.moment import Moment
from scex_sumo.evaluation.split import PARTS, Split, split_moments


def _moments(times: list[float], case: str = "") -> list[Moment]:
    return [Moment(case=case and f"{k}", time_s=t, vehicles=1, complete=1) for k, t in enumerate(times)]


def _spans(parts: dict, split: Split, end: float) -> dict:
    """First and last second that the samples of each part see or may use."""
    return {
        part: (
            min(m.time_s for m in found) - split.history_s,
            min(max(m.time_s for m in found) + split.future_s, end),
        )
        for part, found in parts.items()
    }


@pytest.mark.parametrize(("first", "span"), [(0.0, 100.0), (7.3, 383.4), (1000.0, 61.0)])
def test_parts_share_no_second(first: float, span: float) -> None:
    split = Split()
    times = [round(first + 0.1 * k, 3) for k in range(int(10 * span) + 1)]
    spans = _spans(split_moments(_moments(times), split), split, times[-1])
    assert spans["train"][1] <= spans["validation"][0] + 1e-3
    assert spans["validation"][1] <= spans["test"][0] + 1e-3


def test_parts_have_the_shares_asked_for_less_the_gaps() -> None:
    times = [0.1 * k for k in range(1001)]  # 100 s: 70, 10 and 20
    parts = split_moments(_moments(times), Split())
    last = {part: parts[part][-1].time_s for part in PARTS}
    first = {part: parts[part][0].time_s for part in PARTS}
    assert last["train"] == pytest.approx(65.0)  # 5 s of future end at 70
    assert (first["validation"], last["validation"]) == (pytest.approx(71.0), pytest.approx(75.0))
    assert (first["test"], last["test"]) == (pytest.approx(81.0), pytest.approx(100.0))


def test_shares_that_leave_nothing_to_train_on_are_rejected() -> None:
    with pytest.raises(UsageError, match="leave something for training"):
        Split(validation=0.5, test=0.5)


def test_a_recording_too_short_to_be_cut_is_in_the_part_that_names_it_and_else_for_training() -> None:
    split = Split(kept_validation=("a",), kept_test=("b",))
    assert [split.whole_part(name, 9.0) for name in "abc"] == ["validation", "test", "train"]
    assert split.whole_part("a", 30.0) is None
