"""Cache of converted nets, by road and state of the code."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import pickle
from pathlib import Path

from scex_sumo.base.cache import cached_bytes
from scex_sumo.base.version import __version__, version_of
from scex_sumo.converters.net.sumo_net import LaneTable, SumoNet, net_file
from scex_sumo.road import MapLoss, Road

_ENDINGS = (".net.xml", ".lanes.csv", ".add.xml")


def converted(road: Road, net_path: Path, *, keep: bool = True) -> SumoNet:
    """Convert a road as `convert` does, or take the net from the cache.

    ``keep=False`` neither reads nor writes the cache.
    """
    made: list[SumoNet] = []

    def make() -> bytes:
        from scex_sumo.converters.net.convert import convert

        made.append(convert(road, net_path))
        return _packed(made[0]) if keep else b""

    if keep:
        key = hashlib.sha256(pickle.dumps((__version__, version_of("shapely"), road)))
        packed = cached_bytes("nets", key.digest(), make)
    else:
        packed = make()
    if not made:
        try:
            return _unpacked(packed, net_path)
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError):  # not written by us
            make()
    return made[0]


def _file(net_path: Path, ending: str) -> Path:
    return net_path if ending == ".net.xml" else net_file(net_path, ending)


def _packed(net: SumoNet) -> bytes:
    content = {
        "files": {ending: _file(net.path, ending).read_text(encoding="utf-8") for ending in _ENDINGS},
        "rows": net.lanes.rows,
        "ends": net.lanes.ends,
        "notes": net.notes,
        "losses": [dataclasses.asdict(loss) for loss in net.losses],
    }
    return json.dumps(content).encode()


def _unpacked(packed: bytes, net_path: Path) -> SumoNet:
    content = json.loads(packed)
    ends = {str(lane): (str(before), str(after)) for lane, (before, after) in content["ends"].items()}
    net = SumoNet(
        path=net_path,
        extras=_file(net_path, ".add.xml"),
        lanes=LaneTable([(int(lanelet), str(lane)) for lanelet, lane in content["rows"]], ends),
        notes=tuple(map(str, content["notes"])),
        losses=tuple(MapLoss(**{**loss, "elements": tuple(loss["elements"])}) for loss in content["losses"]),
    )
    for ending in _ENDINGS:
        _file(net_path, ending).write_text(content["files"][ending], encoding="utf-8")
    return net
