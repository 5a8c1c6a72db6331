"""Moments of recordings with people and vehicles, and what each is for: a fit, or a test.

INTERACTION's OF, TAF-BW, Argoverse 2 and nuScenes (ScenarioNet) are read as a run reads them, with their
maps. VCI-DUT has no map. Every third of its clips, every third file of k729 and the last third of k733 are
for tests; OF, Argoverse 2, nuScenes and DUT's site ``roundabout`` are for tests alone.
"""

from __future__ import annotations

import csv
import gzip
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from response_samples import DUT_HZ

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import TrackError
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.evaluation.recordings import load_recording, recording_moments, seed_at
from scex_sumo.results.participants import with_people
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene, States

STEPS = 30  # of the recorded future
SETS = {
    "OF": "interaction/recorded_trackfiles/DR_DEU_Roundabout_OF",
    "TAF-BW": "taf_bw",
    "Argoverse 2": "av2",
    "nuScenes": "scenarionet",
}
FITTED_SETS = ("DUT intersection", "TAF-BW")
SIZES = {"car": (4.5, 1.8), "pedestrian": (0.5, 0.5)}
GAP_S = 4.0  # between moments for a fit and those for a test, of one file


@dataclass(frozen=True, kw_only=True)
class Clip:
    """Tracks on a grid of 0.1 s, (N, T), NaN where a road user is absent."""

    name: str
    kinds: tuple[str, ...]
    states: States


def clips(data: Path) -> Iterator[Clip]:
    """Yield the clips of VCI-DUT."""
    for file in sorted((data / "dut").glob("*_ped.csv.gz")):
        rows = [(r, "pedestrian") for r in _rows(file)]
        rows += [(r, "car") for r in _rows(Path(str(file).replace("_ped", "_veh")))]
        user = [f"{kind}{r['id']}" for r, kind in rows]
        time, x, y = np.array([[int(r["frame"]) / DUT_HZ, r["x_est"], r["y_est"]] for r, _ in rows], float).T
        name = file.name.removesuffix("_ped.csv.gz")
        yield _gridded(name, user, [k for _, k in rows], time, x, y, warm_s=1.0)


def _rows(file: Path) -> list[dict[str, str]]:
    with gzip.open(file, "rt") if file.suffix == ".gz" else file.open() as stream:
        return list(csv.DictReader(stream))


def _gridded(
    name: str,
    user: list[str],
    kinds: list[str],
    time: FloatArray,
    x: FloatArray,
    y: FloatArray,
    warm_s: float,
) -> Clip:
    start = time.min()
    steps = int((time.max() - start) / STEP_S) + 1
    grid, names = start + STEP_S * np.arange(steps), list(dict.fromkeys(user))
    where = np.array(user)
    out, types = np.full((2, len(names), steps), np.nan), []
    for k, one in enumerate(names):
        rows = np.flatnonzero(where == one)
        rows = rows[np.argsort(time[rows], kind="stable")]
        there = (grid >= time[rows[0]] + warm_s) & (grid <= time[rows[-1]])
        out[0, k, there] = np.interp(grid[there], time[rows], x[rows])
        out[1, k, there] = np.interp(grid[there], time[rows], y[rows])
        types.append(kinds[rows[0]])
    vx, vy = (np.diff(values, axis=1, prepend=np.nan) / STEP_S for values in out)
    speed = np.hypot(vx, vy)
    heading = _held(np.where(speed > 0.3, np.arctan2(vy, vx), np.nan))
    return Clip(
        name=name, kinds=tuple(types), states=States(x=out[0], y=out[1], heading=heading, speed=speed)
    )


def _held(heading: FloatArray) -> FloatArray:
    """Hold the last heading of those that stand, before that the first one."""
    for values in (heading, heading[:, ::-1]):
        for step in range(1, values.shape[1]):
            values[:, step] = np.where(np.isnan(values[:, step]), values[:, step - 1], values[:, step])
    return np.nan_to_num(heading)


@dataclass(frozen=True, kw_only=True)
class Moment:
    """A seed scene with its recorded future, and the people (P,) that are there for all of it."""

    data: str
    clip: str
    part: str
    scene: SeedScene
    people: IntArray


