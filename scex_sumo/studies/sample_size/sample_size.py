"""Sample size: vehicles that interact most, all their assignments as the truth, the error of fewer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
from scex_sumo.statistics.designs import DESIGNS, check_design
from scex_sumo.studies.distances import errors

SIZES: Final = (1000, 385, 100, 10)
DRAWS: Final = 200
VEHICLES: Final = 5
_LOOK_AHEAD_S = 3.0
_STANDING_MPS = 0.5
_BOTH_STAND_M = 1e3
_OFF_ROAD_M = 1e6  # farther than any vehicle on the road
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
        found, specs = open_run(out), parse_models(models)
        wanted: Mapping[str, Any] = {
            "scex_sumo": __version__,
            "models": [{"model": str(s), "weight": s.weight} for s in specs],
            "children": len(all_assignments([len(specs)] * scene.vehicles)),
            "assign": {},
            "preset": preset,
            "seed": seed,
        }
        same_scene = found.info["seed_scene"]["fingerprint"] == digest(scene)
        if same_scene and all(found.info.get(k) == v for k, v in wanted.items()):
            return found
    options |= {"models": models, "children": "all", "preset": preset, "seed": seed, "world": "checked"}
    return extrapolate(scene, out=out, overwrite=overwrite, **options)


def subsets(count: int, size: int, draws: int, *, seed: int = 0) -> IntArray:
    """Return random subsets (D, size) of ``count`` children."""
    rngs = (np.random.default_rng([seed, size, draw]) for draw in range(draws))
    return np.stack([rng.permutation(count)[:size] for rng in rngs])


def designed(
    design: str, models: int, vehicles: int, size: int, draws: int, *, seed: int = 0
) -> tuple[IntArray, ...]:
    """Return the children that repetitions of a design would run.

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
    """Return median and 95th percentile of the distances of smaller samples to all children.

    Rows have metric, design, size, draws, defined_draws, and median and p95 of ks, w1 and jsd.

    Args:
        sizes: numbers of children; those above the number of assignments are left out.
        designs: ``random``: subsets without replacement; ``balanced``: its designs.
        progress: called with (metrics done, metrics in all).
    """
    models, vehicles = len(run.info["models"]), run.info["seed_scene"]["vehicles"]
    if run.children != models**vehicles:
        raise UsageError(f"{run.folder}: {run.children} children, not all {models**vehicles} assignments")
    fitting = [size for size in sizes if size <= run.children]
    samples: dict[tuple[str, int], Sequence[IntArray] | IntArray] = {}
    for design in designs:
        check_design(design)
        if design == "random":
            samples |= {(design, n): subsets(run.children, n, draws, seed=seed) for n in fitting}
        elif fitting:
            whole = designed(design, models, vehicles, max(fitting), draws, seed=seed)
            # The first runs of a long one are a short one.
            samples |= {(design, n): [d[:n] for d in whole] for n in fitting}
    rows = []
    for index, column in enumerate(run.columns):
        values = run.metrics[column].to_numpy(zero_copy_only=False)
        for (design, size), picked in samples.items():
            found = errors(np.asarray(values, dtype=np.float64), picked)
            row: dict[str, Any] = {"metric": column, "design": design, "size": size, "draws": draws}
            row["defined_draws"] = int(np.isfinite(found.ks).sum())
            for name, distances in (("ks", found.ks), ("w1", found.w1), ("jsd", found.jsd)):
                some = distances[np.isfinite(distances)]
                row[f"{name}_median"] = float(np.median(some)) if len(some) else None
                row[f"{name}_p95"] = float(np.quantile(some, 0.95)) if len(some) else None
            rows.append(row)
        if progress is not None:
            progress(index + 1, len(run.columns))
    return rows


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
