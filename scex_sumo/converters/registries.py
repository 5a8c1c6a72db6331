"""Registries of map formats and datasets.

An entry is a module or object with the functions of `MapFormat` or `Dataset`, or a `Declaration` of one.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, TypeAlias, TypeVar

from scex_sumo.base.errors import MapError, UsageError
from scex_sumo.base.importing import Registry, import_object
from scex_sumo.converters.naming import map_name, unpacked_name
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene

MAPS = Registry(group="scex_sumo.maps", kind="map format", last="lanelet2")
DATASETS = Registry(group="scex_sumo.datasets", kind="dataset", last="interaction")

Window: TypeAlias = tuple[float | None, float | None]
Signals: TypeAlias = Callable[..., tuple[Any, list[str]]]

Format = TypeVar("Format", bound=Any)


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """Where a recording and its map are.

    Attributes:
        name: unique within what was searched, fit for a file name.
        site: recordings of one site share a map.
        dataset: e.g. ``interaction``, ``taf_bw``, ``commonroad``, ``levelx`` (inD, rounD, highD, exiD).
        map_path: the map; it need not exist, which `load_recording` then reports.
        track_paths: consecutive files that make one recording, in order of time.
        window: first and last moment, s; None is where the recording begins or ends.

    Example:
        >>> (recording,) = scex.find_recordings([scex.example_path("roundabout")])
        >>> recording.dataset, recording.name
        ('interaction', 'roundabout')
    """

    name: str
    site: str
    dataset: str
    map_path: Path
    track_paths: tuple[Path, ...]
    window: Window = (None, None)

    @property
    def place(self) -> Path:
        """What ``--tracks`` takes: the file, or the folder of several."""
        return self.track_paths[0] if len(self.track_paths) == 1 else self.track_paths[0].parent

    def within(self, window: Window) -> Recording:
        """Return it with the limits of a window that are given."""
        first, last = (own if new is None else new for own, new in zip(self.window, window, strict=True))
        return replace(self, window=(first, last))


def recording_name(map_path: Path, track_paths: Sequence[Path]) -> str:
    """Name of a recording by its map and its first file, e.g. ``k733_2020-09-15_000``."""
    stem = re.sub(r"^vehicle_tracks_|_tracks$", "", map_name(track_paths[0]))
    return name_at(place_name(map_path), stem)


def name_at(place: str, stem: str) -> str:
    """Name of a recording: the place before the recording's own name, unless one holds the other already."""
    if place.endswith(f"_{stem}"):
        return place
    return stem if stem.startswith(place) else f"{place}_{stem}"


@dataclass(frozen=True, kw_only=True, eq=False)
class MapFormat:
    """Map format: which files it recognises, and how it reads them.

    Attributes:
        is_mine: whether a path is such a map, by its name, else by its beginning; the file may be missing.
        read: ``read(path, **options)`` gives the road; the options are those of `read_map`.
        tracks: recording that comes with a map; None if there is none.
        name: name of the place.
        asks_for: options by which a user gives tracks for such a map, for messages.
        opendrive: text of the OpenDRIVE that a map is or holds, which exports keep; else None.
    """

    registry: ClassVar = MAPS
    is_mine: Callable[[Path], bool]
    read: Callable[..., Road]
    tracks: Callable[[Path], Path | None] = lambda path: None
    name: Callable[[Path], str] = map_name
    asks_for: str = "--tracks CSV"
    opendrive: Callable[[Path], bytes | None] = lambda path: None


@dataclass(frozen=True, kw_only=True, eq=False)
class Dataset:
    """Dataset: which files and folders it recognises, and how it reads a recording.

    Attributes:
        is_mine: whether a file or folder is a recording of this dataset.
        read: ``read(paths, net=...)`` gives the recording, not repaired, and one phrase for each thing left
            out.
        recordings: recordings, with their maps, of the files of this dataset below a folder.
        files: files of the recording that a user names by one path.
        name: name of a recording by its map and its files.
        origin: latitude and longitude of the coordinates by tracks and map; None if there is none.
        siblings: other recordings by the same tracker at the same site.
        repair: repair of this dataset's own defects before `repair_tracks`.
        simulated: whether positions and velocities are exact, and ``read`` takes ``window=(first, last)``, s,
            to simulate only that, and ``progress``.
        within: ``within(table, road)`` treats vehicles off the lanes, of a recording from a car with a map in
            the same coordinates, and gives the table and phrases; None: the recording is aligned to its map.
        signals: ``signals(layout, road, path)`` gives the `Programme` of a recording (None if it controls no
            link of the net) and notes; None: the files tell none.
    """

    registry: ClassVar = DATASETS
    is_mine: Callable[[Path], bool]
    read: Callable[..., tuple[TrackTable, tuple[str, ...]]]
    recordings: Callable[[Sequence[Path]], Iterable[Recording]] = lambda files: ()
    files: Callable[[Path], tuple[Path, ...]] = lambda path: (path,)
    name: Callable[[Path, Sequence[Path]], str] = recording_name
    origin: Callable[[Path, Path], tuple[float, float] | None] = lambda tracks, map_path: None
    siblings: Callable[[Path], Iterable[Path]] = lambda path: ()
    repair: Callable[[TrackTable], tuple[TrackTable, tuple[str, ...]]] = lambda table: (table, ())
    simulated: bool = False
    within: Callable[[TrackTable, Road], tuple[TrackTable, list[str]]] | None = None
    signals: Signals | None = None


