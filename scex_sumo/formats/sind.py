"""SinD recordings: ``Veh_smoothed_tracks.csv`` in a folder named by the recording."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from scex_sumo.converters.naming import map_name
from scex_sumo.converters.registries import Dataset, Recording, name_at, place_name, with_notes
from scex_sumo.converters.tracks.reader import read_tracks
from scex_sumo.formats.recognition import SIND_VEHICLES, SIND_WALKERS, is_sind


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


_read = with_notes(partial(read_tracks, walkers=(SIND_VEHICLES, SIND_WALKERS)))
SIND = Dataset(is_mine=is_sind, read=_read, recordings=_recordings, name=_name)
