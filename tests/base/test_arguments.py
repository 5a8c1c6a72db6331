"""Types of arguments: what fits, and one line for each public function that gets a wrong one."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scex_sumo as scex
from scex_sumo.base.arguments import fits
from scex_sumo.base.errors import UsageError

WRONG = object()
DRIVING = {"candidate_paths", "chosen_paths", "drive", "find_leaders", "path_positions"}
"""What a driver calls in each plan."""
UNCHECKED = {"option", "example_path", "predictor", "behavior", "metric"} | DRIVING  # any object, or a name


class OtherRoad(scex.Road):
    pass


@pytest.mark.parametrize(
    ("value", "wanted", "expected"),
    [
        ("a", "str | Path", True),
        (Path("a"), "str | Path", True),
        (b"a", "str | Path", False),
        (None, "str | Path", False),
        (None, "str | Path | None", True),
        (3, "int", True),
        (np.int64(3), "int", True),
        (True, "int", False),
        (True, "bool", True),
        (1.5, "int", False),
        (np.float32(1.5), "float", True),
        ("1.5", "float", False),
        ((1.0, 2), "tuple[float, float] | None", True),
        (np.zeros(2), "tuple[float, float] | None", True),
        ((1.0,), "tuple[float, float] | None", False),
        ("ab", "tuple[float, float]", False),
        (["a", Path("b")], "str | Path | Sequence[str | Path]", True),
        (["a", 3], "str | Path | Sequence[str | Path]", False),
        (print, "Progress | bool | None", True),
        (3, "Progress | bool | None", False),
        ((None, 3.0), "Window", True),
        ({"a": 1.0}, "Weights", True),
        (3, "Any", True),
        (3, "Literal['min', 'max']", True),
        (3, "Road", False),
        (OtherRoad.__new__(OtherRoad), "Road | None", True),
    ],
)
def test_values_fit_their_annotation(value: object, wanted: str, expected: bool) -> None:
    assert fits(value, wanted) is expected


def public_functions() -> list[str]:
    names = (name for name in scex.__all__ if inspect.isfunction(getattr(scex, name)))
    return [name for name in names if name not in UNCHECKED]


@pytest.mark.parametrize("name", public_functions())
def test_first_argument_of_another_type_is_one_line(name: str) -> None:
    function = getattr(scex, name)
    required = [
        one
        for one in inspect.signature(function).parameters.values()
        if one.default is one.empty and one.kind is not one.VAR_KEYWORD
    ]
    positional = [WRONG for one in required if one.kind is not one.KEYWORD_ONLY]
    others: dict[str, Any] = {one.name: WRONG for one in required if one.kind is one.KEYWORD_ONLY}
    with pytest.raises(scex.ScexError, match="object"):
        function(*positional, **others)


def test_options_of_a_run_are_checked_before_it_starts() -> None:
    scene = scex.read_seed(scex.example_path("roundabout"))
    for option in ({"out": 3}, {"region": [3]}, {"workers": True}, {"settings": 3}, {"progress": 3}):
        with pytest.raises(UsageError, match=f"{next(iter(option))}: got"):
            scex.extrapolate(scene, **option)  # type: ignore[arg-type]
