"""OpenSCENARIO XML: a scenario for each future, with the road as OpenDRIVE.

The reference point of a vehicle is the middle of its rear axle.
"""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import UsageError
from scex_sumo.base.importing import extra_for
from scex_sumo.converters.tracks.road_users import PEOPLE, road_user
from scex_sumo.exporters.opendrive.file import opendrive_of
from scex_sumo.exporters.request import Participant, Request
from scex_sumo.scene import LOGGED_HISTORY, STEP_S, States

SPEEDS = "speeds_mps"  # property of an entity: those at its vertices
_DELAY = "{}_delay"  # parameter of a vehicle
_WHEELBASE = 0.58  # of the length, around the centre
_KINDS = {  # OpenSCENARIO's category, height in m, mass in kg
    "motorcycle": ("motorbike", 1.5, 250.0),
    "bicycle": ("bicycle", 1.7, 90.0),
    "bus": ("bus", 3.2, 12000.0),
    "truck": ("truck", 3.5, 12000.0),
    "van": ("van", 2.2, 2500.0),
    "tram": ("tram", 3.5, 40000.0),
    "car": ("car", 1.5, 1500.0),
}
_WALKER = (1.75, 80.0)  # height in m, mass in kg
_MAX_MPS, _MAX_MPS2 = 80.0, 12.0


def write_openscenario(request: Request) -> list[Path]:
    """Write the road, and a scenario of version 1.2 for each future.

    With an ego time 0 is the seed scene, and the ego has its start and its goal, but no trajectory. The
    trajectories of the pair that leads can be delayed by parameters: their times count from the event's
    start, because players disagree on what scale and offset of a timing do.
    """
    return _write(request, minor=2)


def write_openscenario_1_3(request: Request) -> list[Path]:
    """Write what `write_openscenario` writes, in version 1.3."""
    return _write(request, minor=3)


def _write(request: Request, *, minor: int) -> list[Path]:
    with extra_for("OpenSCENARIO needs scenariogeneration", "formats"):
        from scenariogeneration import xosc
    road = request.folder / f"{request.road.name}.xodr"
    drawn = opendrive_of(request)
    request.write(road, drawn.text.encode())
    files = [road]
    for future in request.futures:
        file = request.folder / f"{request.file_stem(future)}.xosc"
        request.write(file, _scenario_text(xosc, request, future, road.name, drawn.flat, minor).encode())
        files.append(file)
    return files


def axle_offset(kind: str, length: float) -> float:
    """Return the distance of the rear axle behind the centre, m; 0 for pedestrians."""
    return 0.0 if _walks(kind) else round(_WHEELBASE * length / 2, 4)


def _leading_pair(request: Request) -> tuple[int, ...]:
    """Return the track ids whose trajectories have parameters: the pair asked for, else the first one."""
    first = request.run.encounters.slice(0, 1)
    pair = request.encounter or first["track_id"].to_pylist() + first["other_id"].to_pylist()
    return tuple(track for track in pair if track != request.ego)


def _scenario_text(xosc: Any, request: Request, future: int, road_file: str, flat: bool, minor: int) -> str:
    entities, init, varied = xosc.Entities(), xosc.Init(), xosc.ParameterDeclarations()
    begin, pair = 0 if request.ego is None else LOGGED_HISTORY - 1, _leading_pair(request)
    models, steps, last = request.models_of(future), request.states(future).shape[1] - begin, 0.0
    act = xosc.Act("act", _at(xosc, "act starts", 0.0))
    at_once = xosc.TransitionDynamics(xosc.DynamicsShapes.step, xosc.DynamicsDimension.time, 0)
    for participant in request.participants(future):
        name = f"{_role(participant)}{participant.name}"
        model = "recorded" if participant.vehicle is None else models[participant.vehicle]
        entity, states = _entity(xosc, participant, model), participant.states[begin:]
        entities.add_scenario_object(name, entity)
        there = np.flatnonzero(participant.present[begin:])  # straight lines bridge gaps in a track
        entity.add_property(SPEEDS, " ".join(f"{speed:.4f}" for speed in states.speed[there]))
        if not len(there):
            continue
        places = _vertices(xosc, participant, states[there], level=0.0 if flat else None)
        times = STEP_S * there.astype(np.float64)
        last = max(last, float(times[-1]))
        init.add_init_action(name, xosc.TeleportAction(places[0]))
        varies = participant.label in pair and not there[0]
        speed = 0.0 if varies else round(float(states.speed[there[0]]), 6)
        init.add_init_action(name, xosc.AbsoluteSpeedAction(speed, at_once))
        if participant.label == request.ego:
            init.add_init_action(name, xosc.AcquirePositionAction(places[-1]))
            continue
        begins: float | str = float(times[0])
        if varies:
            begins = f"${_DELAY.format(name)}"
            delay = xosc.Parameter(_DELAY.format(name), xosc.ParameterType.double, "0")
            varied.add_parameter(delay)
        leaves = int(there[-1]) + 1 < steps
        act.add_maneuver_group(_follow(xosc, name, times, places, begins, ends=leaves))
    if not act.maneuvergroup:
        raise UsageError(f"--ego {request.ego}: nobody else is there; leave it out")
    story = xosc.Story("future")
    story.add_act(act)
    board = xosc.StoryBoard(init, _at(xosc, "end", last, point="stop"))
    board.add_story(story)
    scenario = xosc.Scenario(
        request.file_stem(future),
        "scex-sumo",
        varied,
        entities,
        board,
        xosc.RoadNetwork(roadfile=road_file),
        xosc.Catalog(),
        osc_minor_version=minor,
        creation_date=_written(request.run.folder / "run.json"),
    )
    root = scenario.get_element()
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _written(file: Path) -> datetime:
    moment = datetime.fromtimestamp(int(file.stat().st_mtime), tz=timezone.utc)
    return moment.replace(tzinfo=None)


