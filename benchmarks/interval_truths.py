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
from paper import choose_vehicles, reduced

import scex_sumo
from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.errors import ScexError
from scex_sumo.drivers.registry import DEFAULT_MODELS
from scex_sumo.results.design import is_critical
from scex_sumo.scene import SeedScene

VEHICLES = 5
LEVELS = len(DEFAULT_MODELS.split(","))
EXAMPLES = ("roundabout", "motorway_merge", "urban_intersection")
SETS = ("chosen", "fresh")
"""Scenes that the estimator was chosen on, and others that nothing was chosen on."""

_PAIRS = ("collision", "critical")
_Named = Iterator[tuple[str, SeedScene]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth:
    """All assignments of one scene, ordered as all assignments are.

    Attributes:
        name: of the scene.
        columns: names of the metrics.
        values: (N, M), NaN where undefined.
        questions: names of what is yes or no in a future; those of a pair of vehicles once for each pair.
        answers: (N, Q) the answers.
    """

    name: str
    columns: tuple[str, ...]
    values: FloatArray
    questions: tuple[str, ...]
    answers: BoolArray


def scenes(which: str) -> _Named:
    """Seed scenes of five vehicles: drawn traffic on the examples, recorded traffic where it is.

    Args:
        which: of the sets. The fresh ones are other draws, more of them with more traffic, and other
            recordings and moments.
    """
    root = Path(os.environ.get("SCEX_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
    fresh = which == "fresh"
    for drawn, seen in zip_longest(_drawn(fresh), _fresh(root) if fresh else _recorded(root)):
        yield from (entry for entry in (drawn, seen) if entry is not None)


def _drawn(fresh: bool) -> _Named:
    for seed in range(100, 104) if fresh else range(6):
        for name in EXAMPLES:
            count = 12 + 2 * (seed - 100) if fresh else 8 + seed
            whole = scex_sumo.synthetic_seed(scex_sumo.example_path(name), vehicles=count, seed=seed)
            yield f"{name}_{seed}", reduced(whole, choose_vehicles(whole, VEHICLES))


def _recorded(root: Path) -> _Named:
    folders = [f for f in (root / "taf_bw", root / "mona", root / "ngsim") if f.is_dir()]
    for folder in folders:
        found = scex_sumo.find_recordings([folder])
        for number, recording in enumerate(found[:: max(len(found) // 4, 1)]):
            loaded = scex_sumo.load_recording(recording)
            times = [m.time_s for m in scex_sumo.recording_moments(loaded, every_s=5.0)]
            for time_s in islice(times[2 :: max(len(times) // 3, 1)], 2):
                if (scene := _seed(loaded, time_s)) is not None:
                    yield f"{folder.name}_{number}_{time_s:g}", scene


def _fresh(root: Path) -> _Named:
    """Recordings that `_recorded` leaves out, and of those longer than 100 s other moments."""
    for name in ("ngsim", "taf_bw", "mona"):
        found = scex_sumo.find_recordings([root / name]) if (root / name).is_dir() else []
        used = {recording.name for recording in found[:: max(len(found) // 4, 1)]}
        for recording in found:
            loaded = scex_sumo.load_recording(recording)
            times = [m.time_s for m in scex_sumo.recording_moments(loaded, every_s=1.0)]
            shares = (0.15, 0.55, 0.8) if len(times) > 100 else (0.5,) if recording.name not in used else ()
            for share in shares:
                if (scene := _seed(loaded, times[int(share * len(times))])) is not None:
                    yield f"{recording.name}_{times[int(share * len(times))]:g}", scene


def _seed(loaded: scex_sumo.LoadedRecording, time_s: float) -> SeedScene | None:
    try:
        whole = scex_sumo.seed_at(loaded, time_s)
    except ScexError:  # nobody at this moment
        return None
    return reduced(whole, choose_vehicles(whole, VEHICLES)) if whole.vehicles >= VEHICLES else None


def truths(cache: Path, which: str, wanted: int) -> list[Truth]:
    """Truths from the cache, or run now."""
    folder = cache / which
    folder.mkdir(parents=True, exist_ok=True)
    found: list[Truth] = []
    for name, scene in islice(scenes(which), 2 * wanted):
        file = folder / f"{name}.npz"
        if not file.exists():
            _run(scene, file)
        if file.exists():
            found.append(_read(file))
        if len(found) == wanted:
            break
    return found


def _run(scene: SeedScene, file: Path) -> None:
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        try:
            # The plain world gives what SUMO gives, faster.
            run = scex_sumo.extrapolate(
                scene,
                models=DEFAULT_MODELS,
                futures="all",
                world="plain",
                reference=None,
                report=False,
                out=Path(folder) / "out",
            )
        except ScexError as error:
            print(f"{file.stem}: left out: {error}", flush=True)
            return
        values = np.stack([run.values(column) for column in run.columns], axis=1)
        critical = {
            c: is_critical(run.values(c), run.metric(c), limit) for c, limit in run.thresholds.items()
        }
        scenes_ = {"collision": np.asarray(run.metrics["collision"]) > 0, **critical}
        pairs = _by_pair(run)
        questions = (*scenes_, *(name for name, _ in pairs))
        answers = np.stack([*scenes_.values(), *(answer for _, answer in pairs)], axis=1)
        part = file.with_suffix(".part.npz")
        np.savez(part, values=values, columns=run.columns, questions=questions, answers=answers)
    part.rename(file)
    print(f"{file.stem}: {len(values)} runs in {time.perf_counter() - started:.0f} s", flush=True)


def _by_pair(run: scex_sumo.Run) -> list[tuple[str, BoolArray]]:
    """(N,) of each pair whether it collides, and whether its encounter is critical, in each future."""
    rows = run.encounters.to_pylist()
    pairs = sorted({tuple(sorted((row["track_id"], row["other_id"]))) for row in rows})
    return [(f"pair {name}", run.encounter(*pair).happens(name)) for pair in pairs for name in _PAIRS]


def _read(file: Path) -> Truth:
    with np.load(file) as data:
        return Truth(
            name=file.stem,
            columns=tuple(str(c) for c in data["columns"]),
            values=data["values"],
            questions=tuple(str(q) for q in data["questions"]),
            answers=data["answers"],
        )
