"""Road of a run in its result folder, so that exports need no map."""

from __future__ import annotations

import zlib
from dataclasses import replace
from pathlib import Path
from typing import Final

from scex_sumo.base.cache import UNPACKABLE, pack, unpack
from scex_sumo.base.errors import ResultError, one_line
from scex_sumo.base.files import write_atomic
from scex_sumo.road import Area, Georeference, Lane, MapLoss, Marking, Regulation, Road

ROAD: Final = "road.bin"
_ROAD_PARTS = (Road, Lane, Regulation, Marking, Area, MapLoss, Georeference)


def save_road(folder: Path, road: Road) -> None:
    """Keep the road of a run in its result folder."""
    write_atomic(folder / ROAD, zlib.compress(pack(replace(road, net=None, file=None), _ROAD_PARTS)))


def load_road(folder: Path) -> Road:
    """Return the road of `save_road`; raise a `ResultError` if there is none, or a damaged one."""
    file = folder / ROAD
    try:
        road = unpack(zlib.decompress(file.read_bytes()), _ROAD_PARTS)
    except (OSError, zlib.error, *UNPACKABLE) as error:
        raise ResultError(f"{file}: cannot be read: {one_line(error)[:120]}; run again") from None
    if not isinstance(road, Road):
        raise ResultError(f"{file}: holds no road; run again")
    return road
