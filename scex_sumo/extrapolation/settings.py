"""Settings of a run, checked: all that decides on its values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, TypeAlias

from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.registry import DEFAULT_MODELS, ModelSpec, is_own, parse_models
from scex_sumo.metrics.evaluate import PAPER_PRESET
from scex_sumo.metrics.registry import (
    COLUMNS,
    Metric,
    column_named,
    columns_of,
    describe_metrics,
    metrics_named,
)
from scex_sumo.results.region import EVERYWHERE, Region
from scex_sumo.statistics.bands import check_band
from scex_sumo.statistics.designs import DEFAULT_DESIGN, check_design
from scex_sumo.world.base import DEFAULT_WORLD, WORLDS

MAX_CHILDREN, MAX_STEPS, MAX_STATES = 100_000, 6_000, 2 * 10**8
"""Limits: children, steps of each (ten minutes), states of all vehicles in all steps."""

Models: TypeAlias = str | Sequence[str | ModelSpec]

RUN_PRESETS: Final = {"paper": ("paper",), "path": ("path",), "both": ("paper", "path")}
"""Sets of metrics that a run evaluates."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RunSettings:
    """All that decides on the values of a run, except the seed scene.

    Attributes:
        models: models to draw from, ``name[:parameter=value]...[@weight]``, comma-separated or a list.
        assign: model by track id for vehicles that are not drawn; a user's model is under test.
        under_test: model by track id for vehicles that are measured apart as well; None: as drawn.
        baseline: run every child again without the models under test.
        children: number, or ``"all"`` for every combination; 385, as in the paper, gives a 95 % interval of
            +-5 % around a share of one half.
        design: how assignments are drawn, one of `scex_sumo.statistics.designs.DESIGNS`.
        until_band: half-width of the widest 95 % band at which the run ends; ``children`` is then the
            maximum.
        steps: of 0.1 s per child.
        replan: steps between plans, 1 to 30.
        seed: the same seed gives the same result.
        world: ``sumo``; ``plain``, arrays alone, if SUMO drives no vehicle, with the same result to the bit;
            ``checked``, arrays compared with SUMO in two children of each batch; or an entry point in
            ``scex_sumo.worlds``.
        preset: ``paper`` for the paper's six metrics, ``path`` for those along planned paths and between
            outlines, ``both``.
        metrics: names, import paths, metrics or presets in the place of the preset's.
        thresholds: by metric column, on top of the defaults.
        reflect: separate values that many children share, and reflect densities at 0 if no value is negative;
            False gives the paper's plain kernel.
        region: only pairs with a vehicle inside count; all vehicles are simulated.
        keep_plans: write ``plans.parquet``, from which gap times can be evaluated again.

    Raises:
        UsageError: a setting makes no sense.
    """

    models: Models = DEFAULT_MODELS
    assign: Mapping[int, str] = field(default_factory=dict)
    under_test: Mapping[int, str | None] = field(default_factory=dict)
    baseline: bool = True
    children: int | str = 385
    design: str = DEFAULT_DESIGN
    until_band: float | None = None
    steps: int = 30
    replan: int = 5
    seed: int = 0
    world: str = DEFAULT_WORLD
    preset: str = "both"
    metrics: Sequence[str | Metric] | None = None
    thresholds: Mapping[str, float] = field(default_factory=dict)
    reflect: bool = True
    keep_plans: bool = False
    region: Region = EVERYWHERE

    def __post_init__(self) -> None:
        if self.steps < 1:
            raise UsageError(f"--steps: got {self.steps}, needs at least 1")
        if self.steps > MAX_STEPS:
            raise UsageError(f"--steps: got {self.steps:,}, at most {MAX_STEPS:,} are run")
        if not 1 <= self.replan <= PLAN_STEPS:
            raise UsageError(
                f"--replan: got {self.replan}, needs 1 to {PLAN_STEPS} (models plan {PLAN_STEPS} steps)"
            )
        if self.world not in WORLDS:
            raise UsageError(f"--world: got {self.world!r}, needs {', '.join(WORLDS.paths)}")
        if self.seed < 0:
            raise UsageError(f"--seed: got {self.seed}, needs 0 or more")
        self._put_under_test()
        if not self.drawn:
            raise UsageError("--models: names no model")
        if not any(spec.weight > 0 for spec in self.drawn):
            raise UsageError("--models: all weights are 0; give at least one model a positive weight")
        if self.count is not None and self.count < 1:
            raise UsageError(f"--children: got {self.count}, needs at least 1 (or 'all')")
        if self.count is not None and self.count > MAX_CHILDREN:
            raise UsageError(f"--children: got {self.count:,}, at most {MAX_CHILDREN:,} are run")
        check_design(self.design)
        if self.until_band is not None:
            check_band(self.until_band)
            if self.count is None:
                raise UsageError(
                    "--until-band: not possible with --children all, which leaves nothing to estimate"
                )
        if self.preset not in RUN_PRESETS:
            raise UsageError(f"--preset: unknown {self.preset!r}; known: {', '.join(RUN_PRESETS)}")
        # Workers get metrics, not names: a metric registered in this process is unknown there.
        object.__setattr__(self, "metrics", metrics_named(self.metrics or RUN_PRESETS[self.preset]))
        object.__setattr__(self, "thresholds", checked_thresholds(self.thresholds or {}, self.columns))

    def _put_under_test(self) -> None:
        assign, under_test = self.assign or {}, self.under_test or {}
        twice = sorted(set(under_test) & set(assign))
        if twice:
            raise UsageError(f"--under-test {twice[0]}: --assign names this vehicle too; give one of them")
        for text in under_test.values():
            parse_models(text or DEFAULT_MODELS)  # an error now, not after reading the scene
        own = {
            t: text for t, text in assign.items() if self.baseline and any(map(is_own, parse_models(text)))
        }
        object.__setattr__(self, "assign", {t: text for t, text in assign.items() if t not in own})
        object.__setattr__(self, "under_test", {**under_test, **own})

    @cached_property
    def drawn(self) -> tuple[ModelSpec, ...]:
        """The models to draw from."""
        entries = [self.models] if isinstance(self.models, str) else self.models
        return tuple(s for e in entries for s in (parse_models(e) if isinstance(e, str) else [e]))

    @cached_property
    def count(self) -> int | None:
        """Number of children, or with ``until_band`` the maximum; None for every combination."""
        if self.children == "all":
            return None
        try:
            return int(self.children)
        except ValueError:
            raise UsageError(f"--children: got {self.children!r}, needs a number or 'all'") from None

    def check_size(self, children: int, vehicles: int) -> None:
        """Raise a `UsageError` if the states would not fit into memory."""
        states = children * vehicles * self.steps
        if states > MAX_STATES:
            raise UsageError(
                f"{children:,} futures x {vehicles:,} vehicles x {self.steps:,} steps are {states:,} "
                f"states, at most {MAX_STATES:,} are run; ask for fewer --children or --steps"
            )

    @property
    def measured(self) -> tuple[Metric, ...]:
        """The metrics that are evaluated."""
        return metrics_named(self.metrics)

    @property
    def rule(self) -> str:
        """Car-following rule of the metrics that leave it open."""
        return "path" if self.preset == "path" else PAPER_PRESET

    @property
    def columns(self) -> tuple[str, ...]:
        """The metric columns of a child."""
        return columns_of(self.measured)

    @property
    def compared(self) -> bool:
        """Whether every child runs again without the models under test."""
        return self.baseline and any(model is not None for model in self.under_test.values())

    def to_json(self) -> dict[str, Any]:
        """Return the settings' entries of ``run.json``."""
        described = describe_metrics(self.measured)
        return {
            **({"metrics": described} if described else {}),
            "children": self.children if self.count is None else self.count,
            "steps": self.steps,
            "replan": self.replan,
            "design": self.design if self.count is not None else "all",
            "until_band": self.until_band,
            "seed": self.seed,
            **({"world": self.world} if self.world != DEFAULT_WORLD else {}),
            "preset": self.preset,
            "reflect": self.reflect,
            "keep_plans": self.keep_plans,
            **self.region.to_json(),
        }


def checked_thresholds(thresholds: Mapping[str, float], columns: Sequence[str] = COLUMNS) -> dict[str, float]:
    """Return thresholds by column; raise a `UsageError` for an unknown metric or no number."""
    found = {}
    for name, value in thresholds.items():
        try:
            column = column_named(name, columns)
        except UsageError as error:
            raise UsageError(f"--threshold: {error}") from None
        if not math.isfinite(value):
            raise UsageError(f"--threshold {column}={value}: not a finite number; give one")
        found[column] = value
    return found
