"""The part of a run that a worker does: batches of children, one world per process."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.behaviors.base import Behavior
from scex_sumo.behaviors.models.sumo_driver import SumoDriver
from scex_sumo.converters.net.convert import SumoNet
from scex_sumo.errors import ScexError
from scex_sumo.extrapolation.assignments import child_generator, route_draws
from scex_sumo.extrapolation.fallbacks import fallbacks_table
from scex_sumo.extrapolation.measure import measure_rollout, worst_of
from scex_sumo.extrapolation.rollout import Cast, Rollout, roll_out
from scex_sumo.results.folder import Part, save_part
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene
from scex_sumo.world.sumo import TILE_SLOTS, SumoDriven, SumoWorld

OnStep = Callable[[int], None]

VEHICLES_AT_ONCE = 2400  # in a batch, over all its children
BATCHES_EACH = 2  # of each of several processes, at least: whoever starts later does less


@dataclass(frozen=True, kw_only=True, eq=False)
class Job:
    """Everything that a worker needs to run any child of a run.

    Attributes:
        scene: the seed scene, with its road.
        net: the road as a SUMO net.
        models: the behaviour models, by index.
        names: what the user calls them.
        colors: (M,) RGB of each model in sumo-gui, 0 to 255.
        assignment: (C, V) index into ``models``, for all children of the run.
        seed: the run's seed.
        steps: steps per child.
        replan: steps between plans.
        folder: the result folder.
        keep_plans: plans are part of the result.
        gui: show the run live in sumo-gui.
        tested: vehicles (indices) whose own pairs are measured apart.
    """

    scene: SeedScene
    net: SumoNet
    models: tuple[Behavior, ...]
    names: tuple[str, ...]
    colors: tuple[tuple[int, int, int], ...]
    assignment: IntArray
    seed: int
    steps: int
    replan: int
    folder: Path
    keep_plans: bool = True
    gui: bool = False
    tested: tuple[int, ...] = ()

    @property
    def road(self) -> Road:
        """The map of the seed scene."""
        assert self.scene.road is not None
        return self.scene.road

    @property
    def apart(self) -> bool:
        """Whether each child needs a tile of its own: a driver of SUMO's, or who watches, sees all in it."""
        return self.gui or any(isinstance(model, SumoDriver) for model in self.models)

    def slots(self, children: IntArray) -> IntArray:
        """(C,) tile slot of each child: its own, or that of all."""
        return children % TILE_SLOTS if self.apart else np.zeros_like(children)


def batches_of(children: Sequence[int], size: int, *, apart: bool = True) -> list[IntArray]:
    """Cut children into batches of at most ``size``; ``apart``: children of a batch differ in their slots."""
    batches: list[list[int]] = []
    taken: set[int] = set()
    for child in children:
        slot = child % TILE_SLOTS
        if not batches or len(batches[-1]) >= size or (apart and slot in taken):
            batches.append([])
            taken = set()
        batches[-1].append(child)
        taken.add(slot)
    return [np.asarray(batch, dtype=np.int64) for batch in batches]


def batch_size(job: Job, *, processes: int = 1) -> int:
    """Children in a batch: fewer the more vehicles a child has; two batches for each of several processes.

    A step of a batch costs as much for one vehicle as for some hundreds; beyond some thousands nothing is
    gained and memory is lost.
    """
    if job.apart:
        return TILE_SLOTS
    children, vehicles = (int(count) for count in job.assignment.shape)
    rounds = processes if processes == 1 else BATCHES_EACH * processes
    batches = math.ceil(children * vehicles / VEHICLES_AT_ONCE / rounds) * rounds
    return math.ceil(children / batches)


@contextmanager
def batch_runner(job: Job, slots: Sequence[int]) -> Iterator[Callable[[IntArray, OnStep], IntArray]]:
    """World of a job, with the function that runs a batch in it and keeps its part in the result folder.

    Args:
        job: the run.
        slots: the tile slots of all children that may come.

    Yields:
        The function, of the children's numbers and of what is called with a number of children when they
        have made a step; it returns the children.
    """
    legend = tuple(zip(job.names, job.colors, strict=True))
    with SumoWorld(job.net, job.scene, slots=slots, gui=job.gui, legend=legend) as world:

        def run(children: IntArray, on_step: OnStep) -> IntArray:
            save_part(job.folder, run_batch(job, world, children, on_step=on_step))
            return children

        yield run


def run_batch(job: Job, world: SumoWorld, children: IntArray, *, on_step: OnStep | None = None) -> Part:
    """Run some children side by side and measure them."""
    cast = _cast(job, children)
    start = job.scene.now.repeat(len(children))
    world.begin(start, job.slots(children), _driven_by_sumo(job, cast))
    _paint(job, world, cast)
    rollout = roll_out(world, job.road, job.scene, cast, steps=job.steps, replan=job.replan, on_step=on_step)
    values = measure_rollout(job.scene, rollout)
    return Part(
        children=children,
        states=rollout.states,
        values=values.values,
        defined=values.defined,
        worst=worst_of(job.scene, values, children),
        plan_x=rollout.plan_x if job.keep_plans else None,
        plan_y=rollout.plan_y if job.keep_plans else None,
        fallbacks=fallbacks_table(
            rollout.replaced,
            children=children,
            assignment=cast.assignment,
            names=job.names,
            track_ids=job.scene.track_ids,
        ),
        tested=_tested(job, rollout),
    )


def _tested(job: Job, rollout: Rollout) -> FloatArray | None:
    """(2, C, 12) metric values of the vehicles under test alone, and 1 where they are defined."""
    if not job.tested:
        return None
    own = measure_rollout(job.scene, rollout, vehicles=job.tested)
    return np.stack([own.values, own.defined.astype(np.float64)])


def _cast(job: Job, children: IntArray) -> Cast:
    overridden = np.array([not isinstance(m, SumoDriver) for m in job.models])
    return Cast(
        children=children,
        assignment=job.assignment[children],
        models=job.models,
        names=job.names,
        overridden=overridden,
        route_draw=route_draws(children, job.scene.vehicles, seed=job.seed),
        generators=[child_generator(job.seed, int(c)) for c in children],
    )


def _driven_by_sumo(job: Job, cast: Cast) -> list[SumoDriven]:
    """Vehicles that SUMO's own models drive, each with a route found for it."""
    driven = []
    for index, model in enumerate(job.models):
        if not isinstance(model, SumoDriver):
            continue
        child, vehicle = np.nonzero(cast.assignment == index)
        routes = model.routes(job.scene, job.road, vehicle, cast.route_draw[child, vehicle])
        for c, v, lanes in zip(child.tolist(), vehicle.tolist(), routes, strict=True):
            edges = job.net.lanes.edges(lanes)
            if not edges:
                raise ScexError(
                    f"{job.names[index]}: vehicle {job.scene.track_ids[v]} is not on a mapped lane, "
                    "so SUMO cannot drive it; give it another model with --assign"
                )
            driven.append(
                SumoDriven(
                    child=c, vehicle=v, model=model.model, parameters=model.parameters, edges=tuple(edges)
                )
            )
    return driven


def _paint(job: Job, world: SumoWorld, cast: Cast) -> None:
    if not job.gui:
        return
    for child, models in enumerate(cast.assignment):
        for vehicle, model in enumerate(models):
            world.color(child, vehicle, job.colors[model])
