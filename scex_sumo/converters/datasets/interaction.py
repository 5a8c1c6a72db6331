"""INTERACTION and TAF-BW: the tracks of a map, and the map of tracks, by the layout of their folders."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path

from scex_sumo.base.errors import MapError, TrackError
from scex_sumo.converters.lanelet.origin import META_DATA
from scex_sumo.converters.naming import (
    all_plain_or_packed,
    in_arrow,
    map_name,
    open_binary,
    open_text,
    plain_or_packed,
    unpacked_name,
)
from scex_sumo.converters.registries import (
    Dataset,
    Recording,
    map_format,
    recording_name,
    refuse_folder,
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
    refuse_folder(path)
    name = Path(unpacked_name(path)).stem
    looked = [path.with_name(f"{name}.csv")]
    if unpacked_name(path) != looked[0].name and (beside := plain_or_packed(looked[0])) is not None:
        return beside
    if (own := map_format(path).tracks(path)) is not None:
        return own
    for folder in (path.parent.resolve().parent if not path.parent.name else path.parent.parent, path.parent):
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


def tracks_of_map(map_path: Path) -> list[Path]:
    """All track files where the layouts have those of a map."""
    name, above = map_name(map_path), map_path.parent.parent
    beside = [map_path.with_name(f"{name}.csv"), *(above / s / f"{name}_{s}.csv" for s in ("train", "val"))]
    files = all_plain_or_packed(above / "recorded_trackfiles" / name, TRACKS)
    return [*files, *(file for file in map(plain_or_packed, beside) if file is not None)]


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
        own = [plain_or_packed(path.with_name(f"{folder.name}.osm")), *folder.glob("*.osm")]
        beside = own[0] or (own[1] if len(own) == 2 else None)  # in somebody's own folder
        return plain_or_packed(map_path) or beside or map_path
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


MARKS = {"to_predict": "track_to_predict", "interesting": "interesting_agent"}
"""Marks of vehicles in the files of the INTERPRET challenge, and their columns."""


def marked_vehicles(tracks: Path, case: str) -> dict[str, list[str]]:
    """Return the marked vehicles of a case by `MARKS`; nothing if the file has no marks."""
    with open_text(tracks, errors="replace") as file:
        header = file.readline(65536).strip().split(",")
    if not {*MARKS.values(), "case_id", "track_id"} <= set(header):
        return {}
    rows = _marks(tracks, tracks.stat().st_mtime_ns)
    return {name: sorted({track for of, track in rows[name] if of == float(case)}) for name in MARKS}


@lru_cache(maxsize=1)
def _marks(tracks: Path, _changed_ns: int) -> dict[str, set[tuple[float, str]]]:
    """Return case and track id of all rows with each mark."""
    import pyarrow as pa
    import pyarrow.compute as pc
    from pyarrow import csv

    types = {"case_id": pa.float64(), "track_id": pa.string(), **dict.fromkeys(MARKS.values(), pa.float64())}
    with open_binary(tracks) as file:
        options = csv.ConvertOptions(include_columns=[*types], column_types=types)
        table = csv.read_csv(in_arrow(file), convert_options=options)
    marked = {name: table.filter(pc.equal(table[column], 1.0)).to_pylist() for name, column in MARKS.items()}
    return {
        name: {(row["case_id"], row["track_id"].partition(".")[0]) for row in rows}
        for name, rows in marked.items()
    }