@dataclass(frozen=True, eq=False)
class Declaration:
    """Declaration of a format: how a file is recognised, and which object reads it, imported when it reads.

    Attributes:
        is_mine: as that of the format; it must need no more than the file's name and first bytes.
        reader: imports and returns a `MapFormat` or another format.
    """

    is_mine: Callable[[Path], bool]
    reader: Callable[[], Any]


def with_notes(read: Callable[[Path], TrackTable]) -> Callable[..., tuple[TrackTable, tuple[str, ...]]]:
    """Return the ``read`` of a dataset of single files by a reader of a table with its notes."""
    return lambda paths, **_: (table := read(paths[0]), table.notes)


def own_maps(dataset: str, name: Callable[[Path], str]) -> Callable[[Sequence[Path]], list[Recording]]:
    """Return the ``recordings`` of a dataset of single files that are their own maps."""

    def recording(path: Path) -> Recording:
        place = name(path)
        return Recording(name=place, site=place, dataset=dataset, map_path=path, track_paths=(path,))

    return lambda files: [recording(path) for path in files]


def map_format(path: Path) -> MapFormat:
    """The format of a map; Lanelet2 for what no other format recognises."""
    return next(recognised(MapFormat, path))


def is_map(path: Path) -> bool:
    """Whether a file is a map, by its name, else by its beginning."""
    *others, _ = _entries(MapFormat)
    return unpacked_name(path).endswith(".osm") or any(entry.is_mine(path) for entry in others)


def refuse_other_than_map(path: Path) -> None:
    """Refuse a folder or tracks that are given as a map."""
    if path.is_dir():
        example = next((file.name for file in sorted(path.iterdir()) if is_map(file)), "")
        raise MapError(f"{path}: a folder; give a map{f' in it, e.g. {example}' if example else ''}")
    if not path.is_file() or is_map(path):
        return
    if recording := next(iter(dataset_of(path).recordings([path])), None):
        its_map = f"its map is {recording.map_path}"
        raise MapError(f"{path}: a recording, not a map; {its_map}, and --tracks names the recording")
    if unpacked_name(path).endswith(".csv"):
        raise MapError(f"{path}: a table, not a map; give the map first, and tracks by --tracks")


def dataset_of(path: Path) -> Dataset:
    """The dataset of a track file or folder; INTERACTION for what no other dataset recognises."""
    return next(recognised(Dataset, path))


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


def place_name(map_path: Path) -> str:
    """Name of the place of a map, as its format has it."""
    return map_format(map_path).name(map_path)


def recognised(kind: type[Format], path: Path) -> Iterator[Format]:
    """Formats that recognise a file, the first one first; only their readers are imported."""
    key: Any = kind
    return (_read_by(key, entry) for entry in _entries(key) if entry.is_mine(path))


@cache
def _entries(kind: type[Any]) -> tuple[Any, ...]:
    """All formats: those of other packages, then ours, then the one that takes the rest."""
    registry, entries = kind.registry, list[Any]()
    paths = registry.paths
    for name in sorted(paths, key=lambda name: (name == registry.last, registry.is_ours(name))):
        try:
            entries.append(_checked(kind, name, import_object(paths[name]), ours=registry.is_ours(name)))
        except UsageError as error:
            print(f"warning: {registry.kind} {name} is left out: {error}", file=sys.stderr)
    return tuple(entries)


@cache
def _read_by(kind: type[Any], entry: Any) -> Any:
    if not isinstance(entry, Declaration):
        return entry
    ours = entry.reader.__module__.startswith(f"{__package__.partition('.')[0]}.")
    return _checked(kind, entry.reader.__module__, entry.reader(), ours=ours)


def _checked(kind: type[Any], name: str, entry: Any, *, ours: bool) -> Any:
    """Return a format, or a declaration of one; errors of another package's functions are one line."""
    label, declared = f"{kind.registry.kind} {name}", Declaration if isinstance(entry, Declaration) else kind
    needs = {(MapFormat, "read"): Road, (Dataset, "read"): tuple, (Dataset, "recordings"): list}
    attributes: dict[str, Any] = {}
    for attribute in fields(declared):
        if attribute.default is MISSING and not hasattr(entry, attribute.name):
            raise UsageError(f"{label}: {entry!r} has no function {attribute.name}")
        if hasattr(entry, attribute.name):
            attributes[attribute.name] = value = getattr(entry, attribute.name)
            if callable(value) and not ours:
                from scex_sumo.base.blame import own_call

                need = needs.get((kind, attribute.name), object)
                attributes[attribute.name] = own_call(f"{label}: {attribute.name}", value, need)
    return declared(**attributes)
