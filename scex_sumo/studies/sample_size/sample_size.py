"""Sample size: vehicles that interact most, all their assignments as the truth, the error of fewer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.base.version import __version__
from scex_sumo.behaviors.registry import DEFAULT_MODELS, parse_models
from scex_sumo.extrapolation.assignments import all_assignments
from scex_sumo.extrapolation.extrapolate import extrapolate
from scex_sumo.results.info import digest
from scex_sumo.results.run import Run, open_run
from scex_sumo.roads.matching import off_road
from scex_sumo.scene import SeedScene
from scex_sumo.statistics.density import BANDWIDTH, density
from scex_sumo.statistics.designs import DESIGNS, check_design

SIZES: Final = (1000, 385, 100, 10)
DRAWS: Final = 200
VEHICLES: Final = 5
_LOOK_AHEAD_S = 3.0
_STANDING_MPS = 0.5
_BOTH_STAND_M = 1e3
_OFF_ROAD_M = 1e6  # farther than any vehicle on the road
_DRAWS_AT_ONCE = 20
_KERNEL_REACH = 8  # bandwidths; beyond, the kernel is below 1e-14 of its height
MODELS: Final = f"{DEFAULT_MODELS},calibrated_driver,sumo:EIDM"
"""Six models as in the paper; two that drive as people do stand in for its learned drivers."""


def truth(
    scene: SeedScene,
    out: str | Path,
    *,
    models: str = MODELS,
    seed: int = 0,
    preset: str = "both",
    overwrite: bool = False,
    **options: Any,
) -> Run:
    """Run every assignment of a seed scene, or open the result of an earlier run.

    Args:
        out: result folder; an interrupted run goes on.
        seed: of the random routes; one draw per assignment.
        options: others of `extrapolate`.
    """
    if (Path(out) / "run.json").is_file() and not overwrite:
        run, specs = open_run(out), parse_models(models)
        wanted: Mapping[str, Any] = {
            "scex_sumo": __version__,
            "models": [{"model": str(s), "weight": s.weight} for s in specs],
            "futures": len(all_assignments([len(specs)] * scene.vehicles)),
            "assign": {},
            "preset": preset,
            "seed": seed,
        }
        same_scene = run.info["seed_scene"]["fingerprint"] == digest(scene)
        if same_scene and all(run.info.get(k) == v for k, v in wanted.items()):
            return run
    options |= {"models": models, "futures": "all", "preset": preset, "seed": seed, "world": "checked"}
    options |= {"reference": None, "report": False}
    return extrapolate(scene, out=out, overwrite=overwrite, **options)


def subsets(count: int, size: int, draws: int, *, seed: int = 0) -> IntArray:
    """Return random subsets (D, size) of ``count`` futures."""
    rngs = (np.random.default_rng([seed, size, draw]) for draw in range(draws))
    return np.stack([rng.permutation(count)[:size] for rng in rngs])


def designed(
    design: str, models: int, vehicles: int, size: int, draws: int, *, seed: int = 0
) -> tuple[IntArray, ...]:
    """Return the futures that repetitions of a design would run.

    Args:
        design: one of `scex_sumo.statistics.designs.DESIGNS`.
        models: number of models, equally frequent.

    Returns:
        D arrays (size,), numbered as by `scex_sumo.extrapolation.assignments.all_assignments`.
    """
    check_design(design)
    shares = [np.full(models, 1 / models)] * vehicles
    numbers = []
    for draw in range(draws):
        rows = DESIGNS[design](shares, size, np.random.default_rng([seed, draw]))
        numbers.append(np.ravel_multi_index(tuple(rows.T), (models,) * vehicles).astype(np.int64))
    return tuple(numbers)


def study(
    run: Run,
    *,
    sizes: Sequence[int] = SIZES,
    draws: int = DRAWS,
    designs: Sequence[str] = ("random",),
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> list[dict[str, Any]]:
    """Return median and 95th percentile of the distances of smaller samples to all futures.

    Rows have metric, design, size, draws, defined_draws, and median and p95 of ks, w1 and jsd.

    Args:
        sizes: numbers of futures; those above the number of assignments are left out.
        designs: ``random``: subsets without replacement; ``balanced``: its designs.
        progress: called with (metrics done, metrics in all).
    """
    models, vehicles = len(run.info["models"]), run.info["seed_scene"]["vehicles"]
    if run.futures != models**vehicles:
        raise UsageError(f"{run.folder}: {run.futures} futures, not all {models**vehicles} assignments")
    fitting = [size for size in sizes if size <= run.futures]
    samples: dict[tuple[str, int], Sequence[IntArray] | IntArray] = {}
    for design in designs:
        check_design(design)
        if design == "random":
            samples |= {(design, n): subsets(run.futures, n, draws, seed=seed) for n in fitting}
        elif fitting:
            whole = designed(design, models, vehicles, max(fitting), draws, seed=seed)
            # The first runs of a long one are a short one.
            samples |= {(design, n): [d[:n] for d in whole] for n in fitting}
    rows = []
    for index, column in enumerate(run.columns):
        values = run.metrics[column].to_numpy(zero_copy_only=False)
        for (design, size), picked in samples.items():
            distances_of = errors(np.asarray(values, dtype=np.float64), picked)
            row: dict[str, Any] = {"metric": column, "design": design, "size": size, "draws": draws}
            row["defined_draws"] = int(np.isfinite(distances_of.ks).sum())
            for name, distances in (
                ("ks", distances_of.ks),
                ("w1", distances_of.w1),
                ("jsd", distances_of.jsd),
            ):
                some = distances[np.isfinite(distances)]
                row[f"{name}_median"] = float(np.median(some)) if len(some) else None
                row[f"{name}_p95"] = float(np.quantile(some, 0.95)) if len(some) else None
            rows.append(row)
        if progress is not None:
            progress(index + 1, len(run.columns))
    return rows


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Distances of draws from the truth, in one metric.

    Attributes:
        ks: (D,) Kolmogorov-Smirnov; NaN if the metric is defined in no future of a draw.
        w1: (D,) Wasserstein-1, in the metric's unit.
        jsd: (D,) Jensen-Shannon divergence, base 2, of the kernel densities.
    """

    ks: FloatArray
    w1: FloatArray
    jsd: FloatArray


