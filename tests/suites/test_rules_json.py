"""Rules of a case come back from its files as they were, lights included."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from scex_sumo.base.schema import faults
from scex_sumo.road_rules import Passage, Rules, Signal
from scex_sumo.suites.suite import LIGHTS, RULES, lights_to_json, rules_of_json, rules_to_json


def test_rules_and_lights_come_back() -> None:
    ways = [
        Passage(line=np.array([[0.1, 0.2], [3.0, 1 / 3]]), lanes=(1, 2), state="m", signal=0, yields_to=(1,)),
        Passage(line=np.array([[0.0, 0.0], [0.0, 9.0]]), lanes=(3,), state="M", signal=-1, yields_to=()),
    ]
    lights = (Signal(letters="Gyr", ends_s=np.array([9.0, 12.0, 30.0]), start_s=8.9), Signal())
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    rules = Rules(passages=tuple(ways), signals=lights, stop_lines=(square[:2],), crosswalks=(square,))
    written = json.dumps([rules_to_json(rules), lights_to_json(rules)], allow_nan=False)
    found = rules_of_json(*json.loads(written))
    assert not [*faults(json.loads(written)[0], RULES), *faults(json.loads(written)[1], LIGHTS)]
    for one, other in zip(found.passages, ways, strict=True):
        assert np.array_equal(one.line, other.line)
        assert {**vars(one), "line": 0} == {**vars(other), "line": 0}
    assert [found.signals[0].at(t)[0] for t in (0.0, 0.2, 3.3)] == ["G", "y", "r"]
    assert found.signals[1].at(0.0) == ("", 0.0)
    assert np.array_equal(found.stop_lines[0], square[:2])
    assert np.array_equal(found.crosswalks[0], square)


@pytest.mark.parametrize(
    ("passage", "light", "says"),
    [
        ({"signal": 1}, {}, "a light that is not there"),
        ({"yields_to": [1]}, {}, "a light that is not there"),
        ({}, {"ends_s": [9.0]}, "has not one end for each phase"),
        ({}, {"ends_s": [9.0, 3.0]}, "has not one end for each phase"),
    ],
)
def test_rules_that_do_not_fit_together_are_refused(
    passage: dict[str, Any], light: dict[str, Any], says: str
) -> None:
    one = {"line": [[0.0, 0.0], [9.0, 0.0]], "lanes": [1], "state": "M", "signal": 0, "yields_to": []}
    content = {"passages": [one | passage], "stop_lines": [], "crosswalks": []}
    with pytest.raises(ValueError, match=says):
        rules_of_json(content, [{"letters": "Gr", "ends_s": [3.0, 9.0], "start_s": 0.0} | light])
