"""Formats of files, told apart by their names, and what the files beside them say."""

from __future__ import annotations

import csv
import gzip
import io
import math
import re
import zlib
from pathlib import Path
from typing import BinaryIO, TextIO, cast

from scex_sumo.errors import TrackError

COMMONROAD = (".xml", ".xml.gz")
OPENDRIVE = (".xodr", ".xodr.gz")
NET = (".net.xml", ".net.xml.gz")
FCD = (".fcd.xml", ".fcd.xml.gz", ".parquet")
HIGHD = "_recordingMeta.csv"
SIND = "Veh_smoothed_tracks.csv"
_TRACKS = "_tracks.csv"
_BEGINNING = 2**16  # bytes; SUMO writes its configuration first


def open_binary(path: Path) -> BinaryIO:
    """A file to read, unpacked where it is a gzip file, whatever its name."""
    with path.open("rb") as file:
        packed = file.read(2) == b"\x1f\x8b"
    return cast(BinaryIO, gzip.open(path)) if packed else path.open("rb")


def open_text(path: Path, *, errors: str = "strict") -> TextIO:
    """The same as text, without a byte order mark."""
    return io.TextIOWrapper(open_binary(path), encoding="utf-8-sig", errors=errors, newline="")


def there(path: Path) -> Path | None:
    """A file, or it packed as ``.gz``, whichever is there; None where neither is."""
    packed = path.with_name(f"{path.name}.gz")
    return path if path.is_file() else packed if packed.is_file() else None


def all_there(folder: Path, pattern: str) -> list[Path]:
    """Files of a folder by a pattern of their unpacked names, each once, sorted."""
    named = {file.name: file for file in folder.glob(f"{pattern}.gz")}
    found = {unpacked_name(file): file for file in named.values()}
    found |= {file.name: file for file in folder.glob(pattern)}
    return [found[name] for name in sorted(found)]


def unpacked_name(path: str | Path) -> str:
    """Name of a file without the ``.gz`` of a packed one."""
    return Path(path).name.removesuffix(".gz")


def is_commonroad(map_path: str | Path) -> bool:
    """Whether a map is a CommonRoad scenario, by its name, and by its beginning where it is SUMO's."""
    other = is_net(map_path) or is_fcd(map_path) or is_state(map_path)
    return str(map_path).lower().endswith(COMMONROAD) and not other


def is_net(map_path: str | Path) -> bool:
    """Whether a map is a SUMO net, by its name."""
    return str(map_path).lower().endswith(NET)


def is_fcd(path: str | Path) -> bool:
    """Whether a file is SUMO's floating car data, by its name or by its beginning."""
    name = str(path).lower()
    return name.endswith(FCD) or (name.endswith(COMMONROAD) and b"<fcd-export" in _beginning(Path(path)))


def is_state(path: str | Path) -> bool:
    """Whether a file is a saved state of a SUMO simulation, by its beginning."""
    xml = str(path).lower().endswith(COMMONROAD) and not is_net(path)
    return xml and b"<snapshot" in _beginning(Path(path))


def _beginning(path: Path) -> bytes:
    """The first bytes of a file, unpacked; none where it cannot be read."""
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            return file.read(_BEGINNING)
    except (OSError, EOFError, zlib.error):
        return b""


def is_highd(map_path: str | Path) -> bool:
    """Whether a file is a highD recording's meta data, whose lane markings are its map, by its name."""
    return unpacked_name(map_path).endswith(HIGHD)


def map_name(map_path: str | Path) -> str:
    """Name of a map: its file's name without the ending; ``highd_NN`` of a highD recording.

    Bytes that are no UTF-8 become ``-``: other programs shall open files of that name.
    """
    name = re.sub("[\udc80-\udcff]", "-", unpacked_name(map_path))
    return f"highd_{name.removesuffix(HIGHD)}" if is_highd(map_path) else Path(name).stem.removesuffix(".net")


def is_levelx(path: str | Path) -> bool:
    """Whether a file is the ``NN_tracks.csv`` of such a recording."""
    path = Path(path)
    return unpacked_name(path).endswith(_TRACKS) and recording_file(path, "recordingMeta").is_file()


def is_sind(path: Path) -> bool:
    """Whether a file is the vehicles of a recording of SinD, by its name; its folder has the recording's."""
    return unpacked_name(path) == SIND


def recording_file(tracks_path: Path, kind: str) -> Path:
    """Path of ``NN_recordingMeta.csv`` or ``NN_tracksMeta.csv`` of a recording's tracks."""
    beside = tracks_path.with_name(f"{unpacked_name(tracks_path).removesuffix(_TRACKS)}_{kind}.csv")
    return there(beside) or beside


def read_meta(path: Path) -> dict[str, str]:
    """The row of a ``recordingMeta.csv``.

    Raises:
        TrackError: it cannot be read, or has no row.
    """
    rows = read_rows(path)
    if not rows:
        raise TrackError(f"{path}: no row in it; take the file as published")
    return rows[0]


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file beside tracks, by the names of its columns; what is missing is empty."""
    try:
        with open_text(path) as file:
            rows = list(csv.DictReader(file))
    except FileNotFoundError:
        raise TrackError(f"{path}: no such file; it belongs to the tracks beside it") from None
    except (OSError, EOFError, zlib.error, UnicodeError, csv.Error) as error:
        raise TrackError(f"{path}: cannot be read ({error})") from None
    # A line cut short, or with too many values, has None for a value or a name.
    return [{name: row[name] or "" for name in row if name} for row in rows]


def number(text: str | None) -> float:
    """Number that a text is, or nan."""
    try:
        return float(text or "nan")
    except ValueError:
        return math.nan


def has_lane_markings(meta: dict[str, str]) -> bool:
    """Whether meta data of a recording are highD's: lane markings instead of a place."""
    return "lowerLaneMarkings" in meta
