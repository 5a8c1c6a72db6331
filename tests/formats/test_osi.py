"""Traces of OSI that other programs wrote, and damaged ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scex_sumo.base.errors import MapError, TrackError
from scex_sumo.converters.datasets.reader import read_recorded
from scex_sumo.converters.maps import read_map

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


def test_a_box_that_does_not_lie_on_a_road_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TrackError, match=r"tilted by 1\.0 rad"):
        read_recorded([trace(tmp_path / "t.osi", [[moving(1, 0.0, 2, roll=1.0)]])])


def test_a_trace_without_a_map_says_where_it_must_be(tmp_path: Path) -> None:
    file = trace(tmp_path / "t.osi", [[moving(1, 0.0, 2)]])
    with pytest.raises(MapError, match=r"no \.xodr is beside it"):
        read_map(file)


@pytest.mark.parametrize(
    "content", [b"", b"hello\n", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n\x01\xff\xff\xff\xff\xff\xff\xff\xff"]
)
def test_a_damaged_omega_prime_file_is_one_line(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "bad.mcap"
    file.write_bytes(content)
    for error, read in ((MapError, lambda: read_map(file)), (TrackError, lambda: read_recorded([file]))):
        with pytest.raises(error, match="trace of OSI") as caught:
            read()
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("keep", [2, 30])
def test_a_cut_trace_is_one_line(tmp_path: Path, keep: int) -> None:
    file = trace(tmp_path / "t.osi", [[moving(1, 0.0, 2)]])
    file.write_bytes(file.read_bytes()[:keep])
    with pytest.raises(TrackError, match="ends within a record"):
        read_recorded([file])
