"""Conversion of roads to SUMO nets: written, or a copy of the road's own net; cached."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from scex_sumo.base.arguments import checked
from scex_sumo.base.cache import cached_object
from scex_sumo.base.errors import MapError, UsageError
from scex_sumo.base.files import sha256_of, write_atomic
from scex_sumo.base.owned import owner_cache
from scex_sumo.base.version import __version__, version_of
from scex_sumo.converters.net.sumo_net import OPENDRIVE, RECORDED, LaneTable, SumoNet, WrittenNet, net_file
from scex_sumo.converters.registries import map_format
from scex_sumo.road import MapLoss, Road
from scex_sumo.scene import STEP_S


@checked
def convert(road: Road, net_path: str | Path, *, signals: str | Path | None = None) -> SumoNet:
    """Write a road as a SUMO net, with its lane table NET.lanes.csv and its drawing NET.add.xml beside it.

    Args:
        signals: CSV of recorded signal phases (SPaT); the intersection's KML must lie beside it.

    Raises:
        UsageError: the path names no file.
        ResultError: a file is there that this program did not write, or an input.
        MapError: the road has no vehicle lanes, or some without length; the signals cannot be used.

    Example:
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> net = scex.convert(scene.road, Path("roundabout.net.xml"))
        >>> net.path.is_file()
        True
    """
    from scex_sumo.base.outputs import check_output, write_output

    if not Path(net_path).name:
        raise UsageError(f"net_path: {str(net_path)!r} names no file")
    inputs = [Path(file) for file in (road.file, signals) if file is not None]
    for file in (Path(net_path), *(net_file(Path(net_path), ending) for ending in (_LANES, _DRAWING))):
        check_output(file, *inputs)
    written = _written(road, None if signals is None else Path(signals))
    return _with_files(written, Path(net_path), write=write_output)


def converted(
    road: Road, net_path: Path, *, keep: bool = True, signals: Path | None = None, time_s: float = 0.0
) -> SumoNet:
    """Convert a road as `convert` does, or take the net from the cache; keep a map that is OpenDRIVE beside.

    Args:
        keep: False neither reads nor writes the cache.
        signals: recorded phases, which begin at ``time_s`` of their recording; a note says why they are left
            out if they cannot be used.
    """
    given = None if road.file is None else map_format(road.file).opendrive(road.file)
    if given is not None:
        write_atomic(net_file(net_path, OPENDRIVE), given)
    if signals is None:
        return _with_files(_net(road, keep), net_path)
    try:
        net = _net(road, keep, signals)
    except MapError as error:
        net = _net(road, keep)
        net = replace(net, notes=(*net.notes, f"recorded lights are left out: {error}"))
    # A future begins at 0.1 s of its simulation.
    light = f'programID="{RECORDED}" offset='
    content = net.content.replace(f'{light}"0"', f'{light}"{STEP_S - time_s:.3f}"')
    return _with_files(net, net_path, content)


def _net(road: Road, keep: bool, signals: Path | None = None) -> WrittenNet:
    if not keep:
        return _written(road, signals)
    # A KML beside the phases says to which lanes they belong.
    files = [] if signals is None else [signals, *sorted(signals.parent.glob("*.kml"))]
    return _cached(road, signals, *map(sha256_of, files))


@owner_cache
def _cached(road: Road, signals: Path | None, *digest: str) -> WrittenNet:
    if road.net is not None:
        return _written(road, signals)
    made_of = (__version__, version_of("shapely"), road, *digest)
    key = hashlib.sha256(pickle.dumps(made_of)).digest()
    return cached_object("nets", key, partial(_written, road, signals), (WrittenNet, LaneTable, MapLoss))


def _written(road: Road, signals: Path | None = None) -> WrittenNet:
    from scex_sumo.lanelet2sumo.net import copy_net, write_net  # most nets come from the cache

    if road.net is not None:
        return copy_net(road)
    from scex_sumo.roads.check import check_road

    check_road(road, f"road {road.name}")
    return write_net(road, signals)


_LANES, _DRAWING = ".lanes.csv", ".add.xml"


def _with_files(
    net: WrittenNet, net_path: Path, content: str = "", write: Callable[[Path, bytes], None] = write_atomic
) -> SumoNet:
    """Write the files of a net, with another content if it is given."""
    extras = net_file(net_path, _DRAWING)
    write(net_path, (content or net.content).encode())
    write(net_file(net_path, _LANES), net.lanes.text.encode())
    write(extras, net.drawing.encode())
    return SumoNet(path=net_path, extras=extras, lanes=net.lanes, notes=net.notes, losses=net.losses)
