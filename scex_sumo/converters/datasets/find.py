"""Recordings in folders, found by the layouts that datasets are published in."""

from __future__ import annotations

import os
import re
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from scex_sumo.converters.datasets.reader import chains, chunk_span
from scex_sumo.converters.formats import (
    all_there,
    has_lane_markings,
    is_commonroad,
    is_levelx,
    is_sind,
    map_name,
    open_binary,
    read_meta,
    recording_file,
    there,
    unpacked_name,
)
from scex_sumo.converters.lanelet.file import read_map_file
from scex_sumo.converters.lanelet.origin import META_DATA
from scex_sumo.converters.lanelet.repair import distance_m, middle
from scex_sumo.converters.moments.scene import recording_name
from scex_sumo.errors import MapError, TrackError

_SCENE = re.compile(r"(C-)?[A-Z]{3}_[A-Za-z0-9]+-\d+")


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """Where a recording and its map are.

    Attributes:
        name: unique within what was searched, fit for a file name.
        site: recordings of one site share a map.
        dataset: ``interaction``, ``taf_bw``, ``commonroad`` (also MONA) or ``levelx`` (inD, rounD, highD,
            exiD).
        map_path: the map; it need not exist, which `load_recording` then says.
        track_paths: consecutive files that make one recording, in order of time.
    """

    name: str
    site: str
    dataset: str
    map_path: Path
    track_paths: tuple[Path, ...]


def find_recordings(roots: Sequence[str | Path]) -> tuple[Recording, ...]:
    """Find all recordings below some folders; no file is read in full, so broken ones are found too.

    Args:
        roots: folders, or single files: tracks, or maps, which stand for all of their tracks.

    Returns:
        Sorted by name.

    Raises:
        TrackError: a root does not exist, or there is no recording at all.
    """
    files: list[Path] = []
    for root in map(Path, roots):
        if not root.exists():
            raise TrackError(f"{root}: no such file or folder; give a dataset's folder")
        files += _walk(root) if root.is_dir() else _named(root)
    unique = list({os.path.realpath(path): path for path in reversed(files)}.values())
    found = sorted(_recordings(unique), key=lambda recording: (recording.name, recording.track_paths))
    if not found:
        places = ", ".join(str(root) for root in roots) or "nothing given"
        raise TrackError(
            f"{places}: no recording found; looked for recorded_trackfiles/NAME/vehicle_tracks_*.csv, "
            "train/NAME_train.csv, val/NAME_val.csv with maps/NAME.osm, CommonRoad *.xml and *_tracks.csv "
            "with *_recordingMeta.csv"
        )
    return tuple(_renamed(found))


def _walk(root: Path) -> Iterator[Path]:
    """All files below a folder that may be tracks, hidden folders left out, in a fixed order."""
    for folder, below, names in os.walk(root):
        below[:] = sorted(name for name in below if not name.startswith("."))
        yield from (
            Path(folder, name)
            for name in sorted(names)
            if name.endswith((".csv", ".csv.gz", ".xml", ".xml.gz"))
        )


def _named(path: Path) -> list[Path]:
    """The tracks that a file stands for: itself, or of a map all that lie where the layouts have them."""
    if not unpacked_name(path).endswith(".osm"):
        return [path]
    name, above = Path(unpacked_name(path)).stem, path.parent.parent
    beside = [
        path.with_name(f"{name}.csv"),
        above / "train" / f"{name}_train.csv",
        above / "val" / f"{name}_val.csv",
    ]
    found = all_there(above / "recorded_trackfiles" / name, "vehicle_tracks_*.csv")
    return [*found, *(file for file in map(there, beside) if file is not None)]


def _recordings(files: Iterable[Path]) -> Iterator[Recording]:
    files = list(files)
    for path in files:
        if unpacked_name(path).endswith(".csv"):
            recording = _levelx(path) if is_levelx(path) else _interaction(path)
            if recording is not None:
                yield recording
    for paths in chains([path for path in files if is_commonroad(path) and _is_scenario(path)]):
        span = chunk_span(paths[0])
        scene = _SCENE.match(map_name(paths[0]))
        yield Recording(
            name=recording_name(paths[0], paths),
            site=span[0] if span else scene[0] if scene else map_name(paths[0]),
            dataset="commonroad",
            map_path=paths[0],
            track_paths=paths,
        )


