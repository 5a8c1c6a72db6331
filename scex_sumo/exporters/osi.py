"""Futures as ASAM OSI ground truth: omega-prime (``.mcap``, the map inside), or a bare trace (``.osi``)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.base.version import __version__
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.exporters.light_cycles import LightCycle, light_cycles
from scex_sumo.exporters.opendrive.file import OpenDrive, opendrive_of
from scex_sumo.exporters.opendrive.rules import SIGNAL_HEIGHT_M
from scex_sumo.exporters.osi_map import reference, static_map
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


def write_omega_prime(request: Request) -> list[Path]:
    """Write each future as an MCAP file with its map as OpenDRIVE, as omega-prime reads it."""
    betterosi, files, drawn = osi_library(), request.files(".mcap"), opendrive_of(request)
    area = betterosi.MapAsamOpenDrive(map_reference=request.road.name, open_drive_xml_content=drawn.text)
    for future, path in zip(request.futures, files, strict=True):
        with TemporaryFolder() as folder:
            trace = Path(folder, "trace.mcap")
            about = {"creation_time": "1970-01-01T00:00:00Z", "description": request.file_stem(future)}
            with betterosi.Writer(str(trace), metadata=about) as writer:
                writer.add_metadata("scex-sumo", _about(request, future))
                writer.add(area, topic="ground_truth_map", log_time=0)
                for truth in _ground_truths(request, future, drawn, betterosi):
                    time = truth.timestamp
                    writer.add(truth, log_time=int(time.seconds * _NANOS + time.nanos))
            request.write(path, trace.read_bytes())
    return files


def write_osi(request: Request) -> list[Path]:
    """Write each future as a bare trace, and the map as OpenDRIVE beside."""
    betterosi, files, drawn = osi_library(), request.files(".osi"), opendrive_of(request)
    for future, path in zip(request.futures, files, strict=True):
        bodies = (truth.to_binary() for truth in _ground_truths(request, future, drawn, betterosi))
        request.write(path, b"".join(len(body).to_bytes(4, "little") + body for body in bodies))
    area = files[0].with_name(f"{request.road.name}.xodr")
    request.write(area, drawn.text.encode())
    return [*files, area]


def _about(request: Request, future: int) -> dict[str, str]:
    models = zip(request.scene.track_ids.tolist(), request.models_of(future), strict=True)
    numbers = {"future": str(future), "history_frames": str(LOGGED_HISTORY)}
    drivers = {f"model of {track}": model for track, model in models}
    return {"version": __version__, "seed_scene": request.name, **numbers, **drivers}


def _ground_truths(request: Request, future: int, drawn: OpenDrive, betterosi: Any) -> Iterator[Any]:
    """Yield the frames of a future, the first logged one at time 0; that one has the lanes, too."""
    users, lanes = list(request.participants(future)), request.road.lanes
    own, numbers, free = _numbers(users, lanes)
    there = [[[numbers[i] for i in ids] for ids in _lanes(request, user.states)] for user in users]
    acceleration = [np.gradient(user.states.speed, STEP_S) for user in users]
    static = static_map(request.road, drawn, numbers, free, betterosi)
    lights = _lights(request, drawn, numbers, free)
    frame = {"map_reference": request.road.name, **_frame(drawn, betterosi)}
    if request.ego is not None:
        frame["host_vehicle_id"] = betterosi.Identifier(value=request.ego)
    for step in range(request.states(future).shape[1]):
        nanos = round(step * STEP_S * _NANOS)
        yield betterosi.GroundTruth(
            version=betterosi.InterfaceVersion(version_major=3, version_minor=8, version_patch=0),
            timestamp=betterosi.Timestamp(seconds=nanos // _NANOS, nanos=nanos % _NANOS),
            moving_object=[
                _moving(user, number, step, float(a[step]), lane[step], betterosi)
                for user, number, a, lane in zip(users, own, acceleration, there, strict=True)
                if user.present[step]
            ],
            traffic_light=[_shown(light, step - LOGGED_HISTORY + 1, betterosi) for light in lights],
            **frame,
            **(static if step == 0 else {}),
        )


def _frame(drawn: OpenDrive, betterosi: Any) -> dict[str, Any]:
    """Return the place of the coordinates on Earth, as far as the map has it."""
    if not drawn.projection:
        return {}
    x, y, z, heading = drawn.offset
    offset = betterosi.GroundTruth.ProjFrameOffset(position=betterosi.Vector3d(x=x, y=y, z=z), yaw=heading)
    return {"proj_string": drawn.projection, "proj_frame_offset": offset}


def _numbers(
    users: list[Participant], lanes: Mapping[int, Any]
) -> tuple[list[int], dict[int, int], Iterator[int]]:
    """Return numbers of road users, of lanes, and free ones; vehicles keep theirs, and lanes if free."""
    known = [int(participant.label) if participant.vehicle is not None else -1 for participant in users]
    people = count(max(known, default=0) + 1)
    own = [next(people) if number < 0 else number for number in known]
    taken, free = set(own), count(max((*own, *lanes), default=0) + 1)
    kept = {i: i if i > 0 and i not in taken else next(free) for i in lanes}
    return own, kept, free


def _lanes(request: Request, states: States) -> list[list[int]]:
    """Return the lanes of the map on which a road user is, at each step."""
    matches = match(request.road, states.x, states.y, states.heading)
    lanes: list[list[int]] = [[] for _ in range(len(states.x))]
    for step, lane in zip(matches.vehicle.tolist(), matches.lane_id.tolist(), strict=True):
        lanes[step].append(lane)
    return lanes


def _moving(
    participant: Participant, number: int, step: int, acceleration: float, lanes: list[int], betterosi: Any
) -> Any:
    user, states = road_user(participant.kind), participant.states
    ahead: FloatArray = np.array([np.cos(states.heading[step]), np.sin(states.heading[step])])
    height = participant.height
    (vx, vy), (ax, ay) = float(states.speed[step]) * ahead, acceleration * ahead
    moving = betterosi.MovingObject
    details: dict[str, Any] = {"type": moving.Type(_PEDESTRIAN)}
    if user != "pedestrian":
        classes = moving.VehicleClassification
        role = classes.Role(_PUBLIC if user == "bus" else _CIVIL)
        rear = betterosi.Vector3d(x=-(0.5 - _REAR_AXLE) * participant.length, y=0.0, z=-height / 2)
        details = {
            "type": moving.Type(_VEHICLE),
            "vehicle_classification": classes(type=classes.Type(_TYPES.get(user, _TYPES["car"])), role=role),
            "vehicle_attributes": moving.VehicleAttributes(bbcenter_to_rear=rear),
        }
    place = float(states.x[step]), float(states.y[step])
    return moving(
        id=betterosi.Identifier(value=number),
        base=betterosi.BaseMoving(
            dimension=betterosi.Dimension3d(
                length=participant.length, width=participant.width, height=height
            ),
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


@dataclass(frozen=True, kw_only=True)
class _Light:
    number: int
    lane: int
    place: tuple[float, float]
    signal: str
    cycle: LightCycle


def _lights(
    request: Request, drawn: OpenDrive, numbers: Mapping[int, int], free: Iterator[int]
) -> list[_Light]:
    """Return the lights of lanes, each at its signal in the map, else over the end of its lane."""
    lanes, lights = request.road.lanes, []
    for i, cycles in sorted(light_cycles(request.run.net).items()):
        if i not in lanes:
            continue
        options = (drawn.lights[j] for j in (i, *lanes[i].predecessors) if j in drawn.lights)
        signal, place = next(options, ("", None))
        x, y = (lanes[i].centreline[-1] if place is None else place).tolist()
        lights += [
            _Light(number=next(free), lane=numbers[i], place=(x, y), signal=signal, cycle=cycle)
            for cycle in cycles
        ]
    return lights


def _shown(light: _Light, step: int, betterosi: Any) -> Any:
    kind, (x, y), letter = betterosi.TrafficLight, light.place, light.cycle.at(step)
    about = kind.Classification
    return kind(
        id=betterosi.Identifier(value=light.number),
        base=betterosi.BaseStationary(
            position=betterosi.Vector3d(x=x, y=y, z=SIGNAL_HEIGHT_M),
            dimension=betterosi.Dimension3d(length=0.3, width=0.3, height=0.9),
            orientation=betterosi.Orientation3d(roll=0.0, pitch=0.0, yaw=0.0),
        ),
        classification=about(
            color=about.Color(_COLORS.get(letter, 0)),
            mode=about.Mode(_CONSTANT if letter in _COLORS else _OFF),
            assigned_lane_id=[betterosi.Identifier(value=light.lane)],
        ),
        source_reference=reference([light.signal], betterosi) if light.signal else [],
    )
