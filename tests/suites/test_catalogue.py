"""Arguments of a catalogue are refused before anything is ranked or written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import scex_sumo as scex


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"count": 1}, "--count: got 1, needs at least 2"),
        ({"formats": ("word",)}, "unknown export format 'word'"),
        ({"roots": Path(__file__)}, "no recording found"),
    ],
)
def test_what_makes_no_sense_is_one_line_and_leaves_nothing(
    tmp_path: Path, options: dict[str, Any], words: str
) -> None:
    given = {"roots": scex.example_path("roundabout"), **options}
    with pytest.raises(scex.ScexError, match=words) as error:
        scex.catalogue(given.pop("roots"), out=tmp_path / "suite", **given)
    assert "\n" not in str(error.value) and not (tmp_path / "suite").exists()
