"""Sample size: all assignments as the truth, and the error of fewer children."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from scex_sumo.base.arrays import IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.registry import DEFAULT_MODELS
from scex_sumo.extrapolation.assignments import all_assignments
from scex_sumo.scene import SeedScene
from scex_sumo.statistics.designs import DESIGNS, check_design
from scex_sumo.studies.distances import errors

if TYPE_CHECKING:
    from scex_sumo.results.run import Run

SIZES: Final = (1000, 385, 100, 10)
DRAWS: Final = 200
MODELS: Final = f"{DEFAULT_MODELS},calibrated_driver,sumo:EIDM"
"""Six models as in the paper; two that drive as people do stand in for its learned drivers."""


def truth(
    scene: SeedScene,
    out: str | Path,
    *,
    models: str = MODELS,
    seed: int = 0,
    workers: int = 1,
    preset: str = "both",
    overwrite: bool = False,
    command: Sequence[str] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Run:
    """Run every assignment of a seed scene, or open the result of an earlier run.

    Args:
        out: result folder; an interrupted run goes on.
        seed: of the random routes; one draw per assignment.
        command: the command line, for ``run.json``.
        progress: called with (steps done, steps in all).
    """
    from scex_sumo.base.version import __version__
    from scex_sumo.behaviors.registry import parse_models
    from scex_sumo.extrapolation.extrapolate import extrapolate
    from scex_sumo.results.provenance import digest
    from scex_sumo.results.run import open_run

    if (Path(out) / "run.json").is_file() and not overwrite:
        found = open_run(out)
        wanted: Mapping[str, Any] = {
            "scex_sumo": __version__,
            "models": [{"model": str(s), "weight": s.weight} for s in parse_models(models)],
            "children": len(all_assignments([len(parse_models(models))] * scene.vehicles)),
            "assign": {},
            "preset": preset,
            "seed": seed,
        }
        same_scene = found.info["seed_scene"]["fingerprint"] == digest(scene)
        if same_scene and all(found.info.get(k) == v for k, v in wanted.items()):
            return found
    return extrapolate(
        scene,
        models=models,
        children="all",
        preset=preset,
        seed=seed,
        world="checked",
        workers=workers,
        out=out,
        overwrite=overwrite,
        command=command,
        progress=progress,
    )


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
