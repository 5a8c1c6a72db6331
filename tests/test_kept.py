"""What is kept between runs: found again where all it was made of is the same, whole, and not too much."""

from __future__ import annotations

import dataclasses
import hashlib
import pickle
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.converters.maps import read_map
from scex_sumo.files import cache_folder
from scex_sumo.kept import kept, kept_object
from scex_sumo.road import Lane
from scex_sumo.scenarios import EXAMPLES, example_path
from scex_sumo.scenarios.seeds import synthetic_seed


@pytest.fixture(autouse=True)
def empty_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def made(of: bytes, content: bytes = b"content", most: int = 64) -> bytes:
    return kept("things", of, lambda: content, most=most)


def test_the_same_is_made_once() -> None:
    assert made(b"a", b"1") == made(b"a", b"2") == b"1"
    assert made(b"b", b"2") == b"2"


def test_what_was_not_written_whole_is_made_anew() -> None:
    made(b"a", b"1")
    (file,) = (cache_folder() / "things").iterdir()
    for number, broken in enumerate((b"", file.read_bytes()[:20], file.read_bytes() + b"0")):
        file.write_bytes(broken)
        assert made(b"a", f"{number}".encode()) == f"{number}".encode()
        assert made(b"a", b"other") == f"{number}".encode()


def test_the_cache_is_bounded() -> None:
    for number in range(4):
        made(bytes([number]), most=2)
    assert len(list((cache_folder() / "things").iterdir())) == 2


def test_a_cache_that_cannot_be_written_stops_nobody(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert made(b"a") == b"content"


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_kept_road_is_the_one_that_was_read(name: str) -> None:
    path = example_path(name)
    for own_corner in (False, True):
        read = pickle.dumps(read_map(path, own_corner=own_corner))
        assert pickle.dumps(read_map(path, own_corner=own_corner, keep=True)) == read
        assert pickle.dumps(read_map(path, own_corner=own_corner, keep=True)) == read


def test_a_road_is_read_anew_from_another_map_or_at_another_place(
    tmp_path: Path,
) -> None:
    path = tmp_path / "map.osm"
    text = example_path("roundabout").read_text(encoding="utf-8")
    maps = ((text, None), (text + "\n", None), (text, "us"))
    for number, (content, country) in enumerate(maps, start=1):
        path.write_text(content, encoding="utf-8")
        for _ in range(2):
            read_map(path, country=country, keep=True)
        assert len(list((cache_folder() / "roads").iterdir())) == number


INNER = b"\x80\x04\x8c\x13numpy._core.numeric\x8c\x08sys.exit\x93."  # what a module of NumPy has imported


@pytest.mark.parametrize("packed", [pickle.dumps(print), INNER], ids=["a builtin", "a name within a module"])
def test_nothing_but_what_it_consists_of_is_taken_from_the_cache(packed: bytes) -> None:
    parts = (Lane,)
    kept_object("things", b"a", lambda: 1, parts)
    (file,) = (cache_folder() / "things").iterdir()
    file.write_bytes(hashlib.sha256(packed).digest() + packed)
    assert kept_object("things", b"a", lambda: 2, parts) == 2


def test_a_populated_map_is_the_same_from_the_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    path = example_path("roundabout")
    scenes = [synthetic_seed(path, vehicles=4, seed=3, cache=cache) for cache in (False, True)]
    monkeypatch.setattr("scex_sumo.scenarios.traffic.synthetic.record", None)  # SUMO is not asked again
    scenes.append(synthetic_seed(path, vehicles=4, seed=3))
    made, first, again = (dataclasses.asdict(dataclasses.replace(scene, road=None)) for scene in scenes)
    np.testing.assert_equal(again, first)
    np.testing.assert_equal(made, first)
    assert len(list((cache_folder() / "populated").iterdir())) == 1
    with pytest.raises(TypeError):  # but for another scene
        synthetic_seed(path, vehicles=4, seed=4)
