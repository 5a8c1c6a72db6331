"""Random scenes give the same values as the slow, independent evaluation, pair by pair."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from scex_sumo.base.arrays import FloatArray
from scex_sumo.evaluation.tables import PairValues, evaluate_pairs
from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.metrics.formulas.wttc import worst_time_to_collision
from tests.metrics import slow
from tests.metrics.scenes import random_run

# Closed forms and 50-digit roots: what is left is rounding.
EXACT = 1e-9

CASES = [
    {"seed": 0},
    {"seed": 1, "area": 8.0},  # overlaps
    {"seed": 2, "area": 400.0},
    {"seed": 3, "absent": 0.3},
    {"seed": 4, "absent": 0.6, "vehicles": 4},
    {"seed": 5, "vehicles": 2, "history": 30, "steps": 4},  # more than 2 s of history
    {"seed": 6, "history": 1, "absent": 0.2},
]


def scene_of(tracks: SceneTracks, future: int, step: int) -> dict[int, slow.Vehicle]:
    """Present vehicles of one step, with their acceleration."""
    states, scene = tracks.states, {}
    for vehicle in range(states.shape[2]):
        if tracks.present is not None and not tracks.present[future, step, vehicle]:
            continue
        samples = samples_of(tracks, future, vehicle, step)
        scene[vehicle] = {
            "x": states.x[future, step, vehicle],
            "y": states.y[future, step, vehicle],
            "psi": states.heading[future, step, vehicle],
            "v": states.speed[future, step, vehicle],
            "a": samples[-1][1],
            "length": tracks.length[vehicle],
            "width": tracks.width[vehicle],
        }
    return scene


def samples_of(tracks: SceneTracks, future: int, vehicle: int, until: int) -> list[tuple[int, float, float]]:
    """(step, acceleration, speed) of a track up to a step."""
    found: list[tuple[int, float, float]] = []
    for step in range(until + 1):
        if tracks.present is None or tracks.present[future, step, vehicle]:
            speed = tracks.states.speed[future, step, vehicle]
            before = found[-1] if found else None
            a = 0.0 if before is None else (speed - before[2]) / ((step - before[0]) * tracks.step_s)
            found.append((step, a, speed))
    return found


def path_of(
    tracks: SceneTracks, planned: PlannedPaths, future: int, step: int, vehicle: int
) -> list[tuple[float, float]]:
    """Present position, then the columns of the current plan that are ahead."""
    now = step - tracks.first
    plan, column = planned.index[now], planned.column[now]
    states = tracks.states
    points = [(states.x[future, step, vehicle], states.y[future, step, vehicle])]
    xs, ys = planned.x[future, plan, vehicle, column:], planned.y[future, plan, vehicle, column:]
    return points + [(a, b) for a, b in zip(xs, ys, strict=True) if np.isfinite(a)]


def rows(values: PairValues) -> dict[tuple[int, ...], float]:
    columns = [values.future, values.step, values.vehicle] + ([] if values.other is None else [values.other])
    keys = [tuple(int(i) for i in row) for row in np.stack(columns, axis=1)]
    assert len(set(keys)) == len(keys)
    return dict(zip(keys, values.value.tolist(), strict=True))


def slow_rows(
    tracks: SceneTracks, planned: PlannedPaths, metric: str
) -> Iterator[tuple[tuple[int, ...], float]]:
    for future in range(tracks.states.shape[0]):
        for step in range(tracks.first, tracks.states.shape[1]):
            scene = scene_of(tracks, future, step)
            for i, a in scene.items():
                for j, b in scene.items():
                    if i != j:
                        value = pair_value(tracks, planned, metric, future, step, (i, j), (a, b))
                        if value is not None:
                            yield (future, step, i, j), value


def pair_value(
    tracks: SceneTracks,
    planned: PlannedPaths,
    metric: str,
    future: int,
    step: int,
    pair: tuple[int, int],
    vehicles: tuple[slow.Vehicle, slow.Vehicle],
) -> float | None:
    a, b = vehicles
    if metric == "distance":
        return math.dist((a["x"], a["y"]), (b["x"], b["y"]))
    if metric == "gap_time":
        paths = [path_of(tracks, planned, future, step, vehicle) for vehicle in pair]
        return slow.gap_time(*paths, a["v"], b["v"])
    evaluation = {"ttc": slow.ttc, "pttc": slow.pttc, "wttc": slow.wttc}[metric]
    return evaluation(a, b)


@pytest.mark.parametrize("case", CASES, ids=str)
@pytest.mark.parametrize("metric", ["distance", "ttc", "pttc", "wttc", "gap_time"])
def test_every_ordered_pair_is_evaluated_as_defined(metric: str, case: dict[str, float]) -> None:
    options = dict(case)
    tracks, planned = random_run(np.random.default_rng(int(options.pop("seed"))), **options)  # type: ignore[arg-type]
    got = rows(evaluate_pairs(tracks, planned, metrics=(metric,))[metric])
    expected = dict(slow_rows(tracks, planned, metric))
    assert got.keys() == expected.keys()
    for key, value in expected.items():
        assert got[key] == pytest.approx(value, rel=EXACT, abs=EXACT), key


@pytest.mark.parametrize("case", CASES, ids=str)
def test_traffic_quality_of_every_vehicle_is_as_defined(case: dict[str, float]) -> None:
    options = dict(case)
    tracks, planned = random_run(np.random.default_rng(int(options.pop("seed"))), **options)  # type: ignore[arg-type]
    got = rows(evaluate_pairs(tracks, planned, metrics=("tq",))["tq"])
    expected = {}
    for future in range(tracks.states.shape[0]):
        for step in range(tracks.first, tracks.states.shape[1]):
            scene = scene_of(tracks, future, step)
            if len(scene) < 2:
                continue
            windows = []
            for vehicle in scene:
                last = [s for s in samples_of(tracks, future, vehicle, step) if s[0] >= step - 20]
                windows.append(([s[1] for s in last], [s[2] for s in last]))
            for vehicle, value in zip(scene, slow.tq(list(scene.values()), windows), strict=True):
                expected[(future, step, vehicle)] = value
    assert got.keys() == expected.keys()
    for key, value in expected.items():
        assert got[key] == pytest.approx(value, rel=EXACT), key


def test_recordings_cross_the_track_that_was_driven() -> None:
    tracks, _ = random_run(np.random.default_rng(8), vehicles=9, steps=30, area=25.0, absent=0.1)
    planned = PlannedPaths.from_tracks(tracks)
    got = rows(evaluate_pairs(tracks, planned, metrics=("gap_time",))["gap_time"])
    expected = dict(slow_rows(tracks, planned, "gap_time"))
    assert len(expected) > 30
    assert got.keys() == expected.keys()
    for key, value in expected.items():
        # Crossings of nearly parallel steps of a few centimetres: the point is known to about 1e-9 m.
        assert got[key] == pytest.approx(value, rel=1e-7, abs=1e-7), key


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_wttc_is_the_smallest_root_at_every_scale(scale: float) -> None:
    rng = np.random.default_rng(11)
    count = 120
    # Distances of 0.1 mm to 100 km, speeds of 0 to 50 km/s at the largest scale: all cases of the quartic.
    d = 10 ** rng.uniform(-1, 2, count) * scale
    v = 10 ** rng.uniform(-1, 1.7, count) * scale * (rng.random(count) > 0.1)
    bearing, course = rng.uniform(-np.pi, np.pi, (2, count))
    aimed = rng.random(count) < 0.5  # half of them fly past each other closely
    course = np.where(aimed, bearing + np.pi + rng.normal(0, 0.1, count), course)
    size = rng.uniform(0, 5, count) * min(scale, 1.0)
    time = worst_time_to_collision(
        dx=d * np.cos(bearing),
        dy=d * np.sin(bearing),
        dvx=v * np.cos(course),
        dvy=v * np.sin(course),
        radius=2 * np.hypot(size / 2, size / 5),
        acceleration=np.full(count, 13.8),
    )
    for index in range(count):
        still = {"x": 0.0, "y": 0.0, "psi": 0.0, "v": 0.0, "length": size[index], "width": size[index] * 0.4}
        other = {
            **still,
            "x": d[index] * math.cos(bearing[index]),
            "y": d[index] * math.sin(bearing[index]),
            "psi": course[index],
            "v": v[index],
        }
        assert time[index] == pytest.approx(slow.wttc(still, other), rel=EXACT), index


@pytest.mark.parametrize("speed", [30.0, 45.0, 60.0, 90.0])
@pytest.mark.parametrize("off", [-1e-3, -1e-6, -1e-8, 1e-8, 1e-6, 1e-3])
def test_wttc_where_two_roots_are_about_to_vanish(speed: float, off: float) -> None:
    """Passing by at an offset where the discs just touch or just miss: the answer jumps there."""

    def times_at(offsets: FloatArray) -> FloatArray:
        arrays = (np.full(offsets.shape, value) for value in (60.0, -speed, 0.0, 4.8, 13.8))
        names = ("dx", "dvx", "dvy", "radius", "acceleration")
        return worst_time_to_collision(dy=offsets, **dict(zip(names, arrays, strict=True)))

    def time(offset: float) -> float:
        return float(times_at(np.array([offset]))[0])

    offsets = np.linspace(0, 60, 3000)
    times = times_at(offsets)
    jump = int(np.argmax(np.diff(times)))
    low, high, middle = offsets[jump], offsets[jump + 1], times[jump : jump + 2].mean()
    for _ in range(60):
        centre = (low + high) / 2
        low, high = (centre, high) if time(centre) < middle else (low, centre)
    offset = low * (1 + off)
    length = 4.8 / math.hypot(1, 0.4)  # both half diagonals together make the radius
    still = {"x": 0.0, "y": 0.0, "psi": 0.0, "v": 0.0, "length": length, "width": 0.4 * length}
    passing = {**still, "x": 60.0, "y": offset, "psi": math.pi, "v": speed}
    # Two roots this close know half as many digits.
    assert time(offset) == pytest.approx(slow.wttc(still, passing), rel=EXACT)
