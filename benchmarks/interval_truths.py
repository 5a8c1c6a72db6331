"""Truths for `benchmarks/intervals.py`: every assignment of small seed scenes, run once and kept."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, zip_longest
from pathlib import Path

import numpy as np

import scex_sumo
from scex_sumo.arrays import FloatArray
from scex_sumo.behaviors.registry import DEFAULT_MODELS
from scex_sumo.errors import ScexError
from scex_sumo.metrics.base import SceneTracks
from scex_sumo.scenarios.reduction import choose_vehicles, reduced
from scex_sumo.scene import LOGGED_HISTORY, SeedScene, States

VEHICLES = 5
LEVELS = len(DEFAULT_MODELS.split(","))
EXAMPLES = ("roundabout", "motorway_merge", "urban_intersection")


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth:
    """All assignments of one scene.

    Attributes:
        name: of the scene.
        columns: names of the metrics.
        values: (N, M), NaN where undefined, ordered as all assignments are.
        tracks: what the vehicles did.
    """

    name: str
    columns: tuple[str, ...]
    values: FloatArray
    tracks: SceneTracks


def scenes() -> Iterator[tuple[str, SeedScene]]:
    """Seed scenes of five vehicles: drawn traffic on the examples, recorded traffic where it is."""
    root = Path(os.environ.get("SCEX_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
    for drawn, seen in zip_longest(_drawn(), _recorded(root)):
        yield from (entry for entry in (drawn, seen) if entry is not None)


def _drawn() -> Iterator[tuple[str, SeedScene]]:
    for seed in range(6):
        for name in EXAMPLES:
            whole = scex_sumo.synthetic_seed(scex_sumo.example_path(name), vehicles=8 + seed, seed=seed)
            yield f"{name}_{seed}", reduced(whole, choose_vehicles(whole, VEHICLES))


def _recorded(root: Path) -> Iterator[tuple[str, SeedScene]]:
    folders = [f for f in (root / "taf_bw", root / "mona", root / "ngsim") if f.is_dir()]
    for folder in folders:
        found = scex_sumo.find_recordings([folder])
        for number, recording in enumerate(found[:: max(len(found) // 4, 1)]):
            loaded = scex_sumo.load_recording(recording)
            times = [m.time_s for m in scex_sumo.recording_moments(loaded, every_s=5.0)]
            for time_s in islice(times[2 :: max(len(times) // 3, 1)], 2):
                try:
                    whole = scex_sumo.seed_at(loaded, time_s)
                    scene = reduced(whole, choose_vehicles(whole, VEHICLES))
                except ScexError:  # too few vehicles at this moment
                    continue
                yield f"{folder.name}_{number}_{time_s:g}", scene


def truths(cache: Path, wanted: int) -> list[Truth]:
    """Truths from the cache, or run now."""
    cache.mkdir(parents=True, exist_ok=True)
    kept = _kept(cache)
    if len(kept) < wanted:
        for name, scene in scenes():
            file = cache / f"{name}.npz"
            if not file.exists():
                _run(scene, file)
            kept = _kept(cache)
            if len(kept) >= wanted:
                break
    return [_read(file) for file in kept[:wanted]]


def _kept(cache: Path) -> list[Path]:
    return sorted(file for file in cache.glob("*.npz") if not file.stem.endswith(".part"))


def _run(scene: SeedScene, file: Path) -> None:
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        try:
            run = scex_sumo.extrapolate(
                scene, models=DEFAULT_MODELS, children="all", metrics=["paper"], out=Path(folder) / "out"
            )
        except ScexError as error:
            print(f"{file.stem}: left out: {error}", flush=True)
            return
        values = np.stack([run.metrics[c].to_numpy(zero_copy_only=False) for c in run.columns], axis=1)
        shape = (run.children, VEHICLES, LOGGED_HISTORY + int(run.info["steps"]))
        x, y, vx, vy, heading = (
            np.asarray(run.tracks[name]).reshape(shape).swapaxes(1, 2)
            for name in ("x", "y", "vx", "vy", "psi_rad")
        )
        np.savez(
            file.with_suffix(".part.npz"),
            values=values,
            columns=np.array(run.columns),
            states=np.stack([x, y, heading, np.hypot(vx, vy)]),
            size=np.stack([scene.length, scene.width]),
        )
    file.with_suffix(".part.npz").rename(file)
    print(f"{file.stem}: {len(values)} runs in {time.perf_counter() - started:.0f} s", flush=True)


def _read(file: Path) -> Truth:
    with np.load(file) as data:
        x, y, heading, speed = data["states"]
        tracks = SceneTracks(
            states=States(x=x, y=y, heading=heading, speed=speed),
            length=data["size"][0],
            width=data["size"][1],
            first=LOGGED_HISTORY,
        )
        columns = tuple(str(c) for c in data["columns"])
        return Truth(name=file.stem, columns=columns, values=data["values"], tracks=tracks)
