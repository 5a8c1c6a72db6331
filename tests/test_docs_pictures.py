"""Docs: every picture is shown on a page, and shows the program as it is."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images"


def maker() -> ModuleType:
    """The module that makes the pictures."""
    spec = importlib.util.spec_from_file_location("make_pictures", ROOT / "docs" / "make_pictures.py")
    assert spec is not None and spec.loader is not None
    made = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


PICTURES = maker().PICTURES


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_shows_the_program_as_it_is(name: str) -> None:
    noted = json.loads((IMAGES / "digests.json").read_text())
    how = PICTURES[name].made_by or f"python docs/make_pictures.py {name}"
    assert PICTURES[name].digest() == noted[name], f"{name} is old; make it again: {how}"


def test_every_picture_is_made_by_a_command_and_shown_on_a_page() -> None:
    made = sorted(file for picture in PICTURES.values() for file in picture.files)
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    shown = {name for page in pages for name in re.findall(r"images/([\w.]+)\)", page.read_text())}
    there = sorted(path.name for path in IMAGES.iterdir() if path.suffix != ".json")
    assert made == there and shown == set(made)


def test_a_picture_whose_inputs_change_is_old(tmp_path: Path) -> None:
    file = tmp_path / "shown.py"
    file.write_text("a")
    picture = maker().Picture(files=(), shows=lambda: [file])
    before = picture.digest()
    file.write_text("b")
    assert picture.digest() != before
