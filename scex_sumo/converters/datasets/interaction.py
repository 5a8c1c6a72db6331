"""INTERACTION and TAF-BW: the tracks of a map, and the map of tracks, by the layout of their folders."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from scex_sumo.base.errors import MapError, TrackError
from scex_sumo.converters.lanelet.origin import META_DATA
from scex_sumo.converters.naming import all_plain_or_packed, map_name, plain_or_packed, unpacked_name
from scex_sumo.converters.registries import (
    Dataset,
    Recording,
    map_format,
    recording_name,
    refuse_other_than_map,
    with_notes,
)
from scex_sumo.converters.tracks.reader import read_tracks

TRACKS = "vehicle_tracks_*.csv"


def find_tracks(map_path: str | Path) -> Path:
    """Find the recording of a map, plain or packed.

    The first that exists: ``MAP.csv`` beside the map; the recording of the map's own format; INTERACTION's
    layouts in the folder above ``maps/``.
    """
    path = Path(map_path)
    if not path.exists():
        raise MapError(f"{path}: no such file; check the path of the map")
    refuse_other_than_map(path)
    name = Path(unpacked_name(path)).stem
    looked = [path.with_name(f"{name}.csv")]
    if unpacked_name(path) != looked[0].name and (beside := plain_or_packed(looked[0])) is not None:
        return beside
    if (own_recording := map_format(path).tracks(path)) is not None:
        return own_recording
    for folder in (path.parent.resolve().parent if not path.parent.name else path.parent.parent, path.parent):
        if files := laid_out(folder, name):
            return files[0]
        looked += [folder / place for place in _layouts(name)]
    places = ", ".join(str(place) for place in looked[:4])
    raise TrackError(
        f"{path}: no tracks found; looked for {places}; give {map_format(path).asks_for}, or --synthetic N "
        "for N vehicles placed by SUMO"
    )


def _layouts(name: str) -> list[str]:
    return [f"recorded_trackfiles/{name}/{TRACKS}", *(f"{x}/{name}_{x}.csv" for x in ("train", "val"))]


def laid_out(folder: Path, name: str) -> list[Path]:
    """Return the track files of a map where INTERACTION's layouts have them in a folder."""
    recordings, *splits = (folder / place for place in _layouts(name))
    files = all_plain_or_packed(recordings.parent, TRACKS)
    return [*files, *(file for file in map(plain_or_packed, splits) if file is not None)]


def beside_tracks(map_path: str | Path) -> int:
    """Return how many recordings of a map `find_tracks` leaves for the one that it takes."""
    tracks = find_tracks(map_path)
    files = all_plain_or_packed(tracks.parent, TRACKS)
    return len(files) - 1 if tracks in files else 0


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
        named = plain_or_packed(map_path) or plain_or_packed(path.with_name(f"{folder.name}.osm"))
        maps = all_plain_or_packed(folder, "*.osm")
        return named or (maps[0] if len(maps) == 1 else map_path)  # one map in somebody's own folder
    if folder.name in ("train", "val") and stem.endswith(f"_{folder.name}"):
        map_path = folder.parent / "maps" / f"{stem.removesuffix(f'_{folder.name}')}.osm"
        return plain_or_packed(map_path) or map_path
    return plain_or_packed(path.with_name(f"{stem}.osm"))


def _siblings(path: Path) -> Sequence[Path]:
    own_folder = path.name.startswith("vehicle_tracks_")
    return all_plain_or_packed(path.parent, TRACKS) if own_folder else ()


INTERACTION = Dataset(
    is_mine=lambda path: True, read=with_notes(read_tracks), recordings=_recordings, siblings=_siblings
)
