"""Recordings of all datasets in folders."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import MapError, TrackError, listed, warn_notes
from scex_sumo.base.files import identity_in
from scex_sumo.converters.datasets.interaction import laid_out
from scex_sumo.converters.naming import (
    map_name,
    plain_or_packed,
    refuse_unreadable,
    unique_names,
    unpacked_name,
)
from scex_sumo.converters.registries import Dataset, Recording, dataset_of, is_map

_RESULTS = ("run.json", "rank.json", "validate.json", "incomplete.json")
_AS_PUBLISHED = {"sample_annotation.json": "nuScenes", "*.tfrecord*": "Waymo Open Dataset", "*.db": "nuPlan"}
"""Datasets without a reader, by a file in them."""


@checked
def find_recordings(roots: str | Path | Sequence[str | Path]) -> tuple[Recording, ...]:
    """Find all recordings below folders, sorted by name; broken files are found too.

    A root may also be a track file, or a map, which stands for all of its tracks. Results of this program are
    left out, with a `ScexWarning`.

    Raises:
        TrackError: a root does not exist, or there is no recording at all.

    Example:
        >>> [recording.name for recording in scex.find_recordings([scex.example_path("roundabout")])]
        ['roundabout']
    """
    roots = [roots] if isinstance(roots, str | Path) else roots
    files, results = _below(roots)
    warn_notes(_note_on(results))
    recordings = _recordings_of(files)
    if not recordings:
        places = ", ".join(str(root) for root in roots) or "nothing given"
        raise TrackError(f"{places}: no recording found; {_why_none(files, results)}")
    return recordings


def left_out(roots: Sequence[str | Path]) -> list[str]:
    """Return a note on the results of this program below folders, which `find_recordings` leaves out."""
    return _note_on(_below(roots)[1])


def recordings_of_folder(path: Path) -> tuple[Recording, ...]:
    """Return the recordings below a folder, maybe none."""
    return _recordings_of(_below([path])[0])


def map_and_tracks(path: Path, tracks: Path | None = None) -> tuple[Path, Path | None]:
    """Return a map and its tracks as they are given, or the only ones in a folder.

    `MapError` if it holds no map, or several recordings, which the message lists, or if both are swapped.
    """
    if tracks is not None and is_map(tracks) and not is_map(path):
        raise MapError(f"{path}: not a map, but {tracks} is one: they are swapped; give the map first")
    if not path.is_dir():
        return path, tracks
    files, results = _below([path])
    recordings = _recordings_of(files)
    if tracks is not None:
        tracks_file = tracks.resolve()
        named = filter(lambda recording: tracks_file in map(Path.resolve, recording.track_paths), recordings)
        recordings = tuple(named) or recordings
    maps = sorted({recording.map_path for recording in recordings} or _maps(files))
    if not maps:
        raise MapError(f"{path}: a folder without a map or recording; {_why_none(files, results)}")
    summary = f"{path}: {len(recordings)} recordings on {len(maps)} maps"
    if len(maps) > 1:
        raise MapError(
            f"{summary}; give one of the maps: {listed(os.path.relpath(file, path) for file in maps)}"
        )
    if tracks is not None or not recordings:
        return maps[0], tracks
    places = [recording.place for recording in recordings]
    if len(places) > 1:
        shown = listed(os.path.relpath(place, path) for place in places)
        raise MapError(f"{path}: {len(places)} recordings; give one of them with --tracks: {shown}")
    return maps[0], places[0]


def _maps(files: Sequence[Path]) -> set[Path]:
    """Return the maps among files; of a plain and a packed one the plain."""
    unpacked = (path.with_name(unpacked_name(path)) for path in files if is_map(path))
    return set(filter(None, map(plain_or_packed, unpacked)))


def _recordings_of(files: Sequence[Path]) -> tuple[Recording, ...]:
    by_dataset: dict[Dataset, list[Path]] = {}
    for path in files:
        by_dataset.setdefault(dataset_of(path), []).append(path)
    recordings: list[Recording] = []
    for dataset, paths in by_dataset.items():
        recordings += dataset.recordings(paths)
    recordings.sort(key=lambda recording: (recording.name, recording.track_paths))
    names = unique_names(re.sub(r"[^A-Za-z0-9._+-]+", "-", recording.name) for recording in recordings)
    return tuple(replace(recording, name=name) for recording, name in zip(recordings, names, strict=True))


def _why_none(files: Sequence[Path], results: Sequence[Path]) -> str:
    if results:
        return f"{results[0]} is a result of this program; give recordings"
    for path in files:
        refuse_unreadable(path)
    for pattern, name in _AS_PUBLISHED.items():
        if any(path.match(pattern) for path in files):
            return f"this is {name} as published; convert it by py123d or ScenarioNet, see docs/data.md"
    return (
        "looked for recorded_trackfiles/NAME/vehicle_tracks_*.csv, "
        "train/NAME_train.csv, val/NAME_val.csv with maps/NAME.osm, CommonRoad *.xml, *_tracks.csv with "
        "*_recordingMeta.csv, and the files of the other data sets in docs/data.md"
    )


def _note_on(results: Sequence[Path]) -> list[str]:
    return [f"results of this program are left out: {listed(results)}"] if results else []


def _below(roots: Sequence[str | Path]) -> tuple[list[Path], list[Path]]:
    """Return the files below folders, each once, and the folders of results, without the files in them."""
    files: list[Path] = []
    results: list[Path] = []
    for root in map(Path, roots):
        if not root.exists():
            raise TrackError(f"{root}: no such file or folder; give a dataset's folder")
        if root.is_dir():
            files += _walk(root, results)
        elif unpacked_name(root).endswith(".osm"):
            beside = plain_or_packed(root.with_name(f"{map_name(root)}.csv"))
            files += [*laid_out(root.parent.parent, map_name(root)), *([beside] if beside else [])]
        else:
            files.append(root)
    return list({os.path.realpath(path): path for path in reversed(files)}.values()), results


def _walk(root: Path, results: list[Path]) -> Iterator[Path]:
    for folder, below, names in os.walk(root):
        if any(identity_in(Path(folder, name)) for name in _RESULTS if name in names):
            results.append(Path(folder))
            below.clear()
            continue
        below[:] = sorted(name for name in below if not name.startswith("."))
        yield from filter(Path.is_file, (Path(folder, name) for name in sorted(names)))
