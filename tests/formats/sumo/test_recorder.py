"""Recorder of a long simulation, by one that only counts: each vehicle is there for two steps."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

from scex_sumo.formats.sumo.recorder import Recorder


class Simulation:
    def __init__(self) -> None:
        self.steps = 0
        self.simulation = SimpleNamespace(
            getOption={"default.carfollowmodel": "Krauss", "lateral-resolution": "-1"}.get,
            getTime=lambda: 0.1 * self.steps,
            getPendingVehicles=lambda: (),
        )
        self.trafficlight = SimpleNamespace(getIDList=lambda: (), getAllProgramLogics=lambda light: ())
        self.person = SimpleNamespace(getIDList=lambda: ())
        self.vehicle = SimpleNamespace(
            getIDList=lambda: (f"v{self.steps - 1}", f"v{self.steps}"),
            getPosition=lambda name: (float(self.steps), 0.0),
            getSpeed=lambda name: 10.0,
            getAngle=lambda name: 90.0,
            getStopState=lambda name: 0,
            getVehicleClass=lambda name: "passenger",
            getLength=lambda name: 5.0,
            getWidth=lambda name: 1.8,
            getTeleportingIDList=lambda: (),
        )


def users(keep_s: float | None) -> tuple[Any, set[str]]:
    simulation = Simulation()
    recorder = Recorder(simulation, keep_s=keep_s)
    for _ in range(500):
        simulation.steps += 1
        recorder.take()
    return recorder.recorded, {name for _, names, _ in recorder.recorded.frames for name in names}


def test_vehicles_that_have_left_are_let_go_and_those_in_kept_frames_are_not() -> None:
    recorded, there = users(keep_s=1.0)
    assert there <= recorded.users.keys() and len(recorded.users) < 130
    table, _ = recorded.tracks(Path("g.net.xml"))
    assert len(table.vehicles) == sum(len(names) for _, names, _ in recorded.frames)
