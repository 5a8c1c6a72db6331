"""Files by name and content: limits of packed ones, and what is neither a map nor a table."""

from __future__ import annotations

import gzip
from pathlib import Path

import pyarrow.csv
import pytest

import scex_sumo as scex
from scex_sumo.base.errors import InputError, MapError, TrackError
from scex_sumo.converters.datasets.recordings import read_recorded
from tests.converters.track_files import straight, write_rows

MAP = Path(scex.__file__).parent / "scenarios/data/roundabout.osm"


@pytest.fixture
def one_megabyte(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SCEX_MAX_UNPACKED_MB", "1")


def packed(path: Path, content: bytes) -> Path:
    path.write_bytes(gzip.compress(content))
    return path


@pytest.mark.usefixtures("one_megabyte")
@pytest.mark.parametrize("name", ["a.osm.gz", "a.xml.gz", "a.net.xml.gz", "a.xodr.gz"])
def test_a_packed_map_is_read_up_to_a_limit(name: str, tmp_path: Path) -> None:
    path = packed(tmp_path / name, b"<osm>" + b" " * 3_000_000 + b"</osm>")
    with pytest.raises(
        InputError, match=r"more than 1 MB when unpacked; set SCEX_MAX_UNPACKED_MB=N"
    ) as error:
        scex.read_map(path)
    assert "\n" not in str(error.value)


def test_a_small_file_that_unpacks_to_two_hundred_times_its_size_is_not_read(tmp_path: Path) -> None:
    path = packed(tmp_path / "a.osm.gz", b"<osm>" + b" " * 120_000_000 + b"</osm>")
    with pytest.raises(InputError, match=r"a\.osm\.gz: more than 100 MB when unpacked"):
        scex.read_map(path)


def test_a_map_that_does_not_fit_into_memory_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr("xml.etree.ElementTree.fromstring", full)
    path = tmp_path / "a.osm"
    path.write_text("<osm/>")
    with pytest.raises(InputError, match=r"a\.osm: does not fit into memory"):
        scex.read_map(path)


@pytest.mark.parametrize(
    ("name", "content", "kind"),
    [
        ("a.json", b' {"a": 1}', "JSON"),
        ("a.osm", b"[1, 2]", "JSON"),
        ("a.dat", b"\x80\x04\x95abc", "a Python pickle"),
        ("a.rec", b"\x89MCAP0\r\n", "an MCAP recording"),
        ("a.bin", b"PK\x03\x04....", "a zip archive"),
    ],
)
def test_what_is_no_map_and_no_table_is_named(name: str, content: bytes, kind: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(MapError, match=f"{kind}, not a map; give .osm, .xml"):
        scex.read_map(path)
    with pytest.raises(TrackError, match=f"{kind}, not CSV; INTERACTION tracks need track_id"):
        scex.read_seed(MAP, tracks=path)


@pytest.mark.parametrize(
    "name", ["a.osm", "a.net.xml", "a.xodr", "a.xml", "sd_a.pkl", "log_map_archive_a.json"]
)
def test_a_pointer_of_git_lfs_is_named(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n")
    with pytest.raises(InputError, match="a pointer of Git LFS, not the data"):
        scex.read_map(path)
    with pytest.raises(InputError, match="a pointer of Git LFS, not the data"):
        scex.read_seed(MAP, tracks=path.rename(tmp_path / "a.csv"))


def test_a_recording_is_parsed_from_arrow_s_own_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Arrow's threads abort a process that ends while they release what they read from a Python file."""
    sources = []
    read_csv = pyarrow.csv.read_csv

    def seen(source: object, **options: object) -> object:
        sources.append(type(source))
        return read_csv(source, **options)

    monkeypatch.setattr(pyarrow.csv, "read_csv", seen)
    read_recorded([write_rows(tmp_path / "a.csv", straight())])
    assert sources == [pyarrow.BufferReader]
