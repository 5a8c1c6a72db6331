"""SinD recordings: ``Veh_smoothed_tracks.csv`` in a folder named by the recording."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from scex_sumo.converters.naming import map_name
from scex_sumo.converters.registries import Dataset, Recording, name_at, place_name
from scex_sumo.converters.tracks.reader import read_tracks
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.formats.recognition import SIND_VEHICLES, SIND_WALKERS, is_sind


def _read(paths: Sequence[Path], *, net: Path | None = None) -> tuple[TrackTable, tuple[str, ...]]:
    table = read_tracks(paths[0], walkers=(SIND_VEHICLES, SIND_WALKERS))
    return table, table.notes


def _recordings(files: Sequence[Path]) -> Iterator[Recording]:
    for path in files:
        if path.name.startswith(SIND_VEHICLES):
            map_path = _only_map(path.parent)
            name, site = _name(map_path, (path,)), map_name(map_path)
            yield Recording(name=name, site=site, dataset="sind", map_path=map_path, track_paths=(path,))


def _name(map_path: Path, files: Sequence[Path]) -> str:
    return name_at(place_name(map_path), files[0].resolve().parent.name)


def _only_map(folder: Path) -> Path:
    for place in (folder, folder.parent, folder.parent.parent):
        maps = [*place.glob("*.osm"), *place.glob("maps/*.osm")]
        if len(maps) == 1:
            return maps[0]
    return folder.parent / "maps" / "map.osm"


SIND = Dataset(is_mine=is_sind, read=_read, recordings=_recordings, name=_name)