def _interaction(path: Path) -> Recording | None:
    """INTERACTION's and TAF-BW's layouts, and a file beside its map; None where the path fits none."""
    folder, stem = path.parent, Path(unpacked_name(path)).stem
    beside = there(path.with_name(f"{stem}.osm"))
    if path.name.startswith("vehicle_tracks_"):
        map_path = folder.parent.parent / "maps" / f"{folder.name}.osm"
        only = [*folder.glob("*.osm")]  # somebody's own folder
        beside = there(path.with_name(f"{folder.name}.osm")) or (only[0] if len(only) == 1 else None)
        map_path = there(map_path) or beside or map_path
    elif folder.name in ("train", "val") and stem.endswith(f"_{folder.name}"):
        map_path = folder.parent / "maps" / f"{stem.removesuffix(f'_{folder.name}')}.osm"
        map_path = there(map_path) or map_path
    elif is_sind(path):
        map_path = _only_map(folder)
    elif beside is not None:
        map_path = beside
    else:
        return None
    return Recording(
        name=recording_name(map_path, (path,)),
        site=map_name(map_path),
        dataset="taf_bw" if path.with_name(META_DATA).is_file() else "interaction",
        map_path=map_path,
        track_paths=(path,),
    )


def _only_map(folder: Path) -> Path:
    """The one Lanelet2 map in a folder, or else in that above it or the next; SinD's lie anywhere there."""
    for place in (folder, folder.parent, folder.parent.parent):
        maps = [*place.glob("*.osm"), *place.glob("maps/*.osm")]
        if len(maps) == 1:
            return maps[0]
    return folder.parent / "maps" / "map.osm"


def _levelx(path: Path) -> Recording:
    """A recording of inD, rounD, exiD with the Lanelet2 map nearest to it, or of highD, its own map."""
    meta_path = recording_file(path, "recordingMeta")
    try:
        meta = read_meta(meta_path)
    except TrackError:
        meta = {}  # reported when the recording is loaded
    map_path = meta_path if has_lane_markings(meta) else _nearest_map(path, meta)
    return Recording(
        name=recording_name(map_path, (path,)),
        site=map_name(map_path),
        dataset="levelx",
        map_path=map_path,
        track_paths=(path,),
    )


def _nearest_map(path: Path, meta: dict[str, str]) -> Path:
    """The Lanelet2 map in ``maps``, beside or above the tracks, nearest to where they were recorded."""
    folders = [folder / "maps" for folder in (path.parent, path.parent.parent)]
    maps = sorted(
        file for folder in folders for end in ("osm", "osm.gz") for file in folder.rglob(f"*.{end}")
    )
    unknown = folders[-1] / f"location{meta.get('locationId', '')}.osm"
    try:
        place = float(meta["latLocation"]), float(meta["lonLocation"])
    except (KeyError, ValueError):
        return maps[0] if len(maps) == 1 else unknown
    distances = [(distance_m(_place(file, file.stat().st_mtime_ns), place), file) for file in maps]
    return min(distances)[1] if distances else unknown


@lru_cache(maxsize=64)
def _place(map_path: Path, _changed_ns: int) -> tuple[float, float]:
    """Latitude and longitude in the middle of a map; far from everything where it has none."""
    try:
        return middle(read_map_file(map_path))
    except MapError:
        return 90.0, 0.0


def _is_scenario(path: Path) -> bool:
    """Whether an XML file is a CommonRoad scenario, by its beginning; unreadable ones count."""
    try:
        with open_binary(path) as file:
            return b"<commonRoad" in file.read(4096)
    except (OSError, EOFError, zlib.error):
        return True


def _renamed(found: list[Recording]) -> Iterator[Recording]:
    """The same recordings; of several with one name all but the first get a number."""
    used: set[str] = set()
    for recording in found:
        safe = re.sub(r"[^A-Za-z0-9._+-]+", "-", recording.name)
        name, count = safe, 1
        while name in used:
            count += 1
            name = f"{safe}-{count}"
        used.add(name)
        yield replace(recording, name=name)
