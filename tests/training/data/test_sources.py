"""Cached samples are made anew when code that they depend on changes, and only then."""

from __future__ import annotations

import importlib
import shutil
import sys
from pathlib import Path

import pytest

from scex_sumo.training.data.sources import PACKAGE, digest_of, sources, sources_digest

START = "scex_sumo.training.data.dataset"


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A small package: start imports near, and far inside a function; far imports a name and a folder."""
    folder = tmp_path / "small"
    (folder / "rooms").mkdir(parents=True)
    for name, text in {
        "__init__": "from small import other",
        "start": "import json\nfrom small.near import x\ndef f():\n    from small import far",
        "near": "x = 1\nimport small.start",
        "far": "from small.rooms import wide\nimport small.rooms.deep",
        "other": "",
        "rooms/__init__": "wide = 1",
        "rooms/deep": "",
    }.items():
        (folder / f"{name}.py").write_text(text)
    return folder


def test_all_that_is_imported_is_found_however_far(package: Path) -> None:
    found = set(sources("small.start", package))
    reached = {"start", "near", "far", "rooms", "rooms.deep"}
    assert found >= {f"small.{name}" for name in reached}


@pytest.mark.parametrize("name", ["start", "near", "far", "rooms/__init__", "rooms/deep"])
def test_a_change_of_any_of_them_changes_the_digest(package: Path, name: str) -> None:
    before = digest_of(sources("small.start", package))
    with (package / f"{name}.py").open("a") as file:
        file.write("# changed\n")
    assert digest_of(sources("small.start", package)) != before


def test_samples_depend_on_every_module_that_making_them_loads() -> None:
    importlib.import_module(START)
    found = sources(START)
    # What the lists of a person forget: it is imported by what makes samples, at first or second hand.
    for name in ("behaviors.scene_graph.nodes", "geometry.frames", "geometry.polylines", "scene", "road"):
        assert f"scex_sumo.{name}" in found and f"scex_sumo.{name}" in sys.modules
    assert not any(name.startswith(("scex_sumo.commands", "scex_sumo.reports")) for name in found)


def test_a_change_of_any_module_of_samples_changes_their_digest_and_of_another_one_does_not(
    tmp_path: Path,
) -> None:
    copy = tmp_path / PACKAGE.name
    for file in PACKAGE.rglob("*.py"):
        (copy / file.relative_to(PACKAGE)).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, copy / file.relative_to(PACKAGE))
    files = sources(START, copy)
    assert digest_of(files) == sources_digest(START)
    (copy / "commands" / "models.py").write_text("")
    assert digest_of(sources(START, copy)) == digest_of(files)
    seen = {digest_of(files)}
    for file in files.values():
        with file.open("a") as text:
            text.write("# changed\n")
        seen.add(digest_of(files))
    assert len(seen) == 1 + len(files)