def _role(participant: Participant) -> str:
    user = road_user(participant.kind)
    if participant.vehicle is None:
        return "other"
    return user if user in PEOPLE else "vehicle"


def _walks(kind: str) -> bool:
    return road_user(kind) == "pedestrian"


def _entity(xosc: Any, participant: Participant, model: str) -> Any:
    kind, length, width = participant.kind, participant.length, participant.width
    ahead = axle_offset(kind, length)
    if _walks(kind):
        height, mass = _WALKER
        box = xosc.BoundingBox(width, length, height, 0.0, 0.0, height / 2)
        entity = xosc.Pedestrian(kind, mass, xosc.PedestrianCategory.pedestrian, box)
    else:
        category, height, mass = _KINDS[road_user(kind)]
        box = xosc.BoundingBox(width, length, height, ahead, 0.0, height / 2)
        wheel = round(min(0.65, 0.3 * height), 3)
        front, rear = (
            xosc.Axle(steer, wheel, round(0.85 * width, 3), round(x, 4), wheel / 2)
            for steer, x in ((0.6, 2 * ahead), (0.0, 0.0))
        )
        entity = xosc.Vehicle(
            f"{category}_{length:g}x{width:g}",
            xosc.VehicleCategory[category],
            box,
            front,
            rear,
            _MAX_MPS,
            _MAX_MPS2,
            _MAX_MPS2,
            mass=mass,
        )
    entity.add_property("model", model)
    return entity


def _vertices(xosc: Any, participant: Participant, states: States, *, level: float | None) -> list[Any]:
    """Return the places of a road user; without a level players put it on the road."""
    back = axle_offset(participant.kind, participant.length)
    heading = np.unwrap(states.heading)
    x = states.x - back * np.cos(heading)
    y = states.y - back * np.sin(heading)
    rows = zip(x.tolist(), y.tolist(), heading.tolist(), strict=True)
    return [
        xosc.WorldPosition(round(a, 6), round(b, 6), level, round(h, 8), level, level) for a, b, h in rows
    ]


def _follow(
    xosc: Any, name: str, times: FloatArray, places: list[Any], begins: float | str, *, ends: bool
) -> Any:
    maneuver = xosc.Maneuver(f"{name} moves")
    if len(places) > 1:
        line = xosc.Trajectory(f"{name} trajectory", False)
        line.add_shape(xosc.Polyline([round(t, 6) for t in times.tolist()], places))
        domain = xosc.ReferenceContext[("absolute", "relative")[isinstance(begins, str)]]
        action = xosc.FollowTrajectoryAction(line, xosc.FollowingMode.position, domain, 1, 0)
        event = xosc.Event(f"{name} follows", xosc.Priority.override)
        event.add_trigger(_at(xosc, f"{name} starts", begins))
        event.add_action(f"{name} follows trajectory", action)
        maneuver.add_event(event)
    if ends:
        event = xosc.Event(f"{name} leaves", xosc.Priority.parallel)
        event.add_trigger(_at(xosc, f"{name} is gone", float(times[-1])))
        event.add_action(f"{name} is deleted", xosc.DeleteEntityAction(name))
        maneuver.add_event(event)
    group = xosc.ManeuverGroup(f"{name} group")
    group.add_actor(name)
    group.add_maneuver(maneuver)
    return group


def _at(xosc: Any, name: str, time_s: float | str, *, point: str = "start") -> Any:
    value = time_s if isinstance(time_s, str) else round(time_s, 6)
    condition = xosc.SimulationTimeCondition(value, xosc.Rule.greaterOrEqual)
    return xosc.ValueTrigger(name, 0, xosc.ConditionEdge.none, condition, point)
