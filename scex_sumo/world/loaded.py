"""State from which SUMO's drivers go on as their simulation does: all that SUMO saves of each of them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Final, NamedTuple
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr as quoted

from scex_sumo.base.sumo.car_following import RANDOM_PARAMETERS
from scex_sumo.scene import SeedScene
from scex_sumo.world.base import SumoDriven
from scex_sumo.world.batch import RunningBatch, obstacle_id
from scex_sumo.world.tiles import prefixed, tile_id, tile_prefix
from scex_sumo.world.vehicle_types import TypeBook

OWN_TYPE: Final = "own_"
"""Begin of the name of a road user's type in its simulation."""
_TYPE_SET = 2  # bit of a state: else SUMO saves no type
_LANE = re.compile(r":?\S*_\d+")
_TILE, _KEY, _KIND = "\x01", "\x02", "\x03"  # marks; no characters of XML 1.0


class Loaded(NamedTuple):
    """Road user of a tile, as its simulation's state has it.

    Attributes:
        key: SUMO's id.
        kind: its type; "" for the one that it has in its simulation.
        saved: as of `Intention.saved`.
    """

    key: str
    kind: str
    slot: int
    saved: str


def users_of(
    scene: SeedScene, batch: RunningBatch, driven: Sequence[SumoDriven], types: TypeBook
) -> dict[str, Loaded]:
    """Return the road users of futures with SUMO drivers, by id; none if SUMO saved one incompletely."""
    users, by_sumo = dict[str, Loaded](), {(d.future, d.vehicle): d for d in driven}
    for future in sorted({d.future for d in driven}):
        slot = batch.slots[future]
        for v, intention in enumerate(scene.intentions):
            if intention is not None and intention.saved:
                d, key = by_sumo.get((future, v)), batch.id_of(future, v)
                kind = types.driven(v, d.model, d.parameters) if d else types.overridden(v)
                users[key] = Loaded(key, kind, slot, intention.saved)
        if (others := scene.obstacles) is not None:
            for name, walk in zip(others.ids, others.walks, strict=False):
                if walk.saved:
                    key = obstacle_id(slot, name)
                    users[key] = Loaded(key, "", slot, walk.saved)
                elif walk.edges:
                    return {}
    return users if all(batch.id_of(d.future, d.vehicle) in users for d in driven) else {}


def state_with(
    empty: bytes, users: Iterable[Loaded], time_s: float, lights: Iterable[ElementTree.Element] = ()
) -> bytes:
    """Return the state of empty tiles with road users, at the time of their simulation.

    ``lights``: of a simulation's state, in the first tile; the others go on from the begin.
    """
    root = ElementTree.fromstring(empty)
    later_ms = round(1000 * (time_s - float(root.get("time", "0"))))
    root.set("time", f"{time_s:.3f}")
    for light in root.iter("tlLogic"):
        light.set("until", str(int(light.get("until", "0")) + later_ms))
    for own in lights:
        key, programme = tile_id(0, own.get("id", "")), own.get("programID", "")
        for light in root.iterfind(f"tlLogic[@id={key!r}][@programID={programme!r}]"):
            light.attrib = {**own.attrib, "id": key}
    types, lanes = set[str](), dict[str, list[tuple[int, str]]]()
    vehicles, persons = list[str](), list[str]()
    for key, kind, slot, saved in users:
        key, kind = quoted(key)[1:-1], quoted(kind)[1:-1]
        own_type, own_kind, text, lane, order = _marked(saved)
        if not kind:
            types.add(own_type)
        text = text.replace(_KIND, kind or own_kind).replace(_KEY, key).replace(_TILE, tile_prefix(slot))
        (vehicles if lane else persons).append(text)
        if lane:
            lanes.setdefault(tile_id(slot, lane), []).append((order, key))
    for counts in root.iter("delay"):
        counts.attrib |= dict.fromkeys(("number", "begin"), str(len(vehicles)))
    text = "".join([*sorted(types), *vehicles])
    if count := len(persons):  # on their way, loaded, ...
        states = f"{count} {count} 0 0 0 0 0 0 0"
        text += f'<transportables type="person" state="{states}">{"".join(persons)}</transportables>'
    for lane, there in lanes.items():
        keys = " ".join(key for _, key in sorted(there))
        text += f'<lane id={quoted(lane)}><vehicles value="{keys}"/></lane>'
    return ElementTree.tostring(root).replace(b"</snapshot>", f"{text}</snapshot>".encode())


@lru_cache(maxsize=4096)
def _marked(saved: str) -> tuple[str, str, str, str, int]:
    """Return type, its name, text, lane and order on it of a road user, with marks for tile, id and type."""
    user, own_type = ElementTree.fromstring(saved), ""
    own = user.find("vType")
    (element,) = (*user.iter("vehicle"), *user.iter("person"))
    own_kind = element.get("type", "")
    if own is not None and not own_kind.startswith("DEFAULT_"):
        own_kind = OWN_TYPE + own_kind
        own.attrib |= {**dict.fromkeys(RANDOM_PARAMETERS, "0"), "id": own_kind}
        own_type = ElementTree.tostring(own, encoding="unicode")
    element.attrib |= {"id": _KEY, "type": _KIND}
    for child in element.iter():
        for name in {"lane", "edges"} & child.attrib.keys():
            child.set(name, _edges(child.attrib[name]))
    lane, route, words = user.get("lane", ""), "", element.get("state", "").split()
    words[0] = str(int(words[0]) | _TYPE_SET)
    if lane:
        element.set("route", f"saved_{_KEY}")
        route = f'<route id="saved_{_KEY}" state="1" edges={quoted(_edges(user.get("edges", "")))}/>'
    else:
        words = [prefixed(_TILE, word) if _LANE.fullmatch(word) else word for word in words]
    element.set("state", " ".join(words))
    text = ElementTree.tostring(element, encoding="unicode")
    return own_type, quoted(own_kind)[1:-1], route + text, lane, int(user.get("order", "0"))


def _edges(edges: str) -> str:
    return " ".join(prefixed(_TILE, edge) for edge in edges.split())
