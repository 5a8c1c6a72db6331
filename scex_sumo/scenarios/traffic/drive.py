"""Traffic driven by SUMO: random trips over a net, recorded step by step."""

from __future__ import annotations

import csv
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray
from scex_sumo.errors import SimulationError
from scex_sumo.files import TemporaryFolder
from scex_sumo.programs import environment, program
from scex_sumo.scenarios.traffic.demand import Network, Trip, random_trips, write_curve_limits, write_trips
from scex_sumo.scenarios.traffic.kinematics import body_states
from scex_sumo.scene import HISTORY_STEPS, STEP_S, States

LANE_CHANGE_S = 4.0
TELEPORT_S = 20.0
MAX_DELAY_S = 15.0
JUMP_M = 0.5  # further than driven in one step: SUMO moved the vehicle by other means


@dataclass(frozen=True, kw_only=True, eq=False)
class Drive:
    """Everything that drove in one SUMO run.

    Attributes:
        trips: (K,) the vehicles.
        present: (T, K) on the map at the step.
        front: (T, K, 2) front bumper, m; NaN where not present.
        angle: (T, K) SUMO's heading as ours, rad.
        speed: (T, K) SUMO's speed, m/s.
    """

    trips: list[Trip]
    present: BoolArray
    front: FloatArray
    angle: FloatArray
    speed: FloatArray

    @cached_property
    def driven(self) -> BoolArray:
        """(T, K) present, and at its place by nothing but driving."""
        moved = np.hypot(*np.moveaxis(np.diff(self.front, axis=0), -1, 0))
        fine = self.present.copy()
        fine[1:] &= ~(moved > self.speed[1:] * STEP_S + JUMP_M)
        return fine

    def steady(self) -> BoolArray:
        """(T, K) driven for the last 10 steps and present before them."""
        fine = self.driven
        ready = fine.copy()
        for back in range(1, HISTORY_STEPS):
            ready[back:] &= fine[:-back]
        ready[HISTORY_STEPS:] &= self.present[:-HISTORY_STEPS]
        ready[:HISTORY_STEPS] = False
        return ready

    def drive(self, vehicle: int, step: int) -> tuple[int, States]:
        """The uninterrupted drive of a vehicle that a step lies in: its first step, and its states."""
        broken = np.flatnonzero(~self.driven[:, vehicle])
        first = int(broken[broken < step].max(initial=-1))
        if first < 0 or not self.present[first, vehicle]:
            first += 1  # else the vehicle was moved to where it is at that step
        end = int(broken[broken > step].min(initial=len(self.present)))
        front, angle = self.front[first:end, vehicle], float(self.angle[first, vehicle])
        return first, body_states(front, angle, self.trips[vehicle].length_m)


def record(
    net_path: Path,
    *,
    at_most: int,
    duration_s: float,
    every_s: tuple[float, float],
    rng: np.random.Generator,
    also: Sequence[Trip] = (),
) -> Drive:
    """Let SUMO drive random traffic over a net.

    Args:
        net_path: the net.
        at_most: vehicles on the map at any time; others wait outside.
        duration_s: simulated time.
        every_s: mean time between vehicles on a lane into the map, at the beginning and at the end.
        rng: where the randomness comes from.
        also: vehicles besides the random ones.

    Raises:
        SimulationError: SUMO refused the net.
    """
    trips = random_trips(Network(net_path), until_s=duration_s, every_s=every_s, rng=rng)
    trips = sorted([*trips, *also], key=lambda trip: trip.depart_s)
    with TemporaryFolder() as folder:
        net, routes, fcd = (Path(folder) / name for name in ("map.net.xml", "traffic.rou.xml", "fcd.csv"))
        write_curve_limits(net_path, net)
        write_trips(routes, trips)
        _simulate(net, routes, fcd, at_most=at_most, duration_s=duration_s, seed=int(rng.integers(2**31)))
        return _read(fcd, trips, round(duration_s / STEP_S) + 1)


def _simulate(net: Path, routes: Path, fcd: Path, *, at_most: int, duration_s: float, seed: int) -> None:
    options = {
        "net-file": net,
        "route-files": routes,
        "fcd-output": fcd,
        "fcd-output.attributes": "x,y,angle,speed",
        "precision": 6,
        "begin": 0,
        "end": duration_s,
        "step-length": STEP_S,
        "seed": seed,
        "max-num-vehicles": at_most,
        "max-depart-delay": MAX_DELAY_S,
        "lanechange.duration": LANE_CHANGE_S,
        "time-to-teleport": TELEPORT_S,
        "time-to-teleport.remove": "true",
        "collision.action": "none",
        "xml-validation": "never",
        "no-step-log": "true",
        "no-warnings": "true",
    }
    command = [
        program("sumo"),
        *(word for key, value in options.items() for word in (f"--{key}", str(value))),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment())
    if done.returncode:
        said = [line for line in done.stderr.splitlines() if line.startswith("Error")]
        raise SimulationError(f"{net.name}: SUMO cannot populate it ({said[0] if said else done.returncode})")


def _read(fcd: Path, trips: list[Trip], steps: int) -> Drive:
    front = np.full((steps, len(trips), 2), np.nan)
    angle = np.full((steps, len(trips)), np.nan)
    speed = np.full((steps, len(trips)), np.nan)
    with fcd.open(newline="") as file:
        for row in csv.DictReader(file, delimiter=";"):
            if not row["vehicle_id"]:
                continue  # nothing drives at this step
            at = round(float(row["timestep_time"]) / STEP_S), int(row["vehicle_id"])
            front[at] = float(row["vehicle_x"]), float(row["vehicle_y"])
            # SUMO angles: 0 = north, clockwise, degrees; ours: 0 = east, counter-clockwise.
            angle[at] = np.pi / 2 - np.radians(float(row["vehicle_angle"]))
            speed[at] = float(row["vehicle_speed"])
    return Drive(trips=trips, present=~np.isnan(speed), front=front, angle=angle, speed=speed)
