"""The public face: every name comes from where the stub says."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import get_args

import pytest

import scex_sumo


def announced() -> dict[str, str]:
    """Home of each name as type checkers see it."""
    tree = ast.parse(Path(scex_sumo.__file__).with_suffix(".pyi").read_text())
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    return {alias.name: f"scex_sumo.{node.module}" for node in imports for alias in node.names}


def test_the_names_are_those_of_the_stub() -> None:
    assert sorted(scex_sumo.__all__) == sorted([*announced(), "__version__"])


@pytest.mark.parametrize(("name", "home"), sorted(announced().items()))
def test_a_public_name_is_defined_in_its_home_and_documented(name: str, home: str) -> None:
    if name in ("to_hetero_data", "to_networkx"):
        pytest.importorskip("networkx")
    found = getattr(scex_sumo, name)
    for part in get_args(found) or (found,):  # of a union
        assert part.__module__ == home
        assert part.__doc__


def test_an_empty_plan_is_a_plan() -> None:
    plan = scex_sumo.Plan.empty((2, 30))
    assert isinstance(plan, scex_sumo.Plan)
    assert (plan.x.shape, plan.fallback) == ((2, 30), None)


def test_a_name_that_there_is_not_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="extrapolte"):
        _ = scex_sumo.extrapolte
