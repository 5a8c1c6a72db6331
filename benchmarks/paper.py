"""The experiments of "Scene-Extrapolation: Generating Interactive Traffic Scenarios", as tables.

    python benchmarks/paper.py [--data FOLDER] [-o out/paper] [--seeds 4] [--futures 385] [--draws 200]

Seed scenes are the busiest moments of equal parts of INTERACTION's DR_DEU_Roundabout_OF recording, and one on
DR_DEU_Merging_MT with vehicles that SUMO drove, as no recording of it is at hand. The six models of the paper
drive 385 futures of each. Printed are the four thresholds, the twelve values beside what really
happened, the distances between seed scenes, and the error of fewer futures than all assignments of five
vehicles. The result folders keep the reports with all densities; the recorded future is their dashed line.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import numpy as np
from scipy.stats import ks_2samp

import scex_sumo as scex
from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.evaluation.recordings import load_recording, recording_moments, seed_at
from scex_sumo.results.design import is_critical
from scex_sumo.results.run import Run
from scex_sumo.scene import SeedScene
from scex_sumo.studies.sample_size.sample_size import SIZES, choose_vehicles, reduced, study, truth

RECORDED, MERGING = "DR_DEU_Roundabout_OF", "DR_DEU_Merging_MT"
MODELS = "paper"
MERGING_VEHICLES = 12
AHEAD_S = 3.0


def seeds(data: Path, count: int) -> list[SeedScene]:
    """Recorded moments of the roundabout, and one on the motorway merge."""
    (recording,) = find_recordings([data / "interaction" / "recorded_trackfiles" / RECORDED])
    loaded = load_recording(recording)
    moments = [m for m in recording_moments(loaded, every_s=1.0) if m.complete > 1]
    moments = [m for m in moments if m.time_s <= moments[-1].time_s - AHEAD_S]
    parts = np.array_split(np.arange(len(moments)), count)
    busiest = [max((moments[k] for k in part), key=lambda moment: moment.complete) for part in parts]
    found = [seed_at(loaded, moment.time_s) for moment in busiest]
    merging = data / "interaction" / "maps" / f"{MERGING}.osm"
    return [*found, scex.synthetic_seed(merging, vehicles=MERGING_VEHICLES)]


def extrapolated(scene: SeedScene, out: Path, futures: int) -> Run:
    """The futures of a seed scene, without what the paper does not have."""
    return scex.extrapolate(
        scene,
        futures=futures,
        models=MODELS,
        preset="paper",
        design="random",
        reference=None,
        exact=False,
        response="none",
        out=out / scene.name,
        overwrite=True,
    )


def thresholds_table(runs: list[Run]) -> list[str]:
    """P(critical) of the paper's thresholds, and whether the recorded future was critical (*)."""
    limits = runs[0].thresholds
    names = [f"{column} {limit:.3g}" for column, limit in limits.items()]
    lines = row_of(["seed scene", "vehicles", *names]), row_of(["---"] * (len(names) + 2))
    rows = []
    for run in runs:
        cells = []
        for column, limit in limits.items():
            real = run.recorded_value(column)
            mark = "*" if real is not None and is_critical(np.array([real]), column, limit)[0] else ""
            share = run.p_critical(column)
            cells.append(f"{share.value:.0%} [{share.low:.0%}–{share.high:.0%}]{mark}")
        rows.append(row_of([run.folder.name, str(run.info["seed_scene"]["vehicles"]), *cells]))
    return [*lines, *rows]


def values_table(runs: list[Run]) -> list[str]:
    """Median of each value and its 5-95 % range; what happened, and the share of futures below it."""
    lines = [row_of(["value", *(run.folder.name for run in runs)]), row_of(["---"] * (len(runs) + 1))]
    for column in runs[0].columns:
        cells = []
        for run in runs:
            sample, real = run.samples(column), run.recorded_value(column)
            if not len(sample):
                cells.append("–")
                continue
            low, middle, high = np.quantile(sample, [0.05, 0.5, 0.95])
            seen = "" if real is None else f"; recorded {real:.2f} ({np.mean(sample < real):.0%} below)"
            cells.append(f"{middle:.2f} ({low:.2f}–{high:.2f}){seen}")
        lines.append(row_of([column, *cells]))
    return lines


def distances_table(runs: list[Run]) -> list[str]:
    """Kolmogorov-Smirnov distance between seed scenes, and between two halves of the same futures."""
    pairs = [(a, b) for k, a in enumerate(runs) for b in runs[k + 1 :]]
    lines = [row_of(["value", "between seed scenes: median", "least", "halves of one"]), row_of(["---"] * 4)]
    for column in runs[0].columns:
        between = [ks(a.samples(column), b.samples(column)) for a, b in pairs]
        within = [ks(run.samples(column)[::2], run.samples(column)[1::2]) for run in runs]
        figures = (np.nanmedian(between), np.nanmin(between), np.nanmedian(within))
        lines.append(row_of([column, *(f"{value:.2f}" for value in figures)]))
    return lines


def ks(one: FloatArray, other: FloatArray) -> float:
    return float(ks_2samp(one, other).statistic) if len(one) and len(other) else np.nan


def sample_size_table(scene: SeedScene, out: Path, draws: int) -> list[str]:
    """Errors of fewer futures than all assignments of the five vehicles that interact most."""
    few = reduced(scene, choose_vehicles(scene))
    run = truth(few, out / "all_assignments", models=MODELS, preset="paper", overwrite=True)
    rows = study(run, sizes=SIZES, draws=draws, designs=["random", "balanced"])
    limits = list(run.thresholds)
    lines = [row_of(["design", "futures", *(f"KS {c}: median, 95 %" for c in limits), "DKW"])]
    lines.append(row_of(["---"] * (len(limits) + 3)))
    for design in ("random", "balanced"):
        for size in SIZES:
            cells = []
            for column in limits:
                (found,) = (
                    r for r in rows if (r["design"], r["size"], r["metric"]) == (design, size, column)
                )
                cells.append(
                    "–" if found["ks_median"] is None else f"{found['ks_median']:.3f}, {found['ks_p95']:.3f}"
                )
            band = np.sqrt(np.log(2 / 0.05) / (2 * size))
            lines.append(row_of([design, str(size), *cells, f"{band:.3f}"]))
    return [
        f"{few.name}: {run.futures} assignments of tracks {', '.join(map(str, few.track_ids))}",
        "",
        *lines,
    ]


def row_of(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("SCEX_DATA", "../shared/data")))
    parser.add_argument("-o", "--out", type=Path, default=Path("out/paper"))
    parser.add_argument("--seeds", type=int, default=4, help="recorded seed scenes")
    parser.add_argument("--futures", type=int, default=385)
    parser.add_argument("--draws", type=int, default=200, help="samples of each size")
    arguments = parser.parse_args()
    scenes = seeds(arguments.data, arguments.seeds)
    runs = [extrapolated(scene, arguments.out, arguments.futures) for scene in scenes]
    tables = (thresholds_table(runs), values_table(runs), distances_table(runs))
    busiest = max(scenes[:-1], key=lambda scene: scene.vehicles)
    for lines in (*tables, sample_size_table(busiest, arguments.out, arguments.draws)):
        print("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
