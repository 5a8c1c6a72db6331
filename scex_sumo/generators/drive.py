"""Recording of random traffic that SUMO drives, and the motion of its vehicles as tracks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import SimulationError
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.base.sumo.programs import run_program
from scex_sumo.generators.demand import Network, Trip, random_trips, write_curve_limits, write_trips
from scex_sumo.geometry.polylines import arc_lengths
from scex_sumo.roads.conflicts import runs
from scex_sumo.scene import HISTORY_STEPS, STEP_S, States

LANE_CHANGE_S = 4.0
TELEPORT_S = 20.0
LIMIT_S = 600.0  # of SUMO's time
MIN_ORIGINS = 60
MAX_DELAY_S = 15.0
JUMP_M = 0.5  # beyond the driven way: SUMO moved the vehicle


@dataclass(frozen=True, kw_only=True, eq=False)
class Drive:
    """Vehicles of a SUMO run.

    Attributes:
        number: (K,) index among all trips, ascending.
        trips: (K,) vehicles that entered the map.
        present: (T, K).
        front: (T, K, 2) front bumper, m; NaN where absent.
        angle: (T, K) SUMO's heading as ours, rad.
        speed: (T, K) SUMO's speed, m/s.
    """

    number: IntArray
    trips: list[Trip]
    present: BoolArray
    front: FloatArray
    angle: FloatArray
    speed: FloatArray

    @cached_property
    def driven(self) -> BoolArray:
        """Whether a vehicle came to its place by driving, (T, K)."""
        moved = np.hypot(*np.moveaxis(np.diff(self.front, axis=0), -1, 0))
        fine = self.present.copy()
        fine[1:] &= ~(moved > self.speed[1:] * STEP_S + JUMP_M)
        return fine

    def steady(self) -> BoolArray:
        """Return whether a vehicle drove for the last 10 steps and was present before, (T, K)."""
        fine = self.driven
        ready = fine.copy()
        for back in range(1, HISTORY_STEPS):
            ready[back:] &= fine[:-back]
        ready[HISTORY_STEPS:] &= self.present[:-HISTORY_STEPS]
        ready[:HISTORY_STEPS] = False
        return ready

    @cached_property
    def drives(self) -> tuple[IntArray, States]:
        """(T, K) numbers of vehicles' uninterrupted drives, -1 without one; (T, K) states, NaN elsewhere."""
        ranges = []
        for vehicle, driven in enumerate(self.driven.T):
            for first, last in runs(driven):
                jumped = first > 0 and self.present[first - 1, vehicle]
                ranges.append((vehicle, first - 1 if jumped else first, last + 1))
        states = body_states(
            [self.front[first:end, vehicle] for vehicle, first, end in ranges],
            [self.angle[first, vehicle] for vehicle, first, _ in ranges],
            [self.trips[vehicle].length_m for vehicle, _, _ in ranges],
        )
        stretch = np.full(self.present.shape, -1)
        columns = {name: np.full(self.present.shape, np.nan) for name in ("x", "y", "heading", "speed")}
        for number, ((vehicle, first, end), driven) in enumerate(zip(ranges, states, strict=True)):
            stretch[first:end, vehicle] = number
            for name, column in columns.items():
                column[first:end, vehicle] = getattr(driven, name)
        return stretch, States(**columns)


