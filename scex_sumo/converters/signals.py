"""Registry of recordings of signal phases."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from scex_sumo.base.errors import MapError
from scex_sumo.base.importing import Registry
from scex_sumo.converters.registries import recognised
from scex_sumo.scene import SeedScene

SIGNALS = Registry(group="scex_sumo.signals", kind="recording of signals")


@dataclass(frozen=True, kw_only=True, eq=False)
class SignalFormat:
    """Format of recorded signal phases: which files it recognises, and how it reads them.

    Attributes:
        is_mine: whether a file is such a recording.
        read: ``read(layout, road, path)`` gives a `Programme` (None if it controls no link of the net) and
            notes.
    """

    registry: ClassVar = SIGNALS
    is_mine: Callable[[Path], bool]
    read: Callable[..., tuple[Any, list[str]]]


def signal_format(path: Path) -> SignalFormat:
    """The format of recorded signal phases."""
    if (entry := next(recognised(SignalFormat, path), None)) is not None:
        return entry
    raise MapError(f"{path}: not a recording of signal phases; known formats: {', '.join(SIGNALS.paths)}")


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
        if (
            file is not None
            and file.suffix != ".csv"
            and next(recognised(SignalFormat, file), None) is not None
        ):
            return file
    return None
