"""Futures as ASAM OSI ground truth: omega-prime (``.mcap``, the map inside), or a bare trace (``.osi``)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.files import TemporaryFolder, write_atomic
from scex_sumo.base.version import __version__
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.exporters.light_cycles import LightCycle, light_cycles
from scex_sumo.exporters.opendrive.file import opendrive_text, projection_text
from scex_sumo.exporters.request import Participant, Request
from scex_sumo.formats.osi import osi_library
from scex_sumo.roads.matching import match
from scex_sumo.scene import LOGGED_HISTORY, STEP_S, States

_NANOS = 10**9
_TYPES = {"car": 4, "truck": 7, "bus": 12, "motorcycle": 10, "bicycle": 11}
"""OSI's type of vehicle by our road user; other vehicles are cars."""
_CIVIL, _PUBLIC = 2, 6
_VEHICLE, _PEDESTRIAN = 2, 3
_REAR_AXLE = 0.2  # of the length, from the rear end
_RED, _YELLOW, _GREEN = 2, 3, 4
_COLORS = {"G": _GREEN, "g": _GREEN, "s": _GREEN, "y": _YELLOW, "Y": _YELLOW, "r": _RED, "R": _RED, "u": _RED}
_OFF, _CONSTANT = 2, 3
_LIGHT_HEIGHT_M = 4.0


def write_omega_prime(request: Request) -> list[Path]:
    """Write each future as an MCAP file with its map as OpenDRIVE, as omega-prime reads it."""
    betterosi, files = osi_library(), request.files(".mcap")
    area = betterosi.MapAsamOpenDrive(
        map_reference=request.road.name, open_drive_xml_content=opendrive_text(request.road)
    )
    for future, path in zip(request.futures, files, strict=True):
        with TemporaryFolder() as folder:
            trace = Path(folder, "trace.mcap")
            about = {"creation_time": "1970-01-01T00:00:00Z", "description": request.file_stem(future)}
            with betterosi.Writer(str(trace), metadata=about) as writer:
                writer.add_metadata("scex-sumo", _about(request, future))
                writer.add(area, topic="ground_truth_map", log_time=0)
                for truth in _ground_truths(request, future, betterosi):
                    writer.add(truth, log_time=_time_ns(truth))
            write_atomic(path, trace.read_bytes())
    return files


def write_osi(request: Request) -> list[Path]:
    """Write each future as a bare trace, and the map as OpenDRIVE beside."""
    betterosi, files = osi_library(), request.files(".osi")
    for future, path in zip(request.futures, files, strict=True):
        bodies = (truth.to_binary() for truth in _ground_truths(request, future, betterosi))
        write_atomic(path, b"".join(len(body).to_bytes(4, "little") + body for body in bodies))
    area = files[0].with_name(f"{request.road.name}.xodr")
    write_atomic(area, opendrive_text(request.road).encode())
    return [*files, area]


def _about(request: Request, future: int) -> dict[str, str]:
    """Return the seed scene, number and drivers of a future, as text."""
    models = zip(request.scene.track_ids.tolist(), request.run.models_of(future), strict=True)
    numbers = {"future": str(future), "history_frames": str(LOGGED_HISTORY)}
    drivers = {f"model of {track}": model for track, model in models}
    return {"version": __version__, "seed_scene": request.name, **numbers, **drivers}


def _time_ns(truth: Any) -> int:
    return int(truth.timestamp.seconds * _NANOS + truth.timestamp.nanos)


