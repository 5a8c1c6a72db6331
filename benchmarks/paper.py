"""The experiments of "Scene-Extrapolation: Generating Interactive Traffic Scenarios", as tables.

    python benchmarks/paper.py [--data FOLDER] [-o out/paper] [--seeds 4] [--futures 385] [--draws 200]

Seed scenes are the busiest moments of equal parts of INTERACTION's DR_DEU_Roundabout_OF recording, and one on
DR_DEU_Merging_MT with vehicles that SUMO drove, as no recording of it is at hand. The six models of the paper
drive 385 futures of each. Printed are the four thresholds, the twelve values beside what really
happened, the distances between seed scenes, and the error of fewer futures than all assignments of five
vehicles, which ``sample_size.png`` shows. ``scex-sumo plot`` draws the densities of the result folders.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator
from scipy.stats import ks_2samp

import scex_sumo as scex
from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.evaluation.recordings import load_recording, recording_moments, seed_at
from scex_sumo.metrics.registry import metric_of
from scex_sumo.page.figures.drawing import STYLE, save
from scex_sumo.results.design import is_critical
from scex_sumo.results.run import Run
from scex_sumo.scene import SeedScene
from scex_sumo.statistics.density import density, dkw_half_width

RECORDED, MERGING = "DR_DEU_Roundabout_OF", "DR_DEU_Merging_MT"
MODELS = "paper"
MERGING_VEHICLES = 12
AHEAD_S = 3.0
SIZES = {1000: "#009e73", 385: "#0072b2", 100: "#e69f00", 10: "#cc79a7"}  # and their colours
VEHICLES = 5  # 6⁵ = 7 776 assignments


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


def extrapolated(scene: SeedScene, out: Path, futures: int | str) -> Run:
    """The futures of a seed scene, without what the paper does not have."""
    return scex.extrapolate(
        scene,
        futures=futures,
        models=MODELS,
        metrics="paper",
        reference=None,
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
            mark = (
                "*"
                if real is not None and is_critical(np.array([real]), run.metric(column), limit)[0]
                else ""
            )
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
    """Errors of fewer futures than all assignments of the five vehicles that interact most; their figure."""
    few = reduced(scene, choose_vehicles(scene, VEHICLES))
    run = extrapolated(few, out, "all")
    samples = {size: subsets(run.futures, size, draws) for size in SIZES}
    limits = [column for column in run.thresholds if len(run.samples(column))]
    errors: dict[tuple[str, int], FloatArray] = {}
    for column in limits:
        values = run.values(column)
        errors |= {(column, size): distances(values, drawn) for size, drawn in samples.items()}
    draw_sample_sizes(run, samples, errors, out / "sample_size.png")
    lines = [row_of(["futures", *(f"KS {column}: median, 95 %" for column in limits), "DKW"])]
    lines.append(row_of(["---"] * (len(limits) + 2)))
    for size in SIZES:
        cells = [", ".join(f"{q:.3f}" for q in middle_and_95(errors[column, size])) for column in limits]
        lines.append(row_of([str(size), *cells, f"{dkw_half_width(size):.3f}"]))
    about = f"{few.name}: {run.futures} assignments of tracks {', '.join(map(str, few.track_ids))}"
    return [about, "", *lines]


def subsets(count: int, size: int, draws: int) -> IntArray:
    """Random subsets (draws, size) of ``count`` futures."""
    rngs = (np.random.default_rng([size, draw]) for draw in range(draws))
    return np.stack([rng.permutation(count)[:size] for rng in rngs])


def distances(values: FloatArray, samples: IntArray) -> FloatArray:
    """Kolmogorov-Smirnov distances of samples (D, n) to all futures (N,); NaN where nothing is defined."""
    return np.array([ks(*(part[~np.isnan(part)] for part in (values[drawn], values))) for drawn in samples])


def middle_and_95(errors: FloatArray) -> tuple[float, float]:
    return float(np.nanmedian(errors)), float(np.nanquantile(errors, 0.95))


def draw_sample_sizes(
    run: Run, samples: dict[int, IntArray], errors: dict[tuple[str, int], FloatArray], path: Path
) -> None:
    """Draw cumulative densities of all assignments and of one sample of each size; below, the distances."""
    columns = [*dict.fromkeys(column for column, _ in errors)]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(2.3 * len(columns), 4.2), layout="constrained")
        grid = figure.subplots(2, len(columns))
        for (above, below), column in zip(grid.T, columns, strict=True):
            metric = metric_of(column)
            above.set(title=metric.words, xlabel=f"[{metric.column_unit or '–'}]", ylim=(0, 1))
            draw_cumulative(above, run.values(column), samples)
            above.axvline(run.thresholds[column], color="#999999", linewidth=0.8)
            for k, style in enumerate(("-", "--")):
                line = [middle_and_95(errors[column, size])[k] for size in SIZES]
                below.plot([*SIZES], line, color="#333333", linestyle=style, marker="o", markersize=3)
            below.plot([*SIZES], [dkw_half_width(n) for n in SIZES], color="#999999", linewidth=0.8)
            below.set(xscale="log", yscale="log", xlabel="futures", ylim=(0.01, 0.6))
            below.set_xticks([*SIZES], [str(size) for size in SIZES])
            below.set_yticks([0.02, 0.05, 0.1, 0.2, 0.5], ["0.02", "0.05", "0.1", "0.2", "0.5"])
            for axis in (below.xaxis, below.yaxis):
                axis.set_minor_locator(NullLocator())
        grid[0, 0].set_ylabel("cumulative density")
        grid[1, 0].set_ylabel("KS distance to all")
        grid[0, -1].legend([f"all {run.futures}", *map(str, SIZES)], frameon=False, fontsize=7)
        words = ["median", "95 % of samples", "DKW bound"]
        grid[1, 0].legend(words, frameon=False, fontsize=7, loc="lower left")
        save(figure, path, dpi=140)


def draw_cumulative(axes: Axes, values: FloatArray, samples: dict[int, IntArray]) -> None:
    """Draw the cumulative density of all futures in black, and of the first sample of each size."""
    sets = [("#000000", values), *((SIZES[size], values[drawn[0]]) for size, drawn in samples.items())]
    for number, (color, some) in enumerate(sets):
        some = some[~np.isnan(some)]
        if len(some):
            curve = density(some)
            axes.plot(curve.x, curve.cdf, color=color, linewidth=1 if number else 2)
    axes.set_xlim(*np.nanquantile(values, [0, 0.98]))


def choose_vehicles(scene: SeedScene, count: int) -> IntArray:
    """Choose vehicles around the closest encounter, as ascending indices.

    At constant velocity for 3 s, the two moving ones that come nearest to each other are taken first, then
    always the one that comes nearest to any taken.
    """
    now, when = scene.now, np.arange(0.0, 3.05, 0.1)
    x = now.x[:, None] + (now.speed * np.cos(now.heading))[:, None] * when
    y = now.y[:, None] + (now.speed * np.sin(now.heading))[:, None] * when
    apart = np.hypot(x[:, None] - x, y[:, None] - y).min(axis=2)
    stands = now.speed < 0.5
    apart[stands[:, None] & stands] += 1e3
    np.fill_diagonal(apart, np.inf)
    chosen = [int(v) for v in np.unravel_index(np.argmin(apart), apart.shape)]
    while len(chosen) < min(count, scene.vehicles):
        nearest = apart[chosen].min(axis=0)
        nearest[chosen] = np.inf
        chosen.append(int(np.argmin(nearest)))
    return np.sort(chosen)


def reduced(scene: SeedScene, vehicles: IntArray) -> SeedScene:
    """Return the seed scene with some of its vehicles, by index."""
    return scene.reordered(vehicles.tolist(), name=f"{scene.name}_{len(vehicles)}v")


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
