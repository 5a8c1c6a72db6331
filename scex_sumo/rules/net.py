"""Rules of the road, read from the SUMO net of a run: what SUMO's drivers see, ours see too."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.etree.ElementTree import Element

from scex_sumo.base.files import TemporaryFolder
from scex_sumo.base.owned import owner_cache
from scex_sumo.converters.net.sumo_net import RECORDED, LaneTable, SumoNet
from scex_sumo.converters.registries import signals_of
from scex_sumo.converters.xml import net_root, unpacked
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.road import Road
from scex_sumo.road_rules import Passage, Rules
from scex_sumo.rules.links import Link, by_junction, junction_links, passages_of, signals_of_links
from scex_sumo.scene import SeedScene

BOTH_WAYS = "wZ="  # link states of which two may give way to each other


def with_rules(scene: SeedScene, net: SumoNet) -> tuple[SeedScene, tuple[str, ...]]:
    """Return a scene with the rules of its road (None if it has none), and notes, by the road's net."""
    file = _NetFile(path=net.path, digest=hashlib.sha256(unpacked(net.path)).hexdigest())
    if scene.rules is not None and scene.rules.net == file.digest:
        return scene, scene.rules.notes
    rules_read = _rules_of(scene, net.lanes, file)
    rules = rules_read if rules_read.passages or rules_read.crosswalks else None
    return scene if scene.rules is rules else _ruled(scene, rules), rules_read.notes


@dataclass(frozen=True)
class _NetFile:
    """File of a net; one with the same content is equal."""

    path: Path = field(compare=False)
    digest: str


@owner_cache
def _ruled(scene: SeedScene, rules: Rules | None) -> SeedScene:
    return replace(scene, rules=rules)


@owner_cache
def _rules_of(scene: SeedScene, lanes: LaneTable, net: _NetFile) -> Rules:
    """Return the rules of a scene's road, with recorded lights."""
    road = scene.road
    assert road is not None
    signals = signals_of(scene)
    if signals is None:
        rules = _rules_of_road(road, lanes, net)
        known = road.regulations or road.net
        if known:
            return rules
        from scex_sumo.rules.apparent import with_apparent_lights

        return with_apparent_lights(scene, _junctions(road, net), lanes, rules)
    root = net_root(net.path)
    if not _is_recorded(root):
        with TemporaryFolder() as folder:
            path = Path(folder) / "lit.net.xml"
            lanes = converted(road, path, signals=signals, time_s=scene.time_s).lanes
            root = net_root(path)
    rules = read_rules(root, lanes, road)
    recorded = (f"lights as recorded in {signals.name}",) if _is_recorded(root) else ()
    return replace(rules, notes=(*recorded, *rules.notes), net=net.digest)


@owner_cache
def _rules_of_road(road: Road, lanes: LaneTable, net: _NetFile) -> Rules:
    """Return the rules of a road without recorded lights, once for all its moments."""
    return replace(read_rules(net_root(net.path), lanes, road), net=net.digest)


@owner_cache
def _junctions(road: Road, net: _NetFile) -> dict[str, list[Link]]:
    """Return the links of each junction of a road's net, once for all its moments."""
    return dict(sorted(by_junction(junction_links(net_root(net.path))).items()))


def _is_recorded(root: Element) -> bool:
    return any(logic.get("programID") == RECORDED for logic in root.iter("tlLogic"))


def read_rules(root: Element, lanes: LaneTable, road: Road) -> Rules:
    """Return the rules of a net, with notes on what contradicts itself, where nothing is obeyed.

    Lights whose phases are invented, also by netconvert for OpenStreetMap, are unknown.
    """
    links = junction_links(root)
    signals, notes = signals_of_links(root, links, known=road.net is not None and road.phases)
    of_junction, passages = by_junction(links), list[Passage]()
    for junction in root.iter("junction"):
        mine = of_junction.get(junction.get("id", ""), [])
        if any(link.light is not None and link.light not in signals for link in mine):
            continue
        lit = any(link.light is not None for link in mine)
        if not lit and junction.get("type", "").startswith("traffic_light"):
            continue  # its lights were left out
        # Without regulations the net's right of way is guessed.
        if lit or ((road.regulations or road.net) and any(link.yields for link in mine)):
            if twice := _contradiction(mine):
                notes.append(f"junction {junction.get('id')}: {twice} give way to each other; no rules there")
                continue
            passages += passages_of(mine, len(passages), signals, lanes)
    crosswalks = tuple(area.outline for area in road.areas if area.kind == "crosswalk")
    lines = tuple(line for rule in road.regulations for line in rule.stop_lines)
    states = tuple(signals.values())
    if unknown := sum(p.signal >= 0 and not states[p.signal].letters for p in passages):
        notes.append(f"lights of {unknown} passages are unknown: inferred from vehicles that stand or drive")
    return Rules(
        passages=tuple(passages), signals=states, stop_lines=lines, crosswalks=crosswalks, notes=tuple(notes)
    )


def _contradiction(links: Sequence[Link]) -> str:
    """Name two links without all-way stop, zipper or right before left that give way to each other."""
    by_row = {link.row: link for link in links}
    for link in links:
        for row in link.yields:
            other = by_row.get(row)
            both = other is not None and link.row in other.yields and link.light is None
            if other is not None and both and not {link.state, other.state} & set(BOTH_WAYS):
                return " and ".join(f"{waiting.lanes[0]} to {waiting.lanes[-1]}" for waiting in (link, other))
    return ""
