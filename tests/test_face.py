"""The public face: every name comes from where it is said to live, to type checkers and at run time."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import scex_sumo


def announced() -> dict[str, str]:
    """Home of each name as type checkers see it."""
    tree = ast.parse(Path(scex_sumo.__file__).read_text())
    block = next(node for node in tree.body if isinstance(node, ast.If))
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    return {alias.name: str(node.module) for node in imports for alias in node.names}


def test_type_checkers_see_the_names_that_there_are() -> None:
    assert announced() == scex_sumo._HOMES


@pytest.mark.parametrize("name", sorted(scex_sumo._HOMES))
def test_a_public_name_is_defined_in_its_home_and_documented(name: str) -> None:
    if name in ("to_hetero_data", "to_networkx"):
        pytest.importorskip("networkx")
    found = getattr(scex_sumo, name)
    assert found.__module__ == scex_sumo._HOMES[name]
    assert found.__doc__


def test_a_name_that_there_is_not_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'extrapolte'"):
        _ = scex_sumo.extrapolte