def errors(values: FloatArray, draws: Sequence[IntArray] | IntArray) -> Errors:
    """Compute distances between the distribution of a metric over some futures and over all.

    Args:
        values: (N,) of all futures; only finite ones count.
        draws: D arrays of futures.
    """
    defined = np.flatnonzero(np.isfinite(values))
    nothing = np.full(len(draws), np.nan)
    if len(defined) == 0:
        return Errors(ks=nothing, w1=nothing, jsd=nothing)
    at, place = np.unique(values[defined], return_inverse=True)
    rank = np.full(len(values), len(at), dtype=np.int64)  # undefined ones are counted behind the last
    rank[defined] = place
    counts = np.stack([np.bincount(rank[d], minlength=len(at) + 1)[: len(at)] for d in draws])
    number = counts.sum(axis=1)
    some = number > 0
    share = counts[some] / number[some, None]
    whole = np.bincount(place, minlength=len(at)) / len(defined)
    apart = np.abs(np.cumsum(share, axis=1) - np.cumsum(whole))
    ks, w1, jsd = nothing, nothing.copy(), nothing.copy()
    ks[some] = apart.max(axis=1)
    w1[some] = apart[:, :-1] @ np.diff(at)
    jsd[some] = _divergence(at, share, whole)
    return Errors(ks=ks, w1=w1, jsd=jsd)


