"""Recorded signal phases: the format of a file, and the file that belongs to a scene."""

from __future__ import annotations

from pathlib import Path

from scex_sumo.base.errors import MapError
from scex_sumo.converters.registries import DATASETS, SignalFormat, dataset_of
from scex_sumo.scene import SeedScene


def signal_format(path: Path) -> SignalFormat:
    """Return how the phases in a file are read."""
    if (found := dataset_of(path).signals) is not None:
        return found
    raise MapError(
        f"{path}: not a recording of signal phases; give a CSV with the column signal_group_id, or a file of "
        f"a dataset that has phases, of {', '.join(DATASETS.paths)}"
    )


def signals_of(scene: SeedScene) -> Path | None:
    """Return the recording of signal phases that belongs to a scene's own recording; None if there is none.

    It is the recording itself, or ``signal_phases_NAME.csv`` beside ``vehicle_tracks_NAME.csv``.
    """
    if tracks := scene.source.get("tracks"):
        name = Path(tracks).name.removesuffix(".gz").replace("vehicle_tracks", "signal_phases")
        beside = Path(tracks).with_name(name)
        if name.startswith("signal_phases") and beside.is_file():
            return beside
    road = scene.road
    for file in (None if road is None else road.file, Path(tracks) if tracks else None):
        if file is not None and file.suffix != ".csv" and dataset_of(file).signals is not None:
            return file
    return None
