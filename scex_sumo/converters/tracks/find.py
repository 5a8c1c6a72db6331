"""Track file that belongs to a map."""

from __future__ import annotations

from pathlib import Path

from scex_sumo.converters.formats import (
    FCD,
    HIGHD,
    all_there,
    is_commonroad,
    is_highd,
    is_net,
    there,
    unpacked_name,
)
from scex_sumo.errors import MapError, TrackError


def find_tracks(map_path: str | Path) -> Path:
    """The recording of a map, by the layout of the folders.

    Looked for, in this order: ``MAP.csv`` beside the map; then, in the folder above ``maps/`` (and in the
    map's own), ``recorded_trackfiles/MAP/vehicle_tracks_*.csv`` (the first of them), ``train/MAP_train.csv``,
    ``val/MAP_val.csv``; each may be packed as ``.csv.gz``. A CommonRoad scenario holds its own, unless
    ``MAP.csv`` lies beside it. Beside a SUMO net, ``MAP.fcd.xml``, ``MAP.fcd.xml.gz`` or
    ``MAP.parquet`` is taken.

    Raises:
        MapError: the map does not exist.
        TrackError: none of these exists.
    """
    path = Path(map_path)
    if not path.exists():
        raise MapError(f"{path}: no such file; check the path of the map")
    if is_highd(path):
        own = path.with_name(unpacked_name(path).replace(HIGHD, "_tracks.csv"))
        return there(own) or own
    name = Path(unpacked_name(path)).stem
    # The folder above may be "..": resolve it, but show what the user can recognise.
    folders = [path.parent.parent] if path.parent.name else [path.parent.resolve().parent]
    folders.append(path.parent)
    looked = [path.with_name(f"{name}.csv")]
    beside = there(looked[0])
    if beside is not None:
        return beside
    fcd = [path.with_name(f"{name}{ending}") for ending in FCD]
    for file in fcd if is_net(path) else ():
        if file.is_file():
            return file
    if is_commonroad(path):
        return path
    for folder in folders:
        recordings = folder / "recorded_trackfiles" / name
        found = all_there(recordings, "vehicle_tracks_*.csv")
        if found:
            return found[0]
        looked.append(recordings / "vehicle_tracks_*.csv")
        for split in ("train", "val"):
            file = folder / split / f"{name}_{split}.csv"
            split_file = there(file)
            if split_file is not None:
                return split_file
            looked.append(file)
    places = ", ".join(str(place) for place in looked[:4])
    raise TrackError(
        f"{path}: no tracks found; looked for {places}; give --tracks CSV, or --synthetic N for N vehicles "
        "placed by SUMO"
    )