def moments(data: Path, every_s: float, part: str | None = None) -> list[Moment]:
    """Return the moments of all recordings, or of a part of them: train or test."""
    found = [*_of_dut(data, every_s, part), *_of_readers(data, every_s, part)]
    return [moment for moment in found if len(moment.people)]


def _of_dut(data: Path, every_s: float, asked: str | None) -> Iterator[Moment]:
    for clip in clips(data):
        site, number = clip.name.split("_")
        part = "train" if site == "intersection" and int(number) % 3 else "test"
        if asked not in (None, part):
            continue
        for now in range(HISTORY_STEPS + 1, clip.states.x.shape[1] - STEPS, round(every_s / STEP_S)):
            scene = _scene(clip, now)
            if scene is not None and scene.people is not None:
                people = np.flatnonzero(scene.people)
                yield Moment(data=f"DUT {site}", clip=clip.name, part=part, scene=scene, people=people)


def _of_readers(data: Path, every_s: float, asked: str | None) -> Iterator[Moment]:
    for name, folder in SETS.items():
        if asked == "train" and name not in FITTED_SETS:
            continue
        for number, recording in enumerate(find_recordings([data / folder])):
            loaded = load_recording(recording)
            every = recording_moments(loaded, every_s=every_s)
            for moment in every:
                share = (moment.time_s - every[0].time_s) / max(every[-1].time_s - every[0].time_s, 1.0)
                part = "test"
                if name in FITTED_SETS and "k729" in recording.name:
                    part = "test" if number % 3 == 2 else "train"
                elif name in FITTED_SETS and share < 2 / 3:
                    late = (2 / 3 - share) * (every[-1].time_s - every[0].time_s) < GAP_S
                    part = "none" if late else "train"
                if asked not in (None, part):
                    continue
                try:
                    scene = with_people(seed_at(loaded, moment.time_s), "model")
                except TrackError:  # nobody has been recorded for long enough
                    continue
                clip = f"{recording.name}_{int(6 * share) if 'k733' in recording.name else ''}"
                if (shown := _shown(scene)) is not None:
                    yield Moment(data=name, clip=clip, part=part, scene=scene, people=shown)


def _shown(scene: SeedScene) -> IntArray | None:
    """Return the people that are there for the whole second before and 3 s after; None without any."""
    if scene.people is None or scene.people.all() or scene.future is None or scene.future_valid is None:
        return None
    if scene.future.shape[1] < STEPS:
        return None
    known = scene.future_valid[:, :STEPS].all(axis=1) & (scene.recorded_steps >= HISTORY_STEPS)
    return np.flatnonzero(scene.people & known)


def _scene(clip: Clip, now: int) -> SeedScene | None:
    window = clip.states[:, now - HISTORY_STEPS : now + STEPS + 1]
    known = np.isfinite(window.x) & np.isfinite(window.speed)
    walks = np.array([kind != "car" for kind in clip.kinds])
    rows = np.flatnonzero((known.all(axis=1) & walks) | (known[:, HISTORY_STEPS] & ~walks))
    people = walks[rows]
    if not people.any() or people.all():
        return None
    window, known = _filled(window[rows], known[rows]), known[rows]
    sizes = np.array([SIZES[clip.kinds[k]] for k in rows])
    return SeedScene(
        name=clip.name,
        location=clip.name,
        time_s=now * STEP_S,
        track_ids=rows,
        types=tuple(clip.kinds[k] for k in rows),
        length=sizes[:, 0],
        width=sizes[:, 1],
        history=window[:, : HISTORY_STEPS + 1],
        recorded_steps=np.full(len(rows), HISTORY_STEPS),
        future=window[:, HISTORY_STEPS + 1 :],
        future_valid=known[:, HISTORY_STEPS + 1 :],
        people=people,
    )


def _filled(window: States, known: BoolArray) -> States:
    """Continue vehicles that come or leave at constant velocity."""
    step = np.arange(known.shape[1])
    first = known.argmax(axis=1)
    last = known.shape[1] - 1 - known[:, ::-1].argmax(axis=1)
    at = np.clip(step, first[:, None], last[:, None])
    row, beyond = np.arange(len(at))[:, None], step - at
    held = window[row, at]
    way = held.speed * STEP_S * beyond
    return replace(held, x=held.x + way * np.cos(held.heading), y=held.y + way * np.sin(held.heading))
