"""Which vehicles are extrapolated: a row of vehicles 10 m apart, and one far away."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.live.moment import Focus

NAMES = [*"abcdefghijklmnop", "far"]
XY = np.array([[10.0 * k, 0.0] for k in range(16)] + [[1000.0, 0.0]])


def names(focus: Focus) -> tuple[str, str]:
    kept, counted = focus.of(NAMES, XY)
    return "".join(NAMES[k] for k in kept), "".join(NAMES[k] for k in counted)


def test_vehicles_near_a_circle_are_driven_and_those_inside_count() -> None:
    assert names(Focus(region=(0.0, 1.0, 20.5))) == ("abcdefghij", "abc")
    assert names(Focus(region="0,1,20.5")) == names(Focus(region=(0.0, 1.0, 20.5)))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"busiest": 1}, "busiest: got 1"),
        ({"region": "1,2"}, "needs X,Y,R"),
        ({"region": (0.0, 0.0, -1.0)}, "radius above 0"),
    ],
)
def test_a_focus_that_makes_no_sense_is_refused(options: dict, words: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(UsageError, match=words):
        Focus(**options)
