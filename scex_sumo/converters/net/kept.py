"""Kept nets: what a road was converted to stays in the user's cache for the next run on the same map.

A net is kept under a hash of the road and of the very modules that convert it, so that neither another map
nor another version finds it. It is there whole or not at all, whoever else writes it.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import os
import pickle
import shutil
import tempfile
from pathlib import Path
from typing import Any

from scex_sumo.converters.net.lane_table import LaneTable
from scex_sumo.converters.net.sumo_net import SumoNet, net_file
from scex_sumo.files import cache_folder
from scex_sumo.kept import our_modules
from scex_sumo.road import Loss, Road
from scex_sumo.version import __version__, version_of

MOST_NETS = 64  # those not used for longest go first
_ENDINGS = (".net.xml", ".lanes.csv", ".add.xml")
_REST = "rest.json"


def converted(road: Road, net_path: Path, *, keep: bool = True) -> SumoNet:
    """What `convert` gives, from the cache where it has it.

    Args:
        road: the map.
        net_path: where the net shall be; usually ends in ``.net.xml``.
        keep: False neither looks into the cache nor writes there.
    """
    place = cache_folder() / "nets" / _key(road) if keep else None
    if place is not None:
        with contextlib.suppress(OSError, ValueError, KeyError):  # not there, or removed meanwhile
            return _taken(place, net_path)
    from scex_sumo.converters.net.convert import convert

    net = convert(road, net_path)
    if place is not None:
        with contextlib.suppress(OSError):  # a full disk, or a home that cannot be written, stops no run
            _put(place, net)
    return net


def _key(road: Road) -> str:
    made_by = (__version__, version_of("shapely"), our_modules())
    return hashlib.sha256(pickle.dumps((made_by, road))).hexdigest()


def _taken(place: Path, net_path: Path) -> SumoNet:
    rest = json.loads((place / _REST).read_text(encoding="utf-8"))
    for ending in _ENDINGS:
        kept = place / f"map{ending}"
        if kept.stat().st_size != rest["size"][ending]:
            raise ValueError(f"{kept}: was not written whole")
        shutil.copyfile(kept, _file(net_path, ending))
    os.utime(place)
    ends = {lane: (before, after) for lane, (before, after) in rest["ends"].items()}
    rows = [(lanelet, lane) for lanelet, lane in rest["rows"]]
    extras = _file(net_path, ".add.xml")
    losses = tuple(Loss(**{**loss, "elements": tuple(loss["elements"])}) for loss in rest["losses"])
    lanes, notes = LaneTable(rows, ends), tuple(rest["notes"])
    return SumoNet(path=net_path, extras=extras, lanes=lanes, notes=notes, losses=losses)


def _file(net_path: Path, ending: str) -> Path:
    return net_path if ending == ".net.xml" else net_file(net_path, ending)


def _put(place: Path, net: SumoNet) -> None:
    """Keep a net, and no more nets than there may be."""
    place.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=place.parent, prefix=".new-") as name:
        new = Path(name) / "net"
        new.mkdir()
        size = {}
        for ending in _ENDINGS:
            file = shutil.copyfile(_file(net.path, ending), new / f"map{ending}")
            size[ending] = file.stat().st_size
        rest: dict[str, Any] = {
            "rows": net.lanes.rows,
            "ends": net.lanes.ends,
            "notes": net.notes,
            "size": size,
        }
        rest["losses"] = [dataclasses.asdict(loss) for loss in net.losses]
        (new / _REST).write_text(json.dumps(rest), encoding="utf-8")
        shutil.rmtree(place, ignore_errors=True)  # one that could not be read
        new.rename(place)  # raises where somebody else was faster
    nets = sorted((p for p in place.parent.iterdir() if not p.name.startswith(".")), key=_last_used)
    for old in nets[:-MOST_NETS]:
        shutil.rmtree(old, ignore_errors=True)


def _last_used(place: Path) -> float:
    try:
        return place.stat().st_mtime
    except OSError:  # removed meanwhile
        return 0.0
