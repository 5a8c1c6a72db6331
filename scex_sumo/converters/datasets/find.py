"""Recordings in folders, and the recording of a map, by the layouts of datasets; INTERACTION and TAF-BW."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from scex_sumo.base.errors import MapError, TrackError, listed, warn_notes
from scex_sumo.base.files import identity_in
from scex_sumo.converters.lanelet.origin import META_DATA
from scex_sumo.converters.naming import all_plain_or_packed, map_name, plain_or_packed, unpacked_name
from scex_sumo.converters.registries import (
    Dataset,
    Recording,
    dataset_of,
    is_map,
    map_format,
    recording_name,
    refuse_folder,
)
from scex_sumo.converters.tracks.reader import read_tracks
from scex_sumo.converters.tracks.rows import TrackTable

TRACKS = "vehicle_tracks_*.csv"
_RESULTS = ("run.json", "rank.json", "validate.json", "incomplete.json")
_AS_PUBLISHED = {
    "sample_annotation.json": "nuScenes",
    "*.tfrecord*": "Waymo Open Dataset",
    "*.db": "nuPlan",
}
"""Datasets without a reader, by a file in them."""


def find_recordings(roots: Sequence[str | Path]) -> tuple[Recording, ...]:
    """Find all recordings below folders, sorted by name; broken files are found too.

    A root may also be a track file, or a map, which stands for all of its tracks. Results of this program are
    left out, with a `ScexWarning`.

    Raises:
        TrackError: a root does not exist, or there is no recording at all.

    Example:
        >>> [recording.name for recording in scex.find_recordings([scex.example_path("roundabout")])]
        ['roundabout']
    """
    files, results = _below(roots)
    warn_notes(_left_out(results))
    recordings = _recordings_of(files)
    if not recordings:
        places = ", ".join(str(root) for root in roots) or "nothing given"
        raise TrackError(f"{places}: no recording found; {_why_none(files, results)}")
    return recordings


def left_out(roots: Sequence[str | Path]) -> list[str]:
    """Return a note on the results of this program below folders, which `find_recordings` leaves out."""
    return _left_out(_below(roots)[1])


def map_and_tracks(path: Path, tracks: Path | None = None) -> tuple[Path, Path | None]:
    """Return a map and its tracks as they are given, or the only ones in a folder.

    Raises:
        MapError: the folder holds no map, or several recordings, which the message lists.
    """
    if not path.is_dir():
        return path, tracks
    files, results = _below([path])
    recordings = _recordings_of(files)
    if tracks is not None:
        given = tracks.resolve()
        named = [one for one in recordings if given in (file.resolve() for file in one.track_paths)]
        recordings = tuple(named) or recordings
    maps = sorted({one.map_path for one in recordings} or filter(is_map, files))
    if not maps:
        raise MapError(f"{path}: a folder without a map or recording; {_why_none(files, results)}")
    known = f"{path}: {len(recordings)} recordings on {len(maps)} maps"
    if len(maps) > 1:
        raise MapError(
            f"{known}; give one of the maps: {listed(os.path.relpath(file, path) for file in maps)}"
        )
    if tracks is not None or not recordings:
        return maps[0], tracks
    parts = [
        one.track_paths[0] if len(one.track_paths) == 1 else one.track_paths[0].parent for one in recordings
    ]
    if len(parts) > 1:
        shown = listed(os.path.relpath(part, path) for part in parts)
        raise MapError(f"{path}: {len(parts)} recordings; give one of them with --tracks: {shown}")
    return maps[0], parts[0]


def _recordings_of(files: Sequence[Path]) -> tuple[Recording, ...]:
    by_dataset: dict[Dataset, list[Path]] = {}
    for path in files:
        by_dataset.setdefault(dataset_of(path), []).append(path)
    recordings = [recording for dataset, own in by_dataset.items() for recording in dataset.recordings(own)]
    return tuple(_with_unique_names(sorted(recordings, key=lambda one: (one.name, one.track_paths))))


def _why_none(files: Sequence[Path], results: Sequence[Path]) -> str:
    if results:
        return f"{results[0]} is a result of this program; give recordings"
    for pattern, name in _AS_PUBLISHED.items():
        if any(path.match(pattern) for path in files):
            return f"this is {name} as published; convert it by py123d or ScenarioNet, see docs/data.md"
    return (
        "looked for recorded_trackfiles/NAME/vehicle_tracks_*.csv, "
        "train/NAME_train.csv, val/NAME_val.csv with maps/NAME.osm, CommonRoad *.xml, *_tracks.csv with "
        "*_recordingMeta.csv, and the files of the other data sets in docs/data.md"
    )


def _left_out(results: Sequence[Path]) -> list[str]:
    return [f"results of this program are left out: {listed(results)}"] if results else []


def find_tracks(map_path: str | Path) -> Path:
    """Find the recording of a map, plain or packed.

    The first that exists: ``MAP.csv`` beside the map; the recording of the map's own format; INTERACTION's
    layouts in the folder above ``maps/``.
    """
    path = Path(map_path)
    if not path.exists():
        raise MapError(f"{path}: no such file; check the path of the map")
    refuse_folder(path)
    name = Path(unpacked_name(path)).stem
    looked = [path.with_name(f"{name}.csv")]
    if unpacked_name(path) != looked[0].name and (beside := plain_or_packed(looked[0])) is not None:
        return beside
    if (own := map_format(path).tracks(path)) is not None:
        return own
    above = path.parent.parent if path.parent.name else path.parent.resolve().parent
    for folder in (above, path.parent):
        recordings = folder / "recorded_trackfiles" / name
        if files := all_plain_or_packed(recordings, TRACKS):
            return files[0]
        splits = [folder / split / f"{name}_{split}.csv" for split in ("train", "val")]
        if there := [file for file in map(plain_or_packed, splits) if file is not None]:
            return there[0]
        looked += [recordings / TRACKS, *splits]
    places = ", ".join(str(place) for place in looked[:4])
    raise TrackError(
        f"{path}: no tracks found; looked for {places}; give {map_format(path).asks_for}, or --synthetic N "
        "for N vehicles placed by SUMO"
    )


def beside_tracks(map_path: str | Path) -> int:
    """Return how many recordings of a map `find_tracks` leaves for the one that it takes."""
    tracks = find_tracks(map_path)
    files = all_plain_or_packed(tracks.parent, TRACKS)
    return len(files) - 1 if tracks in files else 0


def _below(roots: Sequence[str | Path]) -> tuple[list[Path], list[Path]]:
    """Return the files below folders, each once, and the folders of results, without the files in them."""
    files: list[Path] = []
    results: list[Path] = []
    for root in map(Path, roots):
        if not root.exists():
            raise TrackError(f"{root}: no such file or folder; give a dataset's folder")
        files += _walk(root, results) if root.is_dir() else _tracks_named(root)
    return list({os.path.realpath(path): path for path in reversed(files)}.values()), results


def _walk(root: Path, results: list[Path]) -> Iterator[Path]:
    for folder, below, names in os.walk(root):
        if any(identity_in(Path(folder, name)) for name in _RESULTS if name in names):
            results.append(Path(folder))
            below.clear()
            continue
        below[:] = sorted(name for name in below if not name.startswith("."))
        yield from (Path(folder, name) for name in sorted(names))


def _tracks_named(path: Path) -> list[Path]:
    return tracks_of_map(path) if unpacked_name(path).endswith(".osm") else [path]


def _with_unique_names(recordings: list[Recording]) -> Iterator[Recording]:
    used: set[str] = set()
    for recording in recordings:
        safe = re.sub(r"[^A-Za-z0-9._+-]+", "-", recording.name)
        name, count = safe, 1
        while name in used:
            count += 1
            name = f"{safe}-{count}"
        used.add(name)
        yield replace(recording, name=name)


def tracks_of_map(map_path: Path) -> list[Path]:
    """All track files where the layouts have those of a map."""
    name, above = map_name(map_path), map_path.parent.parent
    beside = [map_path.with_name(f"{name}.csv"), *(above / s / f"{name}_{s}.csv" for s in ("train", "val"))]
    files = all_plain_or_packed(above / "recorded_trackfiles" / name, TRACKS)
    return [*files, *(file for file in map(plain_or_packed, beside) if file is not None)]


def _read(paths: Sequence[Path], *, net: Path | None = None) -> tuple[TrackTable, tuple[str, ...]]:
    table = read_tracks(paths[0])
    return table, table.notes


def _recordings(files: Sequence[Path]) -> Iterator[Recording]:
    for path in files:
        map_path = _map_of(path) if unpacked_name(path).endswith(".csv") else None
        if map_path is not None:
            yield Recording(
                name=recording_name(map_path, (path,)),
                site=map_name(map_path),
                dataset="taf_bw" if path.with_name(META_DATA).is_file() else "interaction",
                map_path=map_path,
                track_paths=(path,),
            )


def _map_of(path: Path) -> Path | None:
    folder, stem = path.parent, Path(unpacked_name(path)).stem
    if path.name.startswith("vehicle_tracks_"):
        map_path = folder.parent.parent / "maps" / f"{folder.name}.osm"
        only = [*folder.glob("*.osm")]  # somebody's own folder
        beside = plain_or_packed(path.with_name(f"{folder.name}.osm")) or (
            only[0] if len(only) == 1 else None
        )
        return plain_or_packed(map_path) or beside or map_path
    if folder.name in ("train", "val") and stem.endswith(f"_{folder.name}"):
        map_path = folder.parent / "maps" / f"{stem.removesuffix(f'_{folder.name}')}.osm"
        return plain_or_packed(map_path) or map_path
    return plain_or_packed(path.with_name(f"{stem}.osm"))


def _siblings(path: Path) -> Sequence[Path]:
    own_folder = path.name.startswith("vehicle_tracks_")
    return all_plain_or_packed(path.parent, TRACKS) if own_folder else ()


INTERACTION = Dataset(is_mine=lambda path: True, read=_read, recordings=_recordings, siblings=_siblings)
