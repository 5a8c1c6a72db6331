"""Settings of a run, checked: all that decides on its values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from scex_sumo.base.errors import UsageError
from scex_sumo.base.options import number_or_name, option
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.drivers.registry import DEFAULT_MODELS, ModelSpec, is_own, model_specs
from scex_sumo.metrics.registry import BOTH, Metric, column_named, columns_of, describe_metrics, metrics_asked
from scex_sumo.scene import SeedScene
from scex_sumo.world.base import DEFAULT_WORLD, WORLDS

if TYPE_CHECKING:
    from scex_sumo.results.region import Region
else:
    Region = Any  # the command line reads the fields' types, and takes a text

MAX_FUTURES, MAX_STEPS, MAX_STATES = 100_000, 6_000, 2 * 10**8
"""Limits: futures, steps of each (ten minutes), states of all vehicles in all steps."""

Driver: TypeAlias = Any
"""A behaviour model in a form that `model_specs` takes: text, a `ModelSpec`, a class, function or object."""
Models: TypeAlias = Driver | Sequence[Driver]

FUTURES: Final = 385
"""Futures of a run, as in the paper."""

PAPER_MIX: Final = "paper"
VRU: Final = ("none", "replay", "model")
"""What pedestrians and cyclists do: they are left out, move as recorded, or take part."""
DRIVERS: Final = "Futures and drivers"
PEOPLE: Final = "People"
MEASURES: Final = "Metrics"
"""Groups of the options in the help."""


def read_assign(
    entries: Sequence[str], option: str = "--assign", alone: bool = False
) -> dict[int | str, str | None]:
    """Read ``TRACK=MODEL`` entries of an option, each vehicle once; a track id, or SUMO's name.

    ``TRACK`` may stand ``alone``, for a vehicle that is driven as drawn: None.
    """
    result: dict[int | str, str | None] = {}
    for entry in entries:
        track, equals, model = entry.partition("=")
        if not track.strip() or not (model or (alone and not equals)):
            raise UsageError(f"{option} {entry}: needs TRACK=MODEL, e.g. {option} 17=emergency_brake")
        if number_or_name(track) in result:
            raise UsageError(f"{option} {entry}: vehicle {track} is given twice; give it one model")
        result[number_or_name(track)] = model or None
    return result


read_under_test = partial(read_assign, option="--under-test", alone=True)


def read_thresholds(entries: Sequence[str]) -> dict[str, float]:
    """Read ``METRIC=VALUE`` entries."""
    numbers = {}
    for entry in entries:
        name, _, number = (word.strip() for word in entry.rpartition("="))
        try:
            numbers[name] = float(number)
        except ValueError:
            name = ""
        if not name:
            raise UsageError(f"--threshold {entry}: needs METRIC=VALUE, e.g. --threshold ttc=0.5")
    return numbers


@dataclass(frozen=True, kw_only=True, eq=False)
class RunSettings:
    """All that decides on the values of a run, except the seed scene.

    Attributes:
        models: a list, too; an entry is text, a `ModelSpec`, or a driver's class, function or object.
        assign: by track id or SUMO's name; an entry as of ``models``. A model of the user's is under test.
        under_test: by track id, as ``assign``; None for a vehicle that is driven as drawn.
        futures: ``"all"`` runs every combination; 385, as in the paper, gives a 95 % interval of
            at most +-5 %.
        world: ``plain`` has the same result to the bit if SUMO drives no vehicle.
        metrics: names, import paths, metrics, or sets of them: ``paper``, ``path``, ``both``.
        thresholds: by metric column, on top of the defaults.
        region: also the text ``X,Y,R``, or a track id. In scenes of over 100 vehicles, those too far away to
            come near it are replayed.
        rules: drivers obey lights and right of way; those of the mix ``paper`` never do.

    Raises:
        UsageError: a setting makes no sense.

    Example:
        >>> scex.RunSettings(futures=8, models="rules").count
        8
    """

    futures: int | str = option(
        "Number of futures (default: 385), or all assignments of a small scene.",
        FUTURES,
        metavar="N|all",
        panel=DRIVERS,
        takes=str,
    )
    steps: int = option("Steps of 0.1 s per future.", 30, panel=DRIVERS)
    replan: int = option("Steps between two plans.", 5, panel=DRIVERS)
    models: Models = option(
        "Models to draw from; see 'scex-sumo models'.",
        DEFAULT_MODELS,
        metavar="MODEL[@WEIGHT],...",
        panel=DRIVERS,
        takes=str,
    )
    assign: Mapping[Any, Driver] = option(
        "A vehicle's model; repeatable.",
        factory=dict,
        metavar="TRACK=MODEL",
        panel=DRIVERS,
        several=True,
        read=read_assign,
    )
    under_test: Mapping[Any, Driver | None] = option(
        "A driving function under test, measured apart; repeatable.",
        factory=dict,
        metavar="TRACK=MODEL",
        panel=DRIVERS,
        several=True,
        read=read_under_test,
    )
    region: Region | str | int | None = option(
        "Only pairs with a vehicle in this circle, or within 30 m of this vehicle, m.",
        None,
        metavar="X,Y,R|TRACK",
        panel=MEASURES,
        takes=str,
    )
    metrics: str | Sequence[str | Metric] = option(
        "The paper's, those along paths, both (default; main ones are shown), or single ones.",
        BOTH,
        metavar="paper|path|both|conflicts|NAME,...",
        names=("--metrics", "--preset"),
        panel=MEASURES,
        takes=str,
    )
    thresholds: Mapping[str, float] = option(
        "Where a metric becomes critical; repeatable.",
        factory=dict,
        metavar="METRIC=VALUE",
        names=("--threshold",),
        panel=MEASURES,
        several=True,
        read=read_thresholds,
    )
    seed: int = option("Random seed.", 0, panel=DRIVERS)
    world: str = option(
        "plain: without SUMO; or an entry point.", DEFAULT_WORLD, metavar="sumo|plain|NAME", panel=DRIVERS
    )
    vru: str = option(
        "Pedestrians and cyclists are left out, move as recorded, or decide for themselves.",
        "replay",
        metavar="|".join(VRU),
        panel=PEOPLE,
        takes=str,
    )
    rules: bool = True

    def __post_init__(self) -> None:
        if isinstance(self.region, str | int):
            from scex_sumo.results.region import region_of

            object.__setattr__(self, "region", region_of(self.region))
        self._put_under_test()
        futures = 1 if self.count is None else self.count
        _check_range("--futures", futures, MAX_FUTURES, " (or 'all')")
        _check_range("--steps", self.steps, MAX_STEPS)
        _check_range("--replan", self.replan, PLAN_STEPS, f" (models plan {PLAN_STEPS} steps)")
        if self.seed < 0:
            raise UsageError(f"--seed: got {self.seed}, needs 0 or more")
        if self.world not in WORLDS:
            raise UsageError(f"--world: got {self.world!r}, needs {', '.join(WORLDS.paths)}")
        if self.vru not in VRU:
            raise UsageError(f"--vru: got {self.vru!r}, needs {', '.join(VRU)}")
        if not self.drawn:
            raise UsageError("--models: names no model")
        if not any(spec.weight > 0 for spec in self.drawn):
            raise UsageError("--models: all weights are 0; give at least one model a positive weight")
        # Workers get metrics, not names: a metric registered in this process is unknown there.
        object.__setattr__(self, "metrics", metrics_asked(self.metrics))
        object.__setattr__(self, "thresholds", checked_thresholds(self.thresholds or {}, self.columns))

    @property
    def within(self) -> Region | None:
        """The region in which pairs count; None for everywhere."""
        assert not isinstance(self.region, str | int)
        return self.region

    def numbered(self, scene: SeedScene) -> RunSettings:
        """Return settings that name vehicles by track ids only.

        Raises:
            UsageError: the scene has no vehicle of a name.
        """
        assign = {scene.track_of(name, "--assign"): given for name, given in self.assign.items()}
        tested = {scene.track_of(name, "--under-test"): given for name, given in self.under_test.items()}
        if {*assign} == {*self.assign} and {*tested} == {*self.under_test}:
            return self
        return replace(self, assign=assign, under_test=tested)

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
        """Number of futures; None for every combination."""
        if self.futures == "all":
            return None
        try:
            return int(self.futures)
        except ValueError:
            raise UsageError(f"--futures: got {self.futures!r}, needs a number or 'all'") from None

    @property
    def design(self) -> str:
        """How assignments are drawn: ``balanced``, or ``all`` of them."""
        return "all" if self.count is None else "balanced"

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
        return metrics_asked(self.metrics)

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
            "design": self.design,
            "seed": self.seed,
            **({} if self.obeys else {"rules": False}),
            **({"vru": self.vru} if self.vru != "replay" else {}),
            **({"world": self.world} if self.world != DEFAULT_WORLD else {}),
            **({} if self.within is None else self.within.to_json()),
        }


def _check_range(option: str, value: int, most: int, why: str = "") -> None:
    if not 1 <= value <= most:
        raise UsageError(f"{option}: got {value:,}, needs 1 to {most:,}{why}")


def checked_thresholds(thresholds: Mapping[str, float], columns: Sequence[str]) -> dict[str, float]:
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
