"""The user's cache: what is found again, and by whom."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo import kept
from scex_sumo.files import cache_folder
from scex_sumo.kept import kept_arrays

MADE: list[object] = []


@pytest.fixture(autouse=True)
def empty(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    MADE.clear()


def squares(number: int) -> np.ndarray:
    def make() -> dict[str, np.ndarray]:
        MADE.append(number)
        return {"squares": np.arange(number) ** 2}

    return kept_arrays("squares", ("of", number), make)["squares"]


def test_arrays_are_made_once_of_the_same_and_again_of_another() -> None:
    first, again, other = squares(4), squares(4), squares(5)
    assert first.tolist() == again.tolist() == [0, 1, 4, 9]
    assert other.tolist() == [0, 1, 4, 9, 16]
    assert MADE == [4, 5]


def test_another_version_of_the_code_makes_them_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    squares(4)
    monkeypatch.setattr(kept, "_modules", lambda: "changed")
    squares(4)
    assert MADE == [4, 4]


@pytest.mark.parametrize("content", [b"", b"PK", b"hello"])
def test_what_was_not_written_whole_is_made_anew_and_mended(content: bytes) -> None:
    squares(4)
    (file,) = (cache_folder() / "squares").iterdir()
    file.write_bytes(content)
    assert squares(4).tolist() == squares(4).tolist() == [0, 1, 4, 9]
    assert MADE == [4, 4]


def test_the_cache_is_bounded_and_the_least_used_go_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "MOST", 2)
    for number in (1, 2, 1, 3, 1):
        squares(number)
    assert len(list((cache_folder() / "squares").iterdir())) == 2
    assert MADE == [1, 2, 3]


def test_a_cache_that_cannot_be_written_stops_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert squares(3).tolist() == [0, 1, 4]
