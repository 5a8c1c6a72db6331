"""SUMO folder: net, vehicle types, routes and a state from which SUMO continues a future.

A simulation goes through the future from its own saved state on: its road users keep names, types, routes,
stops and walks, its lights their programmes.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from scex_sumo.base.errors import UsageError
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.base.sumo.car_following import OWN_MODEL
from scex_sumo.behaviors.models.sumo import SumoDriver
from scex_sumo.converters.net.allowed import SIMULATED, prune
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.converters.xml import net_root
from scex_sumo.exporters.request import Request
from scex_sumo.intention import MAX_BEHIND, Intention, Walk
from scex_sumo.results.obstacles import some_obstacles
from scex_sumo.results.road import load_intentions
from scex_sumo.scene import HISTORY_STEPS, STEP_S, Obstacles, SeedScene, States
from scex_sumo.world.base import BatchStart, SumoDriven, WorldRequest
from scex_sumo.world.batch import obstacle_id, vehicle_ids
from scex_sumo.world.loaded import OWN_TYPE
from scex_sumo.world.sumo import SumoWorld
from scex_sumo.world.tiles import tile_prefix

NET, STATE = "net.net.xml", "state.xml"
_MODEL = "EIDM"
_GOES_ON_S = 60
_SAME_M = 0.01
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
    folder, alone = request.folder, len(request.futures) == 1
    names = {k: folder if alone else folder / f"future{k:04d}" for k in request.futures}
    return [_write_future(request, future, path) for future, path in names.items()]


def _write_future(request: Request, future: int, folder: Path) -> Path:
    steps = int(request.run.info["steps"])
    states = request.run.states(future)
    scene = replace(request.scene, history=states[:, -HISTORY_STEPS - 1 :], obstacles=None)
    routes = SumoDriver(_MODEL).routes(
        scene, request.road, np.arange(scene.vehicles), np.zeros(scene.vehicles)
    )
    edges = [tuple(request.run.net.lanes.edges(route)) for route in routes]
    on_foot = [road_user(kind) == "pedestrian" for kind in scene.types]
    kept = [
        v for v, edge_list in enumerate(edges) if edge_list and np.isfinite(scene.now.x[v]) and not on_foot[v]
    ]
    if not kept:
        raise UsageError(f"future {future}: no vehicle is on a mapped lane at its end; choose another one")
    left_out = [name for v, name in enumerate(scene.names) if v not in kept]
    intentions, walks = load_intentions(request.run.folder)
    if simulated := bool(intentions) and all((intention := intentions[v]) and intention.saved for v in kept):
        time_s = float(request.run.info["seed_scene"]["time_s"])
        others = _with_walks(request.scene.obstacles, walks)
        scene = replace(request.scene, obstacles=others, time_s=time_s)
    elif intentions:
        after_s = STEP_S * steps
        intentions = tuple(_later(intention, edges[v], after_s) for v, intention in enumerate(intentions))
        edges = [intention.edges if intention else edges[v] for v, intention in enumerate(intentions)]
    scene = replace(scene, intentions=intentions, future=None, future_valid=None)
    scene = scene.reordered(kept, name=scene.name)
    driven = [_driven(scene, n, edges[v], simulated=simulated) for n, v in enumerate(kept)]
    net = net_root(request.run.net.path)
    lights = _own_lights(net) if simulated else None
    if not simulated:
        _delay_lights(net, STEP_S * steps)
    with TemporaryFolder() as temporary:
        file = Path(temporary) / NET
        file.write_bytes(ElementTree.tostring(net, encoding="utf-8", xml_declaration=True))
        net_here = replace(request.run.net, path=file)
        with SumoWorld(WorldRequest(scene=scene, net=net_here, slots=[0])) as world:
            world.begin(BatchStart(slots=np.zeros(1, dtype=np.int64), driven=driven), lights=lights)
            if simulated:
                _go_through(world, states[kept, -steps:])
            for n, v in enumerate(kept):
                world.follow(n, _route(scene.intention(n), edges[v]))
            world.save(Path(temporary))
        request.write(folder / NET, file.read_bytes())
        state = _renamed(Path(temporary) / STATE, scene)
    request.write(folder / STATE, ElementTree.tostring(state, encoding="utf-8", xml_declaration=True))
    left = f"Off the lanes, arrived or on foot, and left out: {', '.join(left_out)}." if left_out else ""
    model = "its own car-following model" if intentions else _MODEL
    text = _README.format(future=future, name=request.name, model=model, left=left)
    request.write(folder / "README.md", text.encode())
    end_s = float(state.get("time", "0")) + _GOES_ON_S
    blocked = -1 if simulated else _BLOCKED_S
    configuration = _CONFIGURATION.format(step=STEP_S, end=end_s, blocked=blocked, net=NET, state=STATE)
    request.write(folder / "future.sumocfg", configuration.encode())
    return folder / "future.sumocfg"


def _go_through(world: SumoWorld, states: States) -> None:
    """Let SUMO drive as in the states (V, T) of a future; vehicles that it drives otherwise are moved."""
    moved = np.zeros((1, states.shape[0]), dtype=np.bool_)
    for step in range(states.shape[1]):
        now = states[:, step][None]
        world.move(now, moved)
        world.step()
        seen = world.read()
        moved |= ~(np.hypot(seen.x - now.x, seen.y - now.y) < _SAME_M)


def _route(intention: Intention | None, ahead: tuple[str, ...]) -> tuple[str, ...]:
    """Return the route from the first of the edges ahead on, as intended where the vehicle keeps to that."""
    known = () if intention is None else intention.edges
    first = next((known.index(edge) for edge in ahead if edge in known), None)
    return ahead if first is None else known[first:]


def _later(intention: Intention | None, ahead: tuple[str, ...], after_s: float) -> Intention | None:
    """Return what a vehicle is to do after a time, with these edges ahead."""
    if intention is None:
        return None
    untils = ((stop, stop.until_s - after_s if stop.until_s >= 0 else -1.0) for stop in intention.stops)
    stops = tuple(replace(stop, until_s=until_s) for stop, until_s in untils)
    edges, known = _route(intention, ahead), (*intention.behind, *intention.edges)
    behind = known[: -len(edges)][-MAX_BEHIND:] if known[-len(edges) :] == edges else ()
    return replace(intention, edges=edges, behind=behind, stops=stops, change_mps=0.0)


def _with_walks(others: Obstacles | None, walks: tuple[Walk, ...]) -> Obstacles | None:
    """Return those road users that SUMO walks or drives on from what it saved of them."""
    if others is None or len(others.ids) != len(walks):
        return None
    return some_obstacles(replace(others, walks=walks), np.array([bool(walk.saved) for walk in walks]))


def _driven(scene: SeedScene, vehicle: int, edges: tuple[str, ...], *, simulated: bool) -> SumoDriven:
    intention, model, parameters, arrival = scene.intention(vehicle), _MODEL, dict[str, str](), None
    if intention is not None:
        model, parameters = SumoDriver(OWN_MODEL).driving(scene, vehicle)
        edges = intention.edges if simulated else edges
        arrival = intention.arrival if intention.edges[-1:] == edges[-1:] else None
    return SumoDriven(
        future=0, vehicle=vehicle, model=model, parameters=parameters, edges=edges, arrival=arrival
    )


def _own_lights(net: Element) -> list[Element]:
    """Give the lights of a net their programmes in the simulation; return their saved states."""
    saved = []
    for k, light in reversed(list(enumerate(net))):
        param = light.find(f"param[@key={SIMULATED!r}]") if light.tag == "tlLogic" else None
        if param is not None:
            own = list(ElementTree.fromstring(f"<own>{param.get('value')}</own>"))
            saved += [element for element in own if not len(element)]
            net[k : k + 1] = [element for element in own if len(element)]
    prune(net)
    return saved


def _delay_lights(net: Element, time_s: float) -> None:
    """Let the lights of a net begin as they are at a time after the moment."""
    for light in net.iter("tlLogic"):
        cycle_s = sum(float(phase.get("duration", "0")) for phase in light.iter("phase"))
        if cycle_s > 0:
            light.set("offset", f"{(float(light.get('offset', '0')) - time_s) % cycle_s:.3f}")


def _name_types(root: Element, scene: SeedScene) -> None:
    """Give the road users of a saved state the names of their types in their simulation."""
    types = {kind.get("id", ""): kind for kind in root.iter("vType")}
    for user in (*root.iter("vehicle"), *root.iter("person")):
        if (here := types.get(user.get("type", ""))) is None:
            continue
        name = here.get("id", "").removeprefix(OWN_TYPE)
        if user.get("id", "") in scene.names:
            intention = scene.intention(scene.names.index(user.get("id", "")))
            saved = ElementTree.fromstring((intention and intention.saved) or "<user/>")
            name = "".join(own.get("id", "") for own in saved.iter("vType"))
        if name and not name.startswith("DEFAULT_"):
            if name not in types:
                types[name] = Element("vType", {**here.attrib, "id": name})
                root.insert(list(root).index(here), types[name])
            user.set("type", name)


def _renamed(state: Path, scene: SeedScene) -> Element:
    """Return a saved state without the prefix of its tile, with the names of the road users."""
    root = ElementTree.parse(state).getroot()
    named = dict(zip(vehicle_ids([0], scene.track_ids), scene.names, strict=True))
    if scene.obstacles is not None:
        named |= {obstacle_id(0, name): name.removesuffix("_person") for name in scene.obstacles.ids}
    for element in root.iter():
        is_list = element.tag in ("vehicle", "vehicles", "person")
        for key, value in element.attrib.items():
            words = [named.get(word, word) if is_list else word for word in value.split(" ")]
            element.set(key, " ".join(re.sub(f"^(:?){tile_prefix(0)}", r"\1", word) for word in words))
    _name_types(root, scene)
    return root
