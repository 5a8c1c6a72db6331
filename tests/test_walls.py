"""No import by string hides an arrow between our modules from import-linter."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import scex_sumo

PACKAGE = Path(scex_sumo.__file__).parent
ALLOWED = {"base/importing.py", "base/registry.py", "__init__.py"}
IMPORTERS = {"import_module", "__import__", "find_spec", "import_object"}


def imports_by_string(source: str) -> Iterator[int]:
    """Lines with an import of one of our modules by string; names that are computed count as ours."""
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call) or not node.args:
            continue
        function = node.func
        name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
        if name not in IMPORTERS:
            continue
        what = node.args[0]
        if isinstance(what, ast.Constant):
            if str(what.value).startswith("scex_sumo"):
                yield node.lineno
        elif isinstance(what, ast.JoinedStr) or any(
            isinstance(part, ast.Name) and part.id in ("__name__", "__package__") for part in ast.walk(what)
        ):
            yield node.lineno


def test_code_key_are_imported_by_statements() -> None:
    found = []
    for file in sorted(PACKAGE.rglob("*.py")):
        name = file.relative_to(PACKAGE).as_posix()
        if name not in ALLOWED:
            found += [f"{name}:{line}" for line in imports_by_string(file.read_text(encoding="utf-8"))]
    assert found == []


@pytest.mark.parametrize(
    "source",
    [
        'import_module("scex_sumo.reports")',
        'importlib.import_module("scex_sumo.reports").page',
        '__import__("scex_sumo")',
        'importlib.import_module(f"scex_sumo.{name}")',
        'import_object("scex_sumo.reports:page")',
        'import_module(__name__ + ".page")',
    ],
)
def test_an_import_by_string_is_found(source: str) -> None:
    assert list(imports_by_string(source)) == [1]


def test_others_modules_may_be_imported_by_string() -> None:
    assert list(imports_by_string('import_module("pandas"); import_module(name)')) == []
