"""Road of a run and intentions of its road users in the result folder, so that exports need no other file."""

from __future__ import annotations

import zlib
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from scex_sumo.base.cache import UNPACKABLE, pack, unpack
from scex_sumo.base.errors import ResultError, one_line
from scex_sumo.base.files import write_atomic
from scex_sumo.road import Area, Georeference, Lane, MapLoss, Marking, Regulation, Road
from scex_sumo.scene import SeedScene

if TYPE_CHECKING:
    from scex_sumo.intention import Intention, Walk

ROAD: Final = "road.bin"
INTENTIONS: Final = "intentions.bin"
_ROAD_PARTS = (Road, Lane, Regulation, Marking, Area, MapLoss, Georeference)


def save_road(folder: Path, road: Road) -> None:
    """Keep the road of a run in its result folder."""
    write_atomic(folder / ROAD, zlib.compress(pack(replace(road, net=None, file=None), _ROAD_PARTS)))


def load_road(folder: Path) -> Road:
    """Return the road of `save_road`; raise a `ResultError` if there is none, or a damaged one."""
    road = _unpacked(folder / ROAD, _ROAD_PARTS)
    if not isinstance(road, Road):
        raise ResultError(f"{folder / ROAD}: holds no road; run again")
    return road


def save_intentions(folder: Path, scene: SeedScene) -> None:
    """Keep the intentions (V,) of a simulation's vehicles and the walks (O,) in a result folder, if any."""
    if scene.intentions:
        from scex_sumo.intention import Stop

        known = tuple(plan and {**vars(plan), "lanes": (), "arrives": ()} for plan in scene.intentions)
        walks = () if scene.obstacles is None else tuple(map(tuple, scene.obstacles.walks))
        write_atomic(folder / INTENTIONS, zlib.compress(pack((known, walks), (Stop,))))


def load_intentions(folder: Path) -> tuple[tuple[Intention | None, ...], tuple[Walk, ...]]:
    """Return what `save_intentions` kept, without lanes; (), () of a run of recorded vehicles."""
    if not (folder / INTENTIONS).is_file():
        return (), ()
    from scex_sumo.intention import Intention, Stop, Walk

    try:
        known, walks = _unpacked(folder / INTENTIONS, (Stop,))
        return tuple(plan and Intention(**plan) for plan in known), tuple(Walk(*walk) for walk in walks)
    except (TypeError, ValueError):
        raise ResultError(f"{folder / INTENTIONS}: holds no intentions; run again") from None


def _unpacked(file: Path, parts: tuple[type, ...]) -> Any:
    try:
        return unpack(zlib.decompress(file.read_bytes()), parts)
    except (OSError, zlib.error, *UNPACKABLE) as error:
        raise ResultError(f"{file}: cannot be read: {one_line(error)[:120]}; run again") from None
