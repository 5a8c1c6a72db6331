"""How many runs each design needs for the error of 385 independent draws, against all assignments.

Run: python benchmarks/designs.py CACHE [--scenes N] [--repetitions N] [--part PART]

Every scene has 5 vehicles, each driven by one of 5 models: all 3125 assignments are run once and kept in
CACHE. Then designs are drawn again and again, and the Kolmogorov-Smirnov distance between the values of their
runs and those of all assignments is averaged over metrics, scenes and repetitions.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import scex_sumo
from scex_sumo.arrays import FloatArray
from scex_sumo.errors import ScexError
from scex_sumo.scenarios.reduction import choose_vehicles, reduced
from scex_sumo.statistics.bands import grow, look
from scex_sumo.statistics.designs import DESIGNS
from scex_sumo.statistics.distances import errors
from scex_sumo.statistics.intervals import DesignIntervals
from scex_sumo.studies.sample_size import designed

VEHICLES = 5
MODELS = "standard_driver,risky_driver,constant_velocity,emergency_brake,calibrated_driver"
LEVELS = len(MODELS.split(","))
SIZES = (50, 75, 100, 125, 150, 192, 256, 385)
BASELINE = 385
COVERAGE_SIZES = (100, 385, 770)
COVERAGE_REPETITIONS = 20
BAND = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth:
    """All assignments of one scene.

    Attributes:
        name: of the scene.
        columns: names of the 12 metrics.
        values: (N, 12), NaN where undefined, ordered as all assignments are.
    """

    name: str
    columns: tuple[str, ...]
    values: FloatArray


def maps() -> list[Path]:
    """The three examples, and the real maps where they are."""
    root = Path(os.environ.get("SCEX_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
    real = [*sorted(root.glob("interaction/maps/*.osm")), *sorted(root.glob("taf_bw/maps/*.osm"))]
    return [
        *(scex_sumo.example_path(n) for n in ("roundabout", "motorway_merge", "urban_intersection")),
        *real,
    ]


def truths(cache: Path, wanted: int) -> list[Truth]:
    """Truths from the cache, or run now; the synthetic seeds go round the maps."""
    cache.mkdir(parents=True, exist_ok=True)
    found: list[Truth] = []
    every = maps()
    for index in range(4 * wanted):
        if len(found) == wanted:
            break
        map_path, seed = every[index % len(every)], index // len(every)
        file = cache / f"{map_path.stem}_{seed}.npz"
        if not file.exists():
            started = time.perf_counter()
            try:
                _run(map_path, seed, file)
            except ScexError as error:
                print(f"{map_path.stem}, seed {seed}: left out: {error}", flush=True)
                continue
            print(
                f"{file.stem}: {LEVELS**VEHICLES} runs in {time.perf_counter() - started:.0f} s", flush=True
            )
        with np.load(file) as data:
            columns = tuple(str(c) for c in data["columns"])
            found.append(Truth(name=file.stem, columns=columns, values=data["values"]))
    return found


def _run(map_path: Path, seed: int, file: Path) -> None:
    whole = scex_sumo.synthetic_seed(map_path, vehicles=2 * VEHICLES, seed=seed)
    scene = reduced(whole, choose_vehicles(whole, VEHICLES))
    with tempfile.TemporaryDirectory() as folder:
        run = scex_sumo.extrapolate(scene, models=MODELS, children="all", out=Path(folder) / "out")
        values = np.stack([run.metrics[c].to_numpy(zero_copy_only=False) for c in run.columns], axis=1)
        np.savez(file, values=values, columns=np.array(run.columns))


def distances(found: list[Truth], design: str, repetitions: int) -> list[FloatArray]:
    """(S, M, R) distance to the truth of every scene, metric and repetition, by size; NaN where undefined."""
    whole = designed(design, LEVELS, VEHICLES, max(SIZES), repetitions, seed=7)
    by_size = [
        tuple(d[:size] for d in whole) for size in SIZES
    ]  # the first runs of a long one are a short one
    return [
        np.stack(
            [np.stack([errors(t.values[:, m], draws, with_jsd=False).ks for m in range(12)]) for t in found]
        )
        for draws in by_size
    ]


def needed(error: FloatArray, goal: float) -> float:
    """Runs at which an error falls to a goal, interpolated between sizes on logarithmic scales."""
    falling = np.minimum.accumulate(error)
    if falling[-1] > goal:
        return float("inf")
    return float(np.exp(np.interp(-np.log(goal), -np.log(falling), np.log(SIZES))))


def mean_over(distance: FloatArray) -> float:
    """Mean over metrics and repetitions of each scene, then over scenes."""
    return float(np.nanmean(distance))


def high_over(distance: FloatArray) -> float:
    """95th percentile over repetitions, averaged over metrics and scenes."""
    with np.errstate(all="ignore"):
        high = np.array([np.nanquantile(m, 0.95) for s in distance for m in s if np.isfinite(m).any()])
    return float(high.mean())


def compare(found: list[Truth], repetitions: int) -> None:
    """Print how many runs every design needs."""
    table = {design: distances(found, design, repetitions) for design in DESIGNS}
    base = table["random"][SIZES.index(BASELINE)]
    print(f"\nKS distance to the truth: mean over {len(found)} scenes, 12 metrics, {repetitions} repetitions")
    print("| design | " + " | ".join(map(str, SIZES)) + f" | runs for {BASELINE} random (mean) | (95 %) |")
    print("|---" * (len(SIZES) + 3) + "|")
    for design, at in table.items():
        mean = np.array([mean_over(d) for d in at])
        high = np.array([high_over(d) for d in at])
        enough = needed(mean, mean_over(base)), needed(high, high_over(base))
        print(
            f"| {design} | "
            + " | ".join(f"{m:.4f}" for m in mean)
            + f" | {enough[0]:.0f} | {enough[1]:.0f} |"
        )
    print("\nruns that `balanced` needs, metric by metric:")
    for index, name in enumerate(found[0].columns):
        mean = np.array([mean_over(d[:, index]) for d in table["balanced"]])
        print(f"  {name}: {needed(mean, mean_over(base[:, index])):.0f}")
    per_scene = [
        needed(np.array([np.nanmean(d[s]) for d in table["balanced"]]), float(np.nanmean(base[s])))
        for s in range(len(found))
    ]
    print(f"scene by scene: {np.min(per_scene):.0f} to {np.max(per_scene):.0f}")


def cover(found: list[Truth], repetitions: int) -> None:
    """Print how often the 95 % bands hold, and how wide they are."""
    shape = (LEVELS,) * VEHICLES
    print(f"\n95 % bands: how often they hold, mean half-width ({repetitions} repetitions)")
    print("| design | runs | holds | half-width |")
    print("|---|---|---|---|")
    for design in ("random", "balanced"):
        for size in COVERAGE_SIZES:
            held, width = [], []
            for draw in designed(design, LEVELS, VEHICLES, size, repetitions, seed=8):
                bands = DesignIntervals(np.stack(np.unravel_index(draw, shape), axis=1), design=design)
                for truth in found:
                    for m in range(12):
                        values = truth.values[:, m]
                        ks = float(errors(values, [draw], with_jsd=False).ks[0])
                        if np.isfinite(ks):
                            width.append(bands.half_width(values[draw]))
                            held.append(ks <= width[-1])
            print(f"| {design} | {size} | {np.mean(held):.1%} | {np.mean(width):.3f} |")
    stop(found, max(repetitions // 4, 1))


def stop(found: list[Truth], repetitions: int) -> None:
    """Print at how many runs ``--until-band`` stops, and how often all is then as near as it says."""
    shape = (LEVELS,) * VEHICLES
    print(f"\n--until-band {BAND}: runs until it stops, and share of metrics that are then within the band")
    print("| design | median | 95 % | within |")
    print("|---|---|---|---|")
    for design in ("random", "balanced"):
        counts, within = [], []
        for draw in designed(design, LEVELS, VEHICLES, 3000, repetitions, seed=9):
            levels = np.stack(np.unravel_index(draw, shape), axis=1)
            for truth in found:
                values = truth.values[draw]

                def measure(count: int, levels=levels, values=values, truth=truth):  # type: ignore[no-untyped-def]
                    known = np.isfinite(values[:count])
                    intervals = DesignIntervals(levels[:count], design=design)  # noqa: B023
                    return look(intervals, values[:count], known, truth.columns)

                end = grow(measure, band=BAND, most=3000)
                counts.append(end.children)
                for m, name in enumerate(truth.columns):
                    if name not in end.left_out:
                        ks = errors(truth.values[:, m], [draw[: end.children]], with_jsd=False).ks[0]
                        within.append(ks <= BAND)
        middle, high = np.quantile(counts, [0.5, 0.95])
        print(f"| {design} | {middle:.0f} | {high:.0f} | {np.mean(within):.1%} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cache", type=Path)
    parser.add_argument("--scenes", type=int, default=21)
    parser.add_argument("--repetitions", type=int, default=200)
    parser.add_argument("--part", choices=("all", "truths", "compare", "cover"), default="all")
    given = parser.parse_args()
    found = truths(given.cache, given.scenes)
    if given.part in ("all", "compare"):
        compare(found, given.repetitions)
    if given.part in ("all", "cover"):
        cover(found, COVERAGE_REPETITIONS)


if __name__ == "__main__":
    main()