def _ground_truths(request: Request, future: int, betterosi: Any) -> Iterator[Any]:
    """Yield the frames of a future, the first logged one at time 0."""
    users = list(request.participants(future))
    numbers = _numbers(users)
    lanes = [_lanes(request, one.states) for one in users]
    acceleration = [np.gradient(one.states.speed, STEP_S) for one in users]
    lights, steps = light_cycles(request.run.net), request.run.states(future).shape[1]
    ego = None if request.ego is None else betterosi.Identifier(value=request.ego)
    for step in range(steps):
        nanos = round(step * STEP_S * _NANOS)
        yield betterosi.GroundTruth(
            version=betterosi.InterfaceVersion(version_major=3, version_minor=8, version_patch=0),
            timestamp=betterosi.Timestamp(seconds=nanos // _NANOS, nanos=nanos % _NANOS),
            host_vehicle_id=ego,
            map_reference=request.road.name,
            proj_string=projection_text(request.road.origin) if request.road.origin != (0.0, 0.0) else "",
            moving_object=[
                _moving(one, number, step, float(a[step]), lane[step], betterosi)
                for one, number, a, lane in zip(users, numbers, acceleration, lanes, strict=True)
                if one.present[step]
            ],
            traffic_light=_lights(request, lights, step - LOGGED_HISTORY + 1, betterosi),
        )


def _numbers(users: list[Participant]) -> list[int]:
    """Return an id of each road user: vehicles keep theirs, others follow."""
    taken = {int(one.label) for one in users if one.vehicle is not None}
    free = max(taken, default=0)
    numbers = []
    for one in users:
        if one.vehicle is None:
            free += 1
        numbers.append(free if one.vehicle is None else int(one.label))
    return numbers


def _lanes(request: Request, states: States) -> list[list[int]]:
    """Return the lanes of the map on which a road user is, at each step."""
    found = match(request.road, states.x, states.y, states.heading)
    lanes: list[list[int]] = [[] for _ in range(len(states.x))]
    for step, lane in zip(found.vehicle.tolist(), found.lane_id.tolist(), strict=True):
        lanes[step].append(lane)
    return lanes


def _moving(
    one: Participant, number: int, step: int, acceleration: float, lanes: list[int], betterosi: Any
) -> Any:
    user, states = road_user(one.kind), one.states
    ahead: FloatArray = np.array([np.cos(states.heading[step]), np.sin(states.heading[step])])
    height = one.height
    (vx, vy), (ax, ay) = float(states.speed[step]) * ahead, acceleration * ahead
    moving = betterosi.MovingObject
    details: dict[str, Any] = {"type": moving.Type(_PEDESTRIAN)}
    if user != "pedestrian":
        classes = moving.VehicleClassification
        role = classes.Role(_PUBLIC if user == "bus" else _CIVIL)
        rear = betterosi.Vector3d(x=-(0.5 - _REAR_AXLE) * one.length, y=0.0, z=-height / 2)
        details = {
            "type": moving.Type(_VEHICLE),
            "vehicle_classification": classes(type=classes.Type(_TYPES.get(user, _TYPES["car"])), role=role),
            "vehicle_attributes": moving.VehicleAttributes(bbcenter_to_rear=rear),
        }
    place = float(states.x[step]), float(states.y[step])
    return moving(
        id=betterosi.Identifier(value=number),
        base=betterosi.BaseMoving(
            dimension=betterosi.Dimension3d(length=one.length, width=one.width, height=height),
            position=betterosi.Vector3d(x=place[0], y=place[1], z=height / 2),
            orientation=betterosi.Orientation3d(roll=0.0, pitch=0.0, yaw=float(states.heading[step])),
            velocity=betterosi.Vector3d(x=float(vx), y=float(vy), z=0.0),
            acceleration=betterosi.Vector3d(x=float(ax), y=float(ay), z=0.0),
        ),
        moving_object_classification=moving.MovingObjectClassification(
            assigned_lane_id=[betterosi.Identifier(value=lane) for lane in lanes]
        ),
        **details,
    )


def _lights(
    request: Request, cycles: Mapping[int, Mapping[LightCycle, str]], step: int, betterosi: Any
) -> list[Any]:
    """Return the lights of lanes at a step after the seed scene, each over the end of its lane."""
    lights, light = [], betterosi.TrafficLight
    for lane_id, of_lane in sorted(cycles.items()):
        lane = request.road.lanes.get(lane_id)
        if lane is None:
            continue
        x, y = lane.centreline[-1].tolist()
        for turn, (cycle, _) in enumerate(of_lane.items()):
            letter = cycle.at(step)
            color = light.Classification.Color(_COLORS.get(letter, 0))
            mode = light.Classification.Mode(_CONSTANT if letter in _COLORS else _OFF)
            lights.append(
                light(
                    id=betterosi.Identifier(value=lane_id * 10 + turn),
                    base=betterosi.BaseStationary(
                        position=betterosi.Vector3d(x=x, y=y, z=_LIGHT_HEIGHT_M),
                        dimension=betterosi.Dimension3d(length=0.3, width=0.3, height=0.9),
                        orientation=betterosi.Orientation3d(roll=0.0, pitch=0.0, yaw=0.0),
                    ),
                    classification=light.Classification(
                        color=color, mode=mode, assigned_lane_id=[betterosi.Identifier(value=lane_id)]
                    ),
                )
            )
    return lights
