"""SUMO folder: net, vehicle types, routes and a state from which SUMO continues a future."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from scex_sumo.base.errors import UsageError
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.behaviors.models.sumo_driver import SumoDriver
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.exporters.request import Request
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene
from scex_sumo.world.sumo import SumoDriven, SumoWorld

_MODEL = "EIDM"
_END_S = 60
_BLOCKED_S = 5  # after which others pass a vehicle that stands in a junction: futures can end in a deadlock

_CONFIGURATION = """<configuration>
    <net-file value="tiles.net.xml"/>
    <load-state value="state.xml"/>
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

`sumo-gui -c future.sumocfg` begins with the last step of this future. SUMO's {model} drives all vehicles,
on the routes that `sumo:` drivers take in a run. Vehicle `t0_17` is track 17. {left}
"""


def write_sumo(request: Request) -> list[Path]:
    """Write a folder for each future, in which SUMO continues from its last step."""
    files = []
    for future in request.futures:
        folder = request.folder if len(request.futures) == 1 else request.folder / f"future{future:04d}"
        files.append(_write_future(request, future, folder))
    return files


def _write_future(request: Request, future: int, folder: Path) -> Path:
    scene = _at_the_end(request, future)
    routes = SumoDriver(_MODEL).routes(
        scene, request.road, np.arange(scene.vehicles), np.zeros(scene.vehicles)
    )
    edges = [tuple(request.run.net.lanes.edges(route)) for route in routes]
    walks = np.array([road_user(kind) == "pedestrian" for kind in scene.types])
    kept = [v for v, route in enumerate(edges) if route and not walks[v]]
    if not kept:
        raise UsageError(f"future {future}: no vehicle is on a mapped lane at its end; choose another one")
    left_out = [str(scene.track_ids[v]) for v in range(scene.vehicles) if v not in kept]
    scene = scene.reordered(kept, name=scene.name)
    driven = [
        SumoDriven(future=0, vehicle=n, model=_MODEL, parameters={}, edges=edges[v])
        for n, v in enumerate(kept)
    ]
    with SumoWorld(request.run.net, scene, slots=[0]) as world, TemporaryFolder() as temporary:
        world.begin(scene.now.repeat(1), np.zeros(1, dtype=np.int64), driven)
        world.save(Path(temporary))
        for file in sorted(Path(temporary).glob("*.xml")):
            request.write(folder / file.name, file.read_bytes())
    left = f"Off the lanes or on foot, and left out: {', '.join(left_out)}." if left_out else ""
    text = _README.format(future=future, name=request.name, model=_MODEL, left=left)
    request.write(folder / "README.md", text.encode())
    configuration = _CONFIGURATION.format(step=STEP_S, end=_END_S, blocked=_BLOCKED_S)
    request.write(folder / "future.sumocfg", configuration.encode())
    return folder / "future.sumocfg"


def _at_the_end(request: Request, future: int) -> SeedScene:
    states = request.run.states(future)[:, -HISTORY_STEPS - 1 :]
    return replace(request.scene, history=states, future=None, future_valid=None, obstacles=None)