def record(
    net_path: Path,
    *,
    at_most: int,
    duration_s: float,
    every_s: tuple[float, float],
    rng: np.random.Generator,
    also: Sequence[Trip] = (),
    tick: Callable[[float, int], None] = lambda time_s, vehicle_steps: None,
) -> Drive:
    """Record random traffic that SUMO drives over a net.

    Args:
        at_most: vehicles on the map at any time; others wait outside.
        every_s: as of `random_trips`.
        tick: called often with the simulated time in s and the vehicles of all steps together; may raise.
    """
    most = max(MIN_ORIGINS, at_most // 2)
    trips = random_trips(Network(net_path), until_s=duration_s, every_s=every_s, rng=rng, most_origins=most)
    trips = sorted([*trips, *also], key=lambda trip: trip.depart_s)
    with TemporaryFolder() as folder:
        net, routes, fcd = (Path(folder) / name for name in ("map.net.xml", "traffic.rou.xml", "fcd.csv"))
        write_curve_limits(net_path, net)
        write_trips(routes, trips)
        options = {"end": duration_s, "seed": int(rng.integers(2**31)), "max-num-vehicles": at_most}
        _simulate(Path(folder), {"net-file": net, "route-files": routes, "fcd-output": fcd} | options, tick)
        return _read(fcd, trips, round(duration_s / STEP_S) + 1)


def _simulate(folder: Path, options: dict[str, Any], tick: Callable[[float, int], None]) -> None:
    options |= {
        "fcd-output.attributes": "x,y,angle,speed",
        "precision": 6,
        "begin": 0,
        "step-length": STEP_S,
        "max-depart-delay": MAX_DELAY_S,
        "lanechange.duration": LANE_CHANGE_S,
        "time-to-teleport": TELEPORT_S,
        "time-to-teleport.remove": "true",
        "collision.action": "none",
        "xml-validation": "never",
        "no-step-log": "true",
        "no-warnings": "true",
    }
    net, written = options["net-file"], _written(options["fcd-output"])
    words = [word for key, value in options.items() for word in (f"--{key}", str(value))]
    complaints = run_program(
        "sumo",
        *words,
        folder=folder,
        file_bytes=net.stat().st_size,
        limit_s=LIMIT_S,
        on_wait=lambda: tick(*next(written)),
    )
    if errors := [line for line in complaints if line.startswith("Error")]:
        raise SimulationError(f"{net.name}: SUMO cannot populate it: {errors[0]}")


def _written(fcd: Path) -> Iterator[tuple[float, int]]:
    """Yield the time in s and the number of lines with vehicles that SUMO has written so far."""
    fcd.touch()
    time_s, rows, unfinished = 0.0, 0, b""
    with fcd.open("rb") as file:
        while True:
            *lines, unfinished = (unfinished + file.read()).split(b"\n")
            rows += sum(b";;" not in line for line in lines)
            with suppress(ValueError, IndexError):  # no line yet, or the names of the columns
                time_s = float(lines[-1].split(b";")[0])
            yield time_s, rows


def _read(fcd: Path, trips: list[Trip], steps: int) -> Drive:
    with fcd.open(encoding="utf-8") as file:
        names = file.readline().strip().split(";")
        rows = [line for line in file if ";;" not in line]  # steps without vehicles
    wanted = ("timestep_time", "vehicle_id", "vehicle_x", "vehicle_y", "vehicle_angle", "vehicle_speed")
    columns = [names.index(name) for name in wanted]
    values = np.loadtxt(rows, delimiter=";", usecols=columns, ndmin=2) if rows else np.empty((0, 6))
    step = np.rint(values[:, 0] / STEP_S).astype(np.int64)
    number, vehicle = np.unique(values[:, 1].astype(np.int64), return_inverse=True)
    front = np.full((steps, len(number), 2), np.nan)
    angle, speed = np.full(front.shape[:2], np.nan), np.full(front.shape[:2], np.nan)
    front[step, vehicle] = values[:, 2:4]
    # SUMO: degrees clockwise from north; ours: counter-clockwise from east.
    angle[step, vehicle] = np.pi / 2 - np.radians(values[:, 4])
    speed[step, vehicle] = values[:, 5]
    entered, present = [trips[i] for i in number], ~np.isnan(speed)
    return Drive(number=number, trips=entered, present=present, front=front, angle=angle, speed=speed)


REAR_AXLE_SHARE = 0.8  # behind the front bumper, in lengths
SUBSTEPS = 4
EVEN_STEPS = 3  # on either side
PATH_STEP_M, PATH_STEPS = 0.25, 8  # 2 m on either side


def body_states(
    fronts: Sequence[FloatArray], headings: Sequence[float], lengths_m: Sequence[float]
) -> list[States]:
    """Return (T,) states of vehicles whose front bumper follows a path (T, 2), m; T differs between them.

    The rear axle follows a tractrix of the front, from headings at the first step, rad. SUMO puts both
    bumpers on the lane, which jumps at kinks and lane changes. The first speed repeats the second.
    """
    fronts = [_even(front) for front in fronts]
    steps = max(map(len, fronts), default=0)
    # Vehicles with shorter paths stand at the end of theirs.
    path = np.stack([np.pad(front, ((0, steps - len(front)), (0, 0)), "edge") for front in fronts], axis=1)
    angles = np.empty(path.shape[:2])
    angles[0] = headings
    lever = REAR_AXLE_SHARE * np.array(lengths_m)[:, None]
    rear = path[0] - lever * np.column_stack([np.cos(angles[0]), np.sin(angles[0])])
    for k in range(1, steps):
        for substep in range(1, SUBSTEPS + 1):
            lead = path[k - 1] + (path[k] - path[k - 1]) * substep / SUBSTEPS
            axis = lead - rear
            rear = lead - lever * axis / np.hypot(axis[:, 0], axis[:, 1])[:, None]
        angles[k] = np.arctan2(lead[:, 1] - rear[:, 1], lead[:, 0] - rear[:, 0])
    states = []
    for front, angle, length_m in zip(fronts, angles.T, lengths_m, strict=True):
        heading = angle[: len(front)].copy()
        centre = front - length_m / 2 * np.column_stack([np.cos(heading), np.sin(heading)])
        states.append(States(x=centre[:, 0], y=centre[:, 1], heading=heading, speed=_speeds(centre, heading)))
    return states


def _even(front: FloatArray) -> FloatArray:
    """Smooth a drive over the map's kinks, by less than a tracker does."""
    s = arc_lengths(front)
    moving = np.concatenate([[True], np.diff(s) > 0])
    if moving.sum() < 2:
        return front
    even = _averaged(s, EVEN_STEPS)
    fine = np.linspace(0.0, s[-1], max(2, int(np.ceil(s[-1] / PATH_STEP_M)) + 1))
    smooth = (_averaged(np.interp(fine, s[moving], column), PATH_STEPS) for column in front[moving].T)
    return np.column_stack([np.interp(even, fine, column) for column in smooth])


def _averaged(values: FloatArray, reach: int) -> FloatArray:
    ends = np.arange(1, reach + 1)
    before = values[0] - ends[::-1] * (values[1] - values[0])
    after = values[-1] + ends * (values[-1] - values[-2])
    weights = np.hanning(2 * reach + 3)[1:-1]
    mean = np.convolve(np.concatenate([before, values, after]), weights / weights.sum(), mode="valid")
    mean[[0, -1]] = values[[0, -1]]
    return np.asarray(mean)


def _speeds(centre: FloatArray, headings: FloatArray) -> FloatArray:
    if len(centre) < 2:
        return np.zeros(len(centre))
    step = np.diff(centre, axis=0)
    middle = np.unwrap(headings)
    middle = (middle[1:] + middle[:-1]) / 2
    along = (step[:, 0] * np.cos(middle) + step[:, 1] * np.sin(middle)) / STEP_S
    return np.asarray(np.maximum(np.concatenate([along[:1], along]), 0.0))
