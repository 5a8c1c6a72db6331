"""Traces of OSI that other programs wrote, and damaged ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scex_sumo.base.errors import TrackError
from scex_sumo.converters.datasets.recordings import read_recorded
from scex_sumo.converters.maps import read_map
from scex_sumo.converters.xml import net_root
from scex_sumo.formats.osi import OSI
from scex_sumo.formats.osi_lanes import lanes_of, light_states
from scex_sumo.lanelet2sumo.convert import convert

osi = pytest.importorskip("betterosi")


def moving(number: int, x: float, kind: int, vehicle: int | None = None, **base: Any) -> Any:
    classes = osi.MovingObject.VehicleClassification
    return osi.MovingObject(
        id=osi.Identifier(value=number),
        type=osi.MovingObject.Type(kind),
        base=osi.BaseMoving(
            dimension=osi.Dimension3d(length=4.0, width=2.0, height=1.5),
            position=osi.Vector3d(x=x, y=3.0, z=0.7),
            orientation=osi.Orientation3d(roll=base.get("roll", 0.0), pitch=0.0, yaw=0.5),
        ),
        vehicle_classification=None if vehicle is None else classes(type=classes.Type(vehicle)),
    )


def trace(path: Path, frames: list[list[Any]]) -> Path:
    """A bare trace of frames each 50 ms from 12 s on, as esmini writes it."""
    bodies = []
    for k, objects in enumerate(frames):
        stamp = osi.Timestamp(seconds=12 + k // 20, nanos=(k % 20) * 50_000_000)
        bodies.append(osi.GroundTruth(timestamp=stamp, moving_object=objects).to_binary())
    path.write_bytes(b"".join(len(body).to_bytes(4, "little") + body for body in bodies))
    return path


def test_types_times_and_missing_velocities_are_read(tmp_path: Path) -> None:
    kinds = [(1, 2, 4), (2, 2, 7), (3, 2, 11), (4, 3, None), (5, 4, None), (6, 2, None)]
    frames = [[moving(i, 10.0 * i + 0.5 * k, kind, vehicle) for i, kind, vehicle in kinds] for k in range(21)]
    table, notes = read_recorded([trace(tmp_path / "t.osi", frames)])
    assert dict(zip(table.vehicles.labels, table.vehicles.types, strict=True)) == {
        "1": "car",
        "2": "truck",
        "6": "car",
    }
    assert set(table.others.types) == {"bicycle", "pedestrian"}
    assert any("animal" in note for note in notes)
    assert table.vehicles.timestamp_ms.min() == 0.0
    np.testing.assert_allclose(table.vehicles.vx, 10.0, rtol=1e-6)


def lane(number: int, kind: int, line: list[tuple[float, float]], *, ahead: bool = True, **about: Any) -> Any:
    classes = osi.Lane.Classification
    sides = {f"{k}_lane_boundary_id": [osi.Identifier(value=v)] for k, v in about.get("sides", {}).items()}
    pairs = [
        classes.LanePairing(
            antecessor_lane_id=osi.Identifier(value=a), successor_lane_id=osi.Identifier(value=b)
        )
        for a, b in about.get("pairs", ())
    ]
    return osi.Lane(
        id=osi.Identifier(value=number),
        classification=classes(
            type=classes.Type(kind),
            centerline=[osi.Vector3d(x=x, y=y, z=0.0) for x, y in line],
            centerline_is_driving_direction=ahead,
            lane_pairing=pairs,
            **sides,
        ),
    )


def boundary(number: int, kind: int, line: list[tuple[float, float]]) -> Any:
    of = osi.LaneBoundary
    return of(
        id=osi.Identifier(value=number),
        classification=of.Classification(type=of.Classification.Type(kind)),
        boundary_line=[of.BoundaryPoint(position=osi.Vector3d(x=x, y=y, z=0.0)) for x, y in line],
    )


def bulb(lane: int, color: int, mode: int) -> Any:
    of = osi.TrafficLight.Classification
    about = of(color=of.Color(color), mode=of.Mode(mode), assigned_lane_id=[osi.Identifier(value=lane)])
    return osi.TrafficLight(id=osi.Identifier(value=10 * lane + color), classification=about)


def crossing(east: float = 0.0) -> list[Any]:
    """Frames of a junction as esmini writes it: one lane without a line, whose pairs are its movements.

    Lane 0 leads east to the junction, lane 2 away from it; lane 1 leads west, its points east.
    """

    def at(*places: tuple[float, float]) -> list[tuple[float, float]]:
        return [(east + x, y) for x, y in places]

    lanes = [
        lane(0, 2, at((-100, -2), (0, -2)), sides={"left": 7, "right": 8}),
        lane(1, 2, at((-100, 2), (0, 2)), ahead=False, sides={"left": 9, "right": 7}),
        lane(2, 2, at((20, -2), (120, -2)), pairs=[]),
        lane(3, 4, [], pairs=[(0, 2), (0, 1)]),
        lane(4, 3, at((-100, 9), (0, 9))),
    ]
    lines = [
        boundary(7, 3, at((-100, 0), (0, 0))),
        boundary(8, 6, at((-100, -4), (0, -4))),
        boundary(9, 6, at((-100, 4), (0, 4))),
    ]
    frames = []
    for k in range(61):
        red = 2 if k < 20 else 4
        lights = [bulb(0, color, 3 if color == red else 2) for color in (2, 3, 4)]
        stamp = osi.Timestamp(seconds=k // 20, nanos=(k % 20) * 50_000_000)
        car = moving(1, east - 90.0 + k * 0.5, 2, 4)
        car.base.position.y, car.base.orientation.yaw = -2.0, 0.0
        static = {"lane": lanes, "lane_boundary": lines} if not k else {}
        frames.append(osi.GroundTruth(timestamp=stamp, moving_object=[car], traffic_light=lights, **static))
    return frames


def written(path: Path, frames: list[Any]) -> Path:
    bodies = [frame.to_binary() for frame in frames]
    path.write_bytes(b"".join(len(body).to_bytes(4, "little") + body for body in bodies))
    return path


@pytest.fixture(params=["t.osi", "t.mcap"])
def without_map(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    file: Path = tmp_path / request.param
    if file.suffix == ".osi":
        return written(file, crossing())
    with osi.Writer(str(file), metadata={}) as writer:
        for frame in crossing():
            writer.add(frame)
    return file


def test_lanes_of_osi_are_the_map_of_a_trace_without_opendrive(without_map: Path) -> None:
    road = read_map(without_map)
    by_start = {tuple(one.centreline[0].round(1)): one for one in road.lanes.values()}
    into, back, out = by_start[-100.0, -2.0], by_start[0.0, 2.0], by_start[20.0, -2.0]
    assert len(road.lanes) == 5  # three lanes and two movements; a border is none
    np.testing.assert_allclose(back.left_bound[[0, -1]], [[0, 0], [-100, 0]])
    assert into.width_m == pytest.approx(4.0)
    ahead = {road.lanes[i].successors[0] for i in into.successors}
    assert ahead == {out.lane_id, back.lane_id}
    assert [(one.kind, one.lanes) for one in road.regulations] == [("traffic_light", (into.lane_id,))]
    assert {(one.kind, one.subtype) for one in road.markings} == {("line_thin", "solid"), ("road_border", "")}


def test_lights_of_osi_are_those_that_a_net_shows(without_map: Path, tmp_path: Path) -> None:
    net = convert(read_map(without_map), tmp_path / "n.net.xml", signals=without_map)
    (light,) = net_root(net.path).iter("tlLogic")
    phases = [(p.get("state", ""), float(p.get("duration", ""))) for p in light.iter("phase")]
    assert [set(state) for state, _ in phases[:2]] == [{"r"}, {"G"}]
    assert phases[0][1] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("bulbs", "letter"),
    [([(2, 3), (3, 3)], "u"), ([(2, 2), (3, 4)], "o"), ([(2, 2), (4, 2)], "O"), ([(4, 0)], ""),
     ([(2, 3), (4, 3)], "r")],
)  # fmt: skip
def test_bulbs_make_one_state_of_a_lane(bulbs: list[tuple[int, int]], letter: str) -> None:
    lights = [bulb(9, *b) for b in bulbs]
    before, frame = (
        osi.GroundTruth(timestamp=osi.Timestamp(seconds=k), moving_object=cars, traffic_light=lights)
        for k, cars in ((4, []), (5, [moving(1, 0.0, 2)]))
    )
    assert light_states([before, frame], lanes_of) == {9: [(0.0, letter)]}  # time begins with the tracks


def test_a_trace_names_its_map_among_several(tmp_path: Path) -> None:
    frames = crossing()
    frames[0].map_reference = "b.xodr"
    file = written(tmp_path / "t.osi", frames)
    for name in "ab":
        (tmp_path / f"{name}.xodr").write_text("<OpenDRIVE/>")
    (recording,) = OSI.recordings([file])
    assert recording.map_path.name == "b.xodr"


def test_a_message_of_a_million_objects_is_not_even_parsed(tmp_path: Path) -> None:
    file = tmp_path / "t.osi"
    with file.open("wb") as out:
        out.write((2**26).to_bytes(4, "little"))
        out.truncate(2**26 + 4)
    with pytest.raises(TrackError, match="a message of 64 MB, more than 32"):
        read_recorded([file])