def _divergence(at: FloatArray, share: FloatArray, whole: FloatArray) -> FloatArray:
    """Return divergences (D,) of weighted samples from the truth."""
    from scipy.sparse import csr_matrix

    grid = density(at).x
    reach = _KERNEL_REACH * BANDWIDTH
    start, stop = np.searchsorted(grid, at - reach), np.searchsorted(grid, at + reach)
    ends = np.concatenate([[0], np.cumsum(stop - start)])
    column = np.arange(ends[-1]) - np.repeat(ends[:-1] - start, stop - start)
    z = (grid[column] - np.repeat(at, stop - start)) / BANDWIDTH
    kernel = csr_matrix((np.exp(-0.5 * z * z), column, ends), shape=(len(at), len(grid)))
    truth_mass = np.asarray(kernel.T @ whole)
    truth_mass /= truth_mass.sum()
    result = np.empty(len(share))
    for first in range(0, len(share), _DRAWS_AT_ONCE):
        part = slice(first, first + _DRAWS_AT_ONCE)
        for draw, mass in enumerate((csr_matrix(share[part]) @ kernel).toarray(), first):
            mass /= mass.sum()
            middle = (mass + truth_mass) / 2
            result[draw] = (_entropy_part(mass, middle) + _entropy_part(truth_mass, middle)) / 2
    return np.clip(result, 0.0, 1.0)


def _entropy_part(mass: FloatArray, middle: FloatArray) -> float:
    some = mass > 0
    return float(np.sum(mass[some] * np.log2(mass[some] / middle[some])))


def choose_vehicles(scene: SeedScene, count: int = VEHICLES) -> IntArray:
    """Choose a group of vehicles around the closest encounter, as ascending indices.

    At constant velocity for 3 s, the two vehicles that come nearest to each other are taken first, then
    always the one that comes nearest to any taken.
    """
    if not 1 <= count <= scene.vehicles:
        raise UsageError(
            f"{scene.name}: has {scene.vehicles} vehicles, but {count} shall take part; give --vehicles 1 to "
            f"{scene.vehicles}, or a seed scene with more vehicles by --time or --synthetic"
        )
    apart = _nearest_approach(scene)
    stands = scene.now.speed < _STANDING_MPS
    apart[stands[:, None] & stands] += _BOTH_STAND_M
    if scene.road is not None:
        off = off_road(scene.road, scene)
        apart[off, :] += _OFF_ROAD_M
        apart[:, off] += _OFF_ROAD_M
    np.fill_diagonal(apart, np.inf)
    chosen = [int(v) for v in np.unravel_index(np.argmin(apart), apart.shape)][:count]
    while len(chosen) < count:
        nearest = apart[chosen].min(axis=0)
        nearest[chosen] = np.inf
        others = [v for v in range(scene.vehicles) if v not in chosen]
        chosen.append(min(others, key=lambda v: float(nearest[v])))
    return np.sort(np.asarray(chosen, dtype=np.int64))


def _nearest_approach(scene: SeedScene) -> FloatArray:
    now = scene.now
    x, y = now.x, now.y
    vx, vy = now.speed * np.cos(now.heading), now.speed * np.sin(now.heading)
    dx, dy = x[None] - x[:, None], y[None] - y[:, None]
    dvx, dvy = vx[None] - vx[:, None], vy[None] - vy[:, None]
    speed2 = dvx**2 + dvy**2
    when = np.where(speed2 > 0, -(dx * dvx + dy * dvy) / np.where(speed2 > 0, speed2, 1.0), 0.0)
    when = np.clip(when, 0.0, _LOOK_AHEAD_S)
    return np.asarray(np.hypot(dx + dvx * when, dy + dvy * when), dtype=np.float64)


def reduced(scene: SeedScene, vehicles: Sequence[int] | IntArray) -> SeedScene:
    """Return the seed scene with some of its vehicles, by index; other participants stay."""
    kept = np.asarray(vehicles, dtype=np.int64)
    if len(kept) == scene.vehicles:
        return scene
    return scene.reordered(kept.tolist(), name=f"{scene.name}_{len(kept)}v")
