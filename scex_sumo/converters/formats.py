"""Formats of files, told apart by their names, and what the files beside them say."""

from __future__ import annotations

import csv
import gzip
import math
from pathlib import Path

from scex_sumo.errors import TrackError

COMMONROAD = (".xml", ".xml.gz")
OPENDRIVE = (".xodr", ".xodr.gz")
NET = (".net.xml", ".net.xml.gz")
FCD = (".fcd.xml", ".fcd.xml.gz", ".parquet")
HIGHD = "_recordingMeta.csv"
_TRACKS = "_tracks.csv"


def is_commonroad(map_path: str | Path) -> bool:
    """Whether a map is a CommonRoad scenario, by its name, and by its beginning where it is SUMO's."""
    return str(map_path).lower().endswith(COMMONROAD) and not (is_net(map_path) or is_fcd(map_path))


def is_net(map_path: str | Path) -> bool:
    """Whether a map is a SUMO net, by its name."""
    return str(map_path).lower().endswith(NET)


def is_fcd(path: str | Path) -> bool:
    """Whether a file is SUMO's floating car data, by its name or by its beginning."""
    name = str(path).lower()
    return name.endswith(FCD) or (name.endswith(COMMONROAD) and b"<fcd-export" in _beginning(Path(path)))


def _beginning(path: Path) -> bytes:
    """The first bytes of a file, unpacked; none where it cannot be read."""
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            return file.read(4096)
    except (OSError, EOFError):
        return b""


def is_highd(map_path: str | Path) -> bool:
    """Whether a file is a highD recording's meta data, whose lane markings are its map, by its name."""
    return str(map_path).endswith(HIGHD)


def map_name(map_path: str | Path) -> str:
    """Name of a map: its file's name without the ending; ``highd_NN`` of a highD recording."""
    if is_highd(map_path):
        return f"highd_{Path(map_path).name.removesuffix(HIGHD)}"
    return Path(Path(map_path).name.removesuffix(".gz")).stem.removesuffix(".net")


def is_levelx(path: str | Path) -> bool:
    """Whether a file is the ``NN_tracks.csv`` of such a recording."""
    path = Path(path)
    return path.name.endswith(_TRACKS) and recording_file(path, "recordingMeta").is_file()


def recording_file(tracks_path: Path, kind: str) -> Path:
    """Path of ``NN_recordingMeta.csv`` or ``NN_tracksMeta.csv`` of a recording's tracks."""
    return tracks_path.with_name(f"{tracks_path.name.removesuffix(_TRACKS)}_{kind}.csv")


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
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file))
    except FileNotFoundError:
        raise TrackError(f"{path}: no such file; it belongs to the tracks beside it") from None
    except (OSError, UnicodeError, csv.Error) as error:
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
