"""SUMO folder: net, vehicle types, routes and a state from which SUMO continues a future.

Vehicles of a SUMO simulation keep routes, types' attributes, speed factors, next stops and names.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from scex_sumo.base.errors import UsageError
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.base.sumo.car_following import OWN_MODEL
from scex_sumo.behaviors.models.sumo_driver import SumoDriver
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.converters.xml import net_root
from scex_sumo.exporters.request import Request
from scex_sumo.intention import MAX_BEHIND, Intention
from scex_sumo.results.road import load_intentions
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene
from scex_sumo.world.batch import vehicle_ids
from scex_sumo.world.sumo import SumoDriven, SumoWorld
from scex_sumo.world.tiles import tile_prefix

NET, STATE = "net.net.xml", "state.xml"
_MODEL = "EIDM"
_END_S = 60
_BLOCKED_S = 5  # after which others pass a vehicle that stands in a junction: futures can end in a deadlock

_CONFIGURATION = """<configuration>
    <net-file value="{net}"/>
    <load-state value="{state}"/>
    <step-length value="{step}"/>
    <end value="{end}"/>
    <collision.action value="none"/>
    <time-to-teleport value="-1"/>
    <ignore-junction-blocker value="{blocked}"/>
    <default.speeddev value="0"/>
    <no-step-log value="true"/>
</configuration>
"""
_README = """# Future {future} of {name}, continued by SUMO

`sumo-gui -c future.sumocfg` begins with the last step of this future. SUMO drives all vehicles by {model},
on the routes that `sumo:` drivers take in a run. Edges, lights and vehicles have the names of the net. {left}
"""


def write_sumo(request: Request) -> list[Path]:
    """Write a folder for each future, in which SUMO continues from its last step."""
    files = []
    for future in request.futures:
        folder = request.folder if len(request.futures) == 1 else request.folder / f"future{future:04d}"
        files.append(_write_future(request, future, folder))
    return files


def _write_future(request: Request, future: int, folder: Path) -> Path:
    end_s = STEP_S * int(request.run.info["steps"])
    scene = _at_the_end(request, future)
    routes = SumoDriver(_MODEL).routes(
        scene, request.road, np.arange(scene.vehicles), np.zeros(scene.vehicles)
    )
    edges = [tuple(request.run.net.lanes.edges(route)) for route in routes]
    known = [_later(one, edges[v], end_s) for v, one in enumerate(load_intentions(request.run.folder))]
    scene = replace(scene, intentions=tuple(known))
    walks = np.array([road_user(kind) == "pedestrian" for kind in scene.types])
    there = np.isfinite(scene.now.x)
    kept = [v for v, route in enumerate(edges) if route and there[v] and not walks[v]]
    if not kept:
        raise UsageError(f"future {future}: no vehicle is on a mapped lane at its end; choose another one")
    left_out = [name for v, name in enumerate(scene.names) if v not in kept]
    scene = scene.reordered(kept, name=scene.name)
    driven = [_driven(scene, n, edges[v]) for n, v in enumerate(kept)]
    with TemporaryFolder() as temporary:
        net = Path(temporary) / NET
        net.write_bytes(_lights_at(request.run.net.path, end_s))
        unsaved = tuple(one and replace(one, saved="") for one in scene.intentions)  # of the moment
        now = replace(scene, intentions=unsaved)
        with SumoWorld(replace(request.run.net, path=net), now, slots=[0]) as world:
            world.begin(scene.now.repeat(1), np.zeros(1, dtype=np.int64), driven)
            world.save(Path(temporary))
        request.write(folder / NET, net.read_bytes())
        request.write(folder / STATE, _renamed(Path(temporary) / STATE, scene))
    left = f"Off the lanes, arrived or on foot, and left out: {', '.join(left_out)}." if left_out else ""
    model = "its own car-following model" if any(known) else _MODEL
    text = _README.format(future=future, name=request.name, model=model, left=left)
    request.write(folder / "README.md", text.encode())
    configuration = _CONFIGURATION.format(step=STEP_S, end=_END_S, blocked=_BLOCKED_S, net=NET, state=STATE)
    request.write(folder / "future.sumocfg", configuration.encode())
    return folder / "future.sumocfg"


def _at_the_end(request: Request, future: int) -> SeedScene:
    states = request.run.states(future)[:, -HISTORY_STEPS - 1 :]
    return replace(request.scene, history=states, future=None, future_valid=None, obstacles=None)


def _later(intention: Intention | None, ahead: tuple[str, ...], after_s: float) -> Intention | None:
    """Return what a vehicle is to do after a time, from the edge on that comes first among those ahead."""
    if intention is None:
        return None
    first = next((intention.edges.index(edge) for edge in ahead if edge in intention.edges), None)
    stops = tuple(
        replace(stop, until_s=stop.until_s - after_s if stop.until_s >= 0 else -1.0)
        for stop in intention.stops
    )
    edges = ahead if first is None else intention.edges[first:]
    behind = intention.behind if first == 0 else intention.edges[: first or 0][-MAX_BEHIND:]
    return replace(intention, edges=edges, behind=behind, stops=stops, change_mps=0.0)


def _driven(scene: SeedScene, vehicle: int, edges: tuple[str, ...]) -> SumoDriven:
    intention, model, parameters = scene.intention(vehicle), _MODEL, dict[str, str]()
    if intention is not None:
        edges = intention.edges
        model, parameters = SumoDriver(OWN_MODEL).driving(scene, vehicle)
    arrival = None if intention is None else intention.arrival
    return SumoDriven(
        future=0, vehicle=vehicle, model=model, parameters=parameters, edges=edges, arrival=arrival
    )


def _lights_at(net: Path, time_s: float) -> bytes:
    """Return a net whose lights are those at a time after the moment."""
    root = net_root(net)
    for light in root.iter("tlLogic"):
        cycle_s = sum(float(phase.get("duration", "0")) for phase in light.iter("phase"))
        if cycle_s > 0:
            light.set("offset", f"{(float(light.get('offset', '0')) - time_s) % cycle_s:.3f}")
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))


def _name_types(root: ElementTree.Element, scene: SeedScene) -> None:
    """Give the vehicles of a saved state the names of their types in their simulation."""
    types = {kind.get("id", ""): kind for kind in root.iter("vType")}
    for vehicle in root.iter("vehicle"):
        intention = scene.intention(scene.names.index(vehicle.get("id", "")))
        saved = ElementTree.fromstring((intention and intention.saved) or "<user/>")
        name = "".join(own.get("id", "") for own in saved.iter("vType")).partition("@")[0]
        if name and not name.startswith("DEFAULT_"):
            here = types[vehicle.get("type", "")]
            if name not in types:
                types[name] = ElementTree.Element("vType", {**here.attrib, "id": name})
                root.insert(list(root).index(here), types[name])
            vehicle.set("type", name)


def _renamed(state: Path, scene: SeedScene) -> bytes:
    """Return a saved state without the prefix of its tile, with the names of the vehicles."""
    root, names = ElementTree.parse(state).getroot(), scene.names
    vehicles = dict(zip(vehicle_ids([0], scene.track_ids), names, strict=True))
    for element in root.iter():
        is_list = element.tag in ("vehicle", "vehicles")
        for key, value in element.attrib.items():
            words = [vehicles.get(word, word) if is_list else word for word in value.split(" ")]
            element.set(key, " ".join(re.sub(f"^(:?){tile_prefix(0)}", r"\1", word) for word in words))
    _name_types(root, scene)
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))
