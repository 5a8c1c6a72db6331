"""What is kept between runs: found again where all it was made of is the same, whole, and not too much."""

from __future__ import annotations

import dataclasses
import hashlib
import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scex_sumo
from scex_sumo.base import cache
from scex_sumo.base.cache import cached_bytes, cached_object
from scex_sumo.base.files import cache_folder
from scex_sumo.converters.maps import read_map
from scex_sumo.generators.synthetic import synthetic_seed
from scex_sumo.scenarios import EXAMPLES, example_path


@pytest.fixture(autouse=True)
def empty_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def made(of: bytes, content: bytes = b"content") -> bytes:
    return cached_bytes("things", of, lambda: content)


def test_keys_change_with_the_content_of_our_modules_and_not_with_their_times(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    module = tmp_path / "base" / "cache.py"
    module.parent.mkdir()
    module.write_text("1\n")
    monkeypatch.setattr(cache, "__file__", str(module))
    before = cache.code_key.__wrapped__()
    os.utime(module, (0, 0))
    assert cache.code_key.__wrapped__() == before
    module.write_text("2\n")
    assert cache.code_key.__wrapped__() != before


def test_a_cache_that_cannot_be_written_stops_nobody(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert made(b"a") == b"content"


def content_of(value: Any) -> Any:
    """An object as types and values, arrays as their bytes and orders: equal only for equal objects."""
    if dataclasses.is_dataclass(value):
        return type(value), [content_of(getattr(value, field.name)) for field in dataclasses.fields(value)]
    if isinstance(value, np.ndarray):
        flags = value.flags
        return value.dtype, value.shape, flags.c_contiguous, flags.writeable, value.tobytes()
    if isinstance(value, dict):
        return [content_of(pair) for pair in value.items()]
    if isinstance(value, tuple | list):
        return type(value), [content_of(entry) for entry in value]
    return type(value), value


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_kept_road_is_the_one_that_was_read(name: str) -> None:
    path = example_path(name)
    for own_corner in (False, True):
        read = content_of(read_map(path, own_corner=own_corner))
        for _ in range(2):
            assert content_of(read_map(path, own_corner=own_corner, keep=True)) == read


@dataclasses.dataclass
class Thing:
    value: Any


FORGED = [
    pickle.dumps(os.system),
    b'{"array": ["|O", [1], "C", false]}\n' + bytes(8),
    b'{"array": ["<f8", [1000000000000], "C", false]}\n' + bytes(8),
    b'{"class": "Popen", "fields": {"args": "true"}}\n',
    b'{"class": "Thing", "fields": {"other": 1}}\n',
    b'{"eval": ["1"]}\n',
    b"[" * 100_000,
]


@pytest.mark.parametrize("forged", FORGED, ids=range(len(FORGED)))
def test_what_somebody_else_wrote_into_the_cache_is_made_anew(forged: bytes) -> None:
    cached_object("things", b"a", lambda: Thing(1), (Thing,))
    (file,) = (cache_folder() / "things").iterdir()
    file.write_bytes(hashlib.sha256(forged).digest() + forged)
    assert cached_object("things", b"a", lambda: Thing(2), (Thing,)) == Thing(2)


def test_the_package_unpickles_nothing_but_answers_of_its_own_processes() -> None:
    package = Path(scex_sumo.__file__).parent
    files = [file for file in package.rglob("*.py") if "pickle.load" in file.read_text(encoding="utf-8")]
    assert {file.relative_to(package).as_posix() for file in files} <= {
        "extrapolation/processes/process.py",  # pipes of workers
        "studies/moments/run.py",  # roads that this process has sent
    }


def test_a_populated_map_is_the_same_from_the_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    path = example_path("roundabout")
    scenes = [synthetic_seed(path, vehicles=4, seed=3, cache=cache) for cache in (False, True)]
    monkeypatch.setattr("scex_sumo.generators.synthetic.record", None)  # SUMO is not asked again
    scenes.append(synthetic_seed(path, vehicles=4, seed=3))
    made, first, again = (dataclasses.asdict(dataclasses.replace(scene, road=None)) for scene in scenes)
    np.testing.assert_equal(again, first)
    np.testing.assert_equal(made, first)
    assert len(list((cache_folder() / "populated").iterdir())) == 1
    with pytest.raises(TypeError):  # but for another scene
        synthetic_seed(path, vehicles=4, seed=4)
