"""Settings of a run, checked: all that decides on its values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from scex_sumo.base.errors import UsageError
from scex_sumo.base.options import last_of_list, numbers_by_name, option
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.registry import DEFAULT_MODELS, ModelSpec, is_own, known_names, mixes, model_specs
from scex_sumo.metrics.evaluate import PAPER_PRESET
from scex_sumo.metrics.registry import (
    COLUMNS,
    Metric,
    column_named,
    columns_of,
    describe_metrics,
    metrics_named,
)
from scex_sumo.scene import SeedScene
from scex_sumo.statistics.designs import DEFAULT_DESIGN, check_design
from scex_sumo.world.base import DEFAULT_WORLD, WORLDS

if TYPE_CHECKING:
    from scex_sumo.results.region import Region
else:
    Region = Any  # the command line reads the fields' types, and takes a text

MAX_FUTURES, MAX_STEPS, MAX_STATES = 100_000, 6_000, 2 * 10**8
"""Limits: futures, steps of each (ten minutes), states of all vehicles in all steps."""

MAX_GROWN: Final = 10_000
"""Futures at which a run with ``until_band`` ends in any case."""

Driver: TypeAlias = Any
"""A behaviour model in a form that `model_specs` takes: text, a `ModelSpec`, a class, function or object."""
Models: TypeAlias = Driver | Sequence[Driver]

FUTURES: Final = 385
"""Futures of a run, as in the paper."""

PAPER_MIX: Final = "paper"
VRU: Final = ("none", "replay", "model")
"""What pedestrians and cyclists do: they are left out, move as recorded, or take part."""
RUN_PRESETS: Final = {"paper": ("paper",), "path": ("path",), "both": ("paper", "path")}
"""Sets of metrics that a run evaluates."""


def complete_models(incomplete: str) -> list[str]:
    """Complete the last of a list of models and mixes."""
    return last_of_list(incomplete, [*mixes(), *known_names()])


def read_assign(entries: Sequence[str], option: str = "--assign") -> dict[int, str]:
    """Read ``TRACK=MODEL`` entries of an option, each vehicle once."""
    result: dict[int, str] = {}
    for entry in entries:
        track, equals, model = entry.partition("=")
        if not equals or not model or not track.strip().lstrip("-").isdigit():
            raise UsageError(f"{option} {entry}: needs TRACK=MODEL, e.g. {option} 17=emergency_brake")
        if int(track) in result:
            raise UsageError(f"{option} {entry}: vehicle {int(track)} is given twice; give it one model")
        result[int(track)] = model
    return result


def read_under_test(entries: Sequence[str]) -> dict[int, str | None]:
    """Read ``TRACK=MODEL`` entries, or ``TRACK`` alone for a vehicle that is driven as drawn."""
    alone = [entry for entry in entries if entry.strip().isdigit()]
    models = read_assign([entry for entry in entries if entry not in alone], "--under-test")
    for entry in alone:
        if int(entry) in models:
            raise UsageError(f"--under-test {entry}: vehicle {int(entry)} is given twice; give it once")
    return {**models, **{int(entry): None for entry in alone}}


def read_thresholds(entries: Sequence[str]) -> dict[str, float]:
    """Read ``METRIC=VALUE`` entries."""
    return numbers_by_name("--threshold", entries, "METRIC=VALUE, e.g. --threshold ttc=0.5")


@dataclass(frozen=True, kw_only=True, eq=False)
class RunSettings:
    """All that decides on the values of a run, except the seed scene.

    Attributes:
        models: a list, too; an entry is text, a `ModelSpec`, or a driver's class, function or object.
        assign: by track id; an entry as of ``models``. A model of the user's is under test.
        under_test: by track id, as ``assign``; None for a vehicle that is driven as drawn.
        futures: ``"all"`` runs every combination; 385, as in the paper, gives a 95 % interval of +-5 %
            around a share of one half. With ``until_band`` it is the maximum.
        until_band: half-width of the widest 95 % band at which the run ends.
        world: ``plain`` has the same result to the bit if SUMO drives no vehicle; ``checked`` compares
            arrays with SUMO in two futures of each batch.
        metrics: names, import paths, metrics or presets in the place of the preset's.
        thresholds: by metric column, on top of the defaults.
        reflect: False gives the paper's plain kernel.
        region: in scenes of over 100 vehicles, those too far away to come near it are replayed.
        keep_plans: write ``plans.parquet``, from which gap times can be evaluated again.

    Raises:
        UsageError: a setting makes no sense.

    Example:
        >>> scex.RunSettings(futures=8, models="rules").count
        8
    """

    futures: int | str | None = option(
        "Number of futures: 385; at most 10000 with --until-band.", None, metavar="N|all", takes=str
    )
    steps: int = option("Steps of 0.1 s per future.", 30)
    replan: int = option("Steps between two plans.", 5)
    models: Models = option(
        "Models to draw from; see 'scex-sumo models'.",
        DEFAULT_MODELS,
        metavar="MODEL[@WEIGHT],...",
        takes=str,
        complete=complete_models,
    )
    assign: Mapping[int, Driver] = option(
        "A vehicle's model; repeatable.",
        factory=dict,
        metavar="TRACK=MODEL",
        several=True,
        read=read_assign,
    )
    under_test: Mapping[int, Driver | None] = option(
        "A driving function under test, measured apart; repeatable.",
        factory=dict,
        metavar="TRACK=MODEL",
        several=True,
        read=read_under_test,
    )
    design: str = option(
        "How assignments are drawn: balanced (default) or random.", DEFAULT_DESIGN, metavar="NAME", takes=str
    )
    until_band: float | None = option("Go on until all 95 % bands are within +-W.", None, metavar="W")
    region: Region | str | None = option(
        "Only pairs with a vehicle in this circle, m.", None, metavar="X,Y,R", takes=str
    )
    around: int | None = option("Only pairs with a vehicle within 30 m of this one.", None, metavar="TRACK")
    preset: str = option(
        "Metrics: the paper's, those along paths, or both (default: main ones are shown).",
        "both",
        metavar="|".join(RUN_PRESETS),
        takes=str,
    )
    metrics: str | Sequence[str | Metric] | None = option(
        "Metrics, built-in or your own; default: the preset's.", None, metavar="NAME,...", takes=str
    )
    thresholds: Mapping[str, float] = option(
        "Where a metric becomes critical; repeatable.",
        factory=dict,
        metavar="METRIC=VALUE",
        names=("--threshold",),
        several=True,
        read=read_thresholds,
    )
    reflect: bool = option("Separate shared values and reflect densities at 0.", True)
    seed: int = option("Random seed.", 0)
    world: str = option(
        "plain: without SUMO; checked: plain, compared with SUMO; or an entry point.",
        DEFAULT_WORLD,
        metavar="sumo|plain|checked|NAME",
    )
    keep_plans: bool = option("Write plans.parquet, to evaluate gap times again.", False)
    vru: str = option(
        "Pedestrians and cyclists are left out, move as recorded, or decide for themselves.",
        "replay",
        metavar="|".join(VRU),
        takes=str,
    )
    rules: bool = option("Drivers obey lights and right of way; those of the mix paper never do.", True)

    def __post_init__(self) -> None:
        self._put_region()
        if self.futures is None:
            object.__setattr__(self, "futures", FUTURES if self.until_band is None else MAX_GROWN)
        if isinstance(self.metrics, str):
            object.__setattr__(self, "metrics", [name.strip() for name in self.metrics.split(",")])
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
        if self.vru not in VRU:
            raise UsageError(f"--vru: got {self.vru!r}, needs {', '.join(VRU)}")
        self._put_under_test()
        if not self.drawn:
            raise UsageError("--models: names no model")
        if not any(spec.weight > 0 for spec in self.drawn):
            raise UsageError("--models: all weights are 0; give at least one model a positive weight")
        if self.count is not None and self.count < 1:
            raise UsageError(f"--futures: got {self.count}, needs at least 1 (or 'all')")
        if self.count is not None and self.count > MAX_FUTURES:
            raise UsageError(f"--futures: got {self.count:,}, at most {MAX_FUTURES:,} are run")
        check_design(self.design)
        if self.until_band is not None:
            if not 0 < self.until_band < 1:
                raise UsageError(
                    f"--until-band: got {self.until_band}, needs to be between 0 and 1, e.g. 0.05"
                )
            if self.count is None:
                raise UsageError(
                    "--until-band: not possible with --futures all, which leaves nothing to estimate"
                )
        if self.preset not in RUN_PRESETS:
            raise UsageError(f"--preset: unknown {self.preset!r}; known: {', '.join(RUN_PRESETS)}")
        # Workers get metrics, not names: a metric registered in this process is unknown there.
        object.__setattr__(self, "metrics", metrics_named(self.metrics or RUN_PRESETS[self.preset]))
        object.__setattr__(self, "thresholds", checked_thresholds(self.thresholds or {}, self.columns))

    def _put_region(self) -> None:
        if isinstance(self.region, str) or self.around is not None:
            from scex_sumo.results.region import region_of

            object.__setattr__(self, "region", region_of(self.region, self.around))
            object.__setattr__(self, "around", None)

    @property
    def within(self) -> Region | None:
        """The region in which pairs count; None for everywhere."""
        assert not isinstance(self.region, str)
        return self.region

    def vehicles_that_count(self, scene: SeedScene) -> tuple[int, ...] | None:
        """Return the indices of the vehicles whose pairs count; None for all."""
        inside = None if self.within is None else self.within.vehicles(scene)
        if scene.people is None:
            return inside
        drivers = np.flatnonzero(~scene.people)
        return tuple((drivers if inside is None else np.intersect1d(drivers, inside)).tolist())

    def _put_under_test(self) -> None:
        assign, under_test = self.assign or {}, self.under_test or {}
        twice = sorted(set(under_test) & set(assign))
        if twice:
            raise UsageError(f"--under-test {twice[0]}: --assign names this vehicle too; give one of them")
        for given in under_test.values():
            model_specs(given or DEFAULT_MODELS)  # an error now, not after reading the scene
        own = {track: given for track, given in assign.items() if any(map(is_own, model_specs(given)))}
        object.__setattr__(self, "assign", {t: given for t, given in assign.items() if t not in own})
        object.__setattr__(self, "under_test", {**under_test, **own})

    @cached_property
    def drawn(self) -> tuple[ModelSpec, ...]:
        """The models to draw from."""
        return model_specs(self.models)

    @property
    def obeys(self) -> bool:
        """Whether drivers obey the rules of the road; those of the paper's mix do not."""
        named = self.models.split(",") if isinstance(self.models, str) else ()
        return self.rules and PAPER_MIX not in [name.strip() for name in named]

    @cached_property
    def count(self) -> int | None:
        """Number of futures, or with ``until_band`` the maximum; None for every combination."""
        if self.futures == "all":
            return None
        try:
            return None if self.futures is None else int(self.futures)
        except ValueError:
            raise UsageError(f"--futures: got {self.futures!r}, needs a number or 'all'") from None

    def check_size(self, futures: int, vehicles: int) -> None:
        """Raise a `UsageError` if the states would not fit into memory."""
        states = futures * vehicles * self.steps
        if states > MAX_STATES:
            raise UsageError(
                f"{futures:,} futures x {vehicles:,} vehicles x {self.steps:,} steps are {states:,} "
                f"states, at most {MAX_STATES:,} are run; ask for fewer --futures or --steps"
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
        """The metric columns of a future."""
        return columns_of(self.measured)

    def to_json(self) -> dict[str, Any]:
        """Return the settings' entries of ``run.json``."""
        described = describe_metrics(self.measured)
        return {
            **({"metrics": described} if described else {}),
            "futures": self.futures if self.count is None else self.count,
            "steps": self.steps,
            "replan": self.replan,
            "design": self.design if self.count is not None else "all",
            "until_band": self.until_band,
            "seed": self.seed,
            **({} if self.obeys else {"rules": False}),
            **({"vru": self.vru} if self.vru != "replay" else {}),
            **({"world": self.world} if self.world != DEFAULT_WORLD else {}),
            "preset": self.preset,
            "reflect": self.reflect,
            "keep_plans": self.keep_plans,
            **({} if self.within is None else self.within.to_json()),
        }


def checked_thresholds(thresholds: Mapping[str, float], columns: Sequence[str] = COLUMNS) -> dict[str, float]:
    """Return thresholds by column; raise a `UsageError` for an unknown metric or no number."""
    checked = {}
    for name, value in thresholds.items():
        try:
            column = column_named(name, columns)
        except UsageError as error:
            raise UsageError(f"--threshold: {error}") from None
        if not math.isfinite(value):
            raise UsageError(f"--threshold {column}={value}: not a finite number; give one")
        checked[column] = value
    return checked
