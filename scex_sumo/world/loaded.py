"""State from which SUMO's drivers go on as their simulation does: all that SUMO saves of each of them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from scex_sumo.base.sumo.car_following import RANDOM_PARAMETERS
from scex_sumo.scene import SeedScene
from scex_sumo.world.base import SumoDriven
from scex_sumo.world.batch import RunningBatch
from scex_sumo.world.tiles import tile_id
from scex_sumo.world.vehicle_types import TypeBook

_LANE = re.compile(r":?\S*_\d+")


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
    """Return the road users of futures with SUMO drivers, by id; none if one of these is unknown."""
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
                    key = tile_id(slot, f"other{name}")
                    users[key] = Loaded(key, "", slot, walk.saved)
    return users if all(batch.id_of(d.future, d.vehicle) in users for d in driven) else {}


def state_with(empty: bytes, users: Iterable[Loaded], time_s: float) -> bytes:
    """Return the state of empty tiles with road users, at the time of their simulation."""
    root = ElementTree.fromstring(empty)
    later_ms = round(1000 * (time_s - float(root.get("time", "0"))))
    root.set("time", f"{time_s:.3f}")
    for light in root.iter("tlLogic"):
        light.set("until", str(int(light.get("until", "0")) + later_ms))
    types, lanes, vehicles = dict[str, Element](), dict[str, list[tuple[int, str]]](), list[Element]()
    persons = Element("transportables", type="person")
    for key, kind, slot, saved in users:
        user = ElementTree.fromstring(saved)
        own = user.find("vType")
        if not kind and own is not None and not own.get("id", "").startswith("DEFAULT_"):
            kind = f"own_{own.get('id')}"
            types[kind] = Element(
                "vType", {**own.attrib, **dict.fromkeys(RANDOM_PARAMETERS, "0"), "id": kind}
            )
        for one in (*user.iter("vehicle"), *user.iter("person")):
            one.set("id", key)
            one.set("type", kind or one.get("type", ""))
            for part in one.iter():
                _rename(part, slot)
            (persons if one.tag == "person" else vehicles).append(one)
        if "lane" in user.attrib:
            SubElement(root, "route", id=f"saved_{key}", state="1", edges=_edges(user.get("edges", ""), slot))
            vehicles[-1].set("route", f"saved_{key}")
            lane = tile_id(slot, user.get("lane", ""))
            lanes.setdefault(lane, []).append((int(user.get("order", "0")), key))
    if len(persons):
        persons.set("state", f"{len(persons)} {len(persons)} 0 0 0 0 0 0 0")  # on their way, loaded, ...
    for counts in root.iter("delay"):
        counts.attrib |= dict.fromkeys(("number", "begin"), str(len(vehicles)))
    root.extend([*types.values(), *vehicles, *([persons] if len(persons) else [])])
    for lane, there in lanes.items():
        SubElement(SubElement(root, "lane", id=lane), "vehicles", value=" ".join(k for _, k in sorted(there)))
    return ElementTree.tostring(root)


def _rename(part: Element, slot: int) -> None:
    """Give a vehicle, person, stop or walk the names of its tile."""
    if "lane" in part.attrib:
        part.set("lane", tile_id(slot, part.attrib["lane"]))
    if "edges" in part.attrib:
        part.set("edges", _edges(part.attrib["edges"], slot))
    if part.tag == "person":
        words = part.get("state", "").split()
        part.set("state", " ".join(tile_id(slot, w) if _LANE.fullmatch(w) else w for w in words))


def _edges(edges: str, slot: int) -> str:
    return " ".join(tile_id(slot, edge) for edge in edges.split())
