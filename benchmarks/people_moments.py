"""Moments of recordings with people and vehicles: VCI-DUT, INTERACTION's OF, TAF-BW.

The first 60 % of each clip are for a fit, the next 20 % for choices, the last 20 % for tests. The site
``roundabout`` of DUT, and OF, are for tests only.
"""

from __future__ import annotations

import csv
import gzip
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from response_samples import DUT_HZ

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene, States

STEPS = 30  # of the recorded future
LEFT_OUT = ("DUT roundabout", "OF")
SIZES = {"car": (4.5, 1.8), "pedestrian": (0.5, 0.5), "bicycle": (1.8, 0.6)}


@dataclass(frozen=True, kw_only=True)
class Clip:
    """Tracks on a grid of 0.1 s, (N, T), NaN where a road user is absent."""

    name: str
    kinds: tuple[str, ...]
    states: States


def clips(data: Path) -> Iterator[tuple[str, Clip]]:
    """Yield the name of the data set and each clip."""
    for file in sorted((data / "dut").glob("*_ped.csv.gz")):
        rows = [(r, "pedestrian") for r in _rows(file)]
        rows += [(r, "car") for r in _rows(Path(str(file).replace("_ped", "_veh")))]
        name = file.name.removesuffix("_ped.csv.gz")
        user = [f"{kind}{r['id']}" for r, kind in rows]
        time, x, y = np.array([[int(r["frame"]) / DUT_HZ, r["x_est"], r["y_est"]] for r, _ in rows], float).T
        yield f"DUT {name.split('_')[0]}", _gridded(name, user, [k for _, k in rows], time, x, y, warm_s=1.0)
    for name, folder, pattern in (
        ("OF", "interaction/recorded_trackfiles/DR_DEU_Roundabout_OF", "*.csv.gz"),
        ("TAF-BW", "taf_bw/recorded_trackfiles/k733_2020-09-15", "vehicle_tracks_*.csv"),
        ("TAF-BW", "taf_bw/recorded_trackfiles/k729_2022-03-16", "vehicle_tracks_*.csv"),
    ):
        groups = [[f] for f in sorted((data / folder).glob(pattern))]
        for files in groups if name != "OF" else [[f for g in groups for f in g]]:
            table = [r for f in files for r in _rows(f)]
            time, x, y = np.array([[int(r["timestamp_ms"]) / 1e3, r["x"], r["y"]] for r in table], float).T
            kinds = [_kind(r["agent_type"].lower()) for r in table]
            yield name, _gridded(files[0].stem, [r["track_id"] for r in table], kinds, time, x, y, warm_s=0.5)


def _rows(file: Path) -> list[dict[str, str]]:
    with gzip.open(file, "rt") if file.suffix == ".gz" else file.open() as stream:
        return list(csv.DictReader(stream))


def _kind(word: str) -> str:
    return "pedestrian/bicycle" if "/" in word else {"bike": "bicycle", "pedestrian": word}.get(word, "car")


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
        kind = kinds[rows[0]]
        if "/" in kind:
            way = np.hypot(np.diff(x[rows]), np.diff(y[rows])).sum() / max(np.ptp(time[rows]), 0.1)
            kind = "bicycle" if way > 3.0 else "pedestrian"
        types.append(kind)
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
    """A seed scene with its recorded future, and the people that are there for all of it."""

    data: str
    part: str
    scene: SeedScene
    people: FloatArray


def moments(data: Path, every_s: float, part: str | None = None) -> list[Moment]:
    """Return the moments of all clips, or of a part of them: train, choice or test."""
    found = []
    for name, clip in clips(data):
        steps = clip.states.x.shape[1]
        for now in range(HISTORY_STEPS + 1, steps - STEPS, round(every_s / STEP_S)):
            share = now / steps
            own = "train" if share < 0.6 else "choice" if share < 0.8 else "test"
            if name in LEFT_OUT:
                own = "test"
            moment = _moment(name, own, clip, now) if part in (None, own) else None
            if moment is not None:
                found.append(moment)
    return found


def _moment(name: str, part: str, clip: Clip, now: int) -> Moment | None:
    window = clip.states[:, now - HISTORY_STEPS : now + STEPS + 1]
    known = np.isfinite(window.x) & np.isfinite(window.speed)
    walks = np.array([kind != "car" for kind in clip.kinds])
    rows = np.flatnonzero((known.all(axis=1) & walks) | (known[:, HISTORY_STEPS] & ~walks))
    people = walks[rows]
    if not people.any() or people.all():
        return None
    window, known = _filled(window[rows], known[rows]), known[rows]
    sizes = np.array([SIZES[clip.kinds[k]] for k in rows])
    scene = SeedScene(
        name=clip.name,
        location=name,
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
    return Moment(data=name, part=part, scene=scene, people=np.flatnonzero(people))


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
