"""What is asked of an extrapolation, checked, and with its drivers made."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

from scex_sumo.arrays import IntArray
from scex_sumo.behaviors.base import Behavior
from scex_sumo.converters.net.convert import SumoNet
from scex_sumo.errors import UsageError
from scex_sumo.extrapolation.casting import (
    Casting,
    Models,
    cast_models,
    draw_assignments,
    drivers,
    number_of_children,
    put_under_test,
    sources_of,
    weights_of,
)
from scex_sumo.extrapolation.job import Job
from scex_sumo.extrapolation.workers import Workers
from scex_sumo.metrics.evaluate import PAPER_PRESET
from scex_sumo.scene import SeedScene
from scex_sumo.statistics.bands import check_band
from scex_sumo.world.colors import model_colors

MAX_REPLAN = 30  # models plan at least 30 steps

Progress: TypeAlias = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Request:
    """The arguments of `scex_sumo.extrapolate`, where they are described."""

    scene: SeedScene
    models: Models
    children: int | str
    assign: Mapping[int, str]
    under_test: Mapping[int, str | None]
    baseline: bool
    steps: int
    replan: int
    design: str
    until_band: float | None
    seed: int
    workers: int | Workers
    batch: int | None
    out: str | Path | None
    overwrite: bool
    keep_plans: bool
    gui: bool
    thresholds: Mapping[str, float]
    command: Sequence[str] | None
    progress: Progress | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Prepared:
    """A request that makes sense.

    Attributes:
        request: as it came.
        casting: its models.
        drivers: the models themselves, by index.
        assign: model by track id of vehicles that are not drawn.
        tested: model by track id of vehicles under test; None where one is driven as drawn.
        most: number of children, with ``until_band`` the largest; None for every combination.
    """

    request: Request
    casting: Casting
    drivers: tuple[Behavior, ...]
    assign: dict[int, str]
    tested: dict[int, str | None]
    most: int | None

    @property
    def compared(self) -> bool:
        """Whether every child runs a second time, without the models under test."""
        return self.request.baseline and any(model is not None for model in self.tested.values())

    @cached_property
    def weights(self) -> dict[str, str]:
        """SHA-256 of the weights of each learned model, by its name."""
        return weights_of(self.casting, self.drivers)

    def draw(self, children: int | None) -> IntArray:
        """(C, V) model of every vehicle in each of so many children."""
        request = self.request
        return draw_assignments(
            self.casting,
            request.scene.track_ids,
            children=children,
            seed=request.seed,
            design=request.design,
        )

    def first_draw(self) -> IntArray:
        """(C, V) all children; one, where their number will show."""
        return self.draw(self.most if self.request.until_band is None else 1)

    def settings(self, assignment: IntArray) -> dict[str, Any]:
        """All that decides on the result, but for the seed scene, as ``run.json`` has it.

        Args:
            assignment: the first draw.
        """
        request, names = self.request, self.casting.names
        return {
            "models": [{"model": str(s), "weight": s.weight} for s in self.casting.drawn],
            "weights": self.weights,
            "sources": sources_of(self.casting, self.drivers),
            "assign": {str(t): names[m] for t, m in sorted(self.casting.fixed.items())},
            "under_test": {str(t): model for t, model in sorted(self.tested.items())},
            "children": len(assignment) if request.until_band is None else self.most,
            "steps": request.steps,
            "replan": request.replan,
            "design": "all" if self.most is None else request.design,
            "until_band": request.until_band,
            "seed": request.seed,
            "preset": PAPER_PRESET,
            "keep_plans": request.keep_plans,
        }

    def job(self, net: SumoNet, assignment: IntArray, folder: Path) -> Job:
        """What the processes get to know.

        Args:
            net: the seed scene's road.
            assignment: (C, V) the children.
            folder: the result folder.
        """
        request, names = self.request, self.casting.names
        tracks = request.scene.track_ids.tolist()
        return Job(
            scene=request.scene,
            net=net,
            models=self.drivers,
            names=names,
            colors=model_colors(names),
            assignment=assignment,
            seed=request.seed,
            steps=request.steps,
            replan=request.replan,
            folder=folder,
            keep_plans=request.keep_plans,
            gui=request.gui,
            tested=tuple(v for v, track in enumerate(tracks) if track in self.tested),
        )


def prepare(request: Request) -> Prepared:
    """Check a request and make its drivers.

    Raises:
        UsageError: an argument that makes no sense.
    """
    _check(request)
    assign, tested = put_under_test(request.assign, request.under_test, own=request.baseline)
    casting, most = cast_models(request.models, assign, tested), number_of_children(request.children)
    if request.until_band is not None:
        check_band(request.until_band)
        if most is None:
            raise UsageError(
                "--until-band: all combinations leave nothing to estimate; give no --children all"
            )
    return Prepared(
        request=request, casting=casting, drivers=drivers(casting), assign=assign, tested=tested, most=most
    )


def _check(request: Request) -> None:
    steps, replan, batch, workers = request.steps, request.replan, request.batch, request.workers
    if request.scene.road is None:
        raise UsageError("the seed scene has no road; read it with scex_sumo.read_seed(map, tracks=...)")
    if steps < 1:
        raise UsageError(f"--steps: got {steps}, needs at least 1")
    if not 1 <= replan <= MAX_REPLAN:
        raise UsageError(f"--replan: got {replan}, needs 1 to {MAX_REPLAN} (models plan {MAX_REPLAN} steps)")
    if request.seed < 0:
        raise UsageError(f"--seed: got {request.seed}, needs 0 or more")
    if isinstance(workers, int) and workers < 1:
        raise UsageError(f"--workers: got {workers}, needs at least 1")
    if batch is not None and batch < 1:
        raise UsageError(f"--batch: got {batch}, needs at least 1")
