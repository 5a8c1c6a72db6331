"""Job of a worker: batches of children of a run, one world per process."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.models.sumo_driver import SumoDriver
from scex_sumo.converters.net.sumo_net import SumoNet
from scex_sumo.errors import ScexError
from scex_sumo.evaluation.outcomes import collisions_table, encounter_rows
from scex_sumo.extrapolation.assignments import child_generator, route_draws
from scex_sumo.extrapolation.fallbacks import fallbacks_table
from scex_sumo.extrapolation.measure import measure_outcome, measure_rollout, worst_of
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.rollout import Cast, Rollout, roll_out
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.extrapolation.situations import sight_of
from scex_sumo.results.design import design_intervals
from scex_sumo.results.parts import Part, save_part
from scex_sumo.road import Road
from scex_sumo.scene import LOGGED_HISTORY, SeedScene
from scex_sumo.statistics.intervals import DesignIntervals
from scex_sumo.world.base import World
from scex_sumo.world.checked import CheckedWorld
from scex_sumo.world.gui.colors import model_colors
from scex_sumo.world.plain import PlainWorld
from scex_sumo.world.sumo import TILE_SLOTS, SumoDriven, SumoWorld

OnStep = Callable[[int], None]

VEHICLES_AT_ONCE = 6000  # in a batch, over all its children
SAMPLE = 2  # children of a batch in a checked world that SUMO holds, too
BATCHES_EACH = 2  # of each of several processes, at least: whoever starts later does less
REFERENCE_CHILDREN = 430  # whom models of ours without networks drive as fast as a reference is run


@dataclass(frozen=True, eq=False)
class Job:
    """Everything that a worker needs to run any child of a run.

    Attributes:
        scene: the seed scene, with its road.
        net: the road as a SUMO net.
        settings: the run's.
        models: its models.
        assignment: (C, V) index into ``models``, for all children of the run.
        folder: the result folder.
        gui: show the run live in sumo-gui.
        counted: (T, V) steps in which a vehicle counts in metrics; None: all.
        compared: whether a checked world is compared with SUMO's; if not, it has been elsewhere.
    """

    scene: SeedScene
    net: SumoNet
    settings: RunSettings
    models: ModelSet
    assignment: IntArray
    folder: Path
    gui: bool = False
    counted: BoolArray | None = None
    compared: bool = True

    @property
    def road(self) -> Road:
        """The map of the seed scene."""
        assert self.scene.road is not None
        return self.scene.road

    def of(self, children: int) -> Job:
        """The same job for so many children."""
        settings, ids = self.settings, self.scene.track_ids
        drawn = self.models.draw(ids, children=children, seed=settings.seed, design=settings.design)
        return replace(self, assignment=drawn)

    @cached_property
    def intervals(self) -> DesignIntervals:
        """Of shares and distributions over the children."""
        drawn, fixed = self.models.drawn, np.isin(self.scene.track_ids, list(self.models.fixed))
        design = self.settings.to_json()["design"]
        return design_intervals(self.assignment, [spec.weight for spec in drawn], fixed, design)

    @property
    def apart(self) -> bool:
        """Whether each child needs a tile of its own: a driver of SUMO's, or who watches, sees all in it."""
        return self.gui or any(isinstance(model, SumoDriver) for model in self.models.built)

    @property
    def is_quick(self) -> bool:
        """Whether all models are ours, and none is a network."""
        return not self.models.weights and None not in map(sight_of, self.models.built)

    @property
    def world(self) -> str:
        """As the settings have it; SUMO's where only that does, arrays alone where nothing is compared."""
        if self.settings.world != "checked":
            return self.settings.world
        return "sumo" if self.apart else "checked" if self.compared else "plain"

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


def batch_size(job: Job, *, processes: int = 1, occupied: int = 0) -> int:
    """Children in a batch: fewer the more vehicles a child has; two batches for each of several processes.

    A step of a batch costs as much for one vehicle as for some hundreds; beyond some thousands nothing is
    gained and memory is lost.

    Args:
        job: the run.
        processes: that share its children.
        occupied: how many of these are at a reference first; where that is to take them longer than the
            children take the others, it is not cut into batches for them.
    """
    if job.apart:
        return TILE_SLOTS
    children, vehicles = (int(count) for count in job.assignment.shape)
    if children <= REFERENCE_CHILDREN * (processes - 1) and job.is_quick:
        processes -= occupied
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
    with sumo_of(job, slots) as world:
        yield partial(_run_and_keep, job, world)


@contextmanager
def sumo_of(job: Job, slots: Sequence[int]) -> Iterator[SumoWorld | None]:
    """SUMO's world of a job, for `run_batch`; None where arrays do.

    Args:
        job: the run.
        slots: the tile slots of all children that may come.
    """
    if job.world == "plain":
        yield None
        return
    names = job.models.names
    legend = tuple(zip(names, model_colors(names), strict=True))
    with SumoWorld(job.net, job.scene, slots=slots, gui=job.gui, legend=legend) as world:
        yield world


def parts_in_memory(job: Job, children: Sequence[int]) -> list[Part]:
    """Children of a job, run in this process and kept nowhere."""
    batches = batches_of(children, batch_size(job), apart=job.apart)
    slots = sorted({int(slot) for batch in batches for slot in job.slots(batch)})
    with sumo_of(job, slots) as world:
        return [run_batch(job, world, batch) for batch in batches]


def _run_and_keep(job: Job, world: SumoWorld | None, children: IntArray, on_step: OnStep) -> IntArray:
    save_part(job.folder, run_batch(job, world, children, on_step=on_step))
    return children


def run_batch(job: Job, sumo: SumoWorld | None, children: IntArray, *, on_step: OnStep | None = None) -> Part:
    """Run some children side by side, in SUMO's world or in the plain one, see `sumo_of`; measure them."""
    cast, settings = _cast(job, children), job.settings
    world = _begun(job, sumo, cast)
    rollout = roll_out(
        world, job.road, job.scene, cast, steps=settings.steps, replan=settings.replan, on_step=on_step
    )
    found = measure_outcome(
        job.scene, rollout, metrics=settings.measured, preset=settings.rule, counted=job.counted
    )
    values, hits = found.values, found.collisions
    ids = job.scene.track_ids
    return Part(
        children=children,
        states=rollout.states,
        values=values.values,
        defined=values.defined,
        worst=worst_of(job.scene, values, children, hits),
        plan_x=rollout.plan_x if settings.keep_plans else None,
        plan_y=rollout.plan_y if settings.keep_plans else None,
        fallbacks=fallbacks_table(
            rollout.replaced,
            children=children,
            assignment=cast.assignment,
            names=cast.names,
            track_ids=ids,
        ),
        tested=_tested(job, rollout),
        collisions=collisions_table(hits, children=children, track_ids=ids, first=LOGGED_HISTORY),
        encounters=encounter_rows(found.encounters, children),
    )


def _begun(job: Job, sumo: SumoWorld | None, cast: Cast) -> World:
    """The world of a batch, set to the seed scene."""
    count = len(cast.children)
    plain = PlainWorld(count, job.scene.vehicles, length=job.scene.length)
    if sumo is None:
        return plain
    if job.world == "checked":
        sample = min(SAMPLE, count)
        sumo.begin(job.scene.now.repeat(sample), job.slots(cast.children[:sample]))
        return CheckedWorld(plain, sumo, sample)
    sumo.begin(job.scene.now.repeat(count), job.slots(cast.children), _driven_by_sumo(job, cast))
    if job.gui:
        _paint(sumo, cast)
    return sumo


def _tested(job: Job, rollout: Rollout) -> FloatArray | None:
    """(2, C, M) metric values of the vehicles under test alone, and 1 where they are defined."""
    tested = np.flatnonzero(np.isin(job.scene.track_ids, list(job.models.tested))).tolist()
    if not tested:
        return None
    own = measure_rollout(
        job.scene, rollout, metrics=job.settings.measured, preset=job.settings.rule, vehicles=tested
    )
    return np.stack([own.values, own.defined.astype(np.float64)])


def _cast(job: Job, children: IntArray) -> Cast:
    seed, built = job.settings.seed, job.models.built
    return Cast(
        children=children,
        assignment=job.assignment[children],
        models=built,
        names=job.models.names,
        overridden=np.array([not isinstance(model, SumoDriver) for model in built]),
        route_draw=route_draws(children, job.scene.vehicles, seed=seed),
        generators=[child_generator(seed, int(c)) for c in children],
    )


def _driven_by_sumo(job: Job, cast: Cast) -> list[SumoDriven]:
    """Vehicles that SUMO's own models drive, each with a route found for it."""
    driven = []
    for index, model in enumerate(cast.models):
        if not isinstance(model, SumoDriver):
            continue
        child, vehicle = np.nonzero(cast.assignment == index)
        routes = model.routes(job.scene, job.road, vehicle, cast.route_draw[child, vehicle])
        for c, v, lanes in zip(child.tolist(), vehicle.tolist(), routes, strict=True):
            edges = job.net.lanes.edges(lanes)
            if not edges:
                raise ScexError(
                    f"{cast.names[index]}: vehicle {job.scene.track_ids[v]} is not on a mapped lane, "
                    "so SUMO cannot drive it; give it another model with --assign"
                )
            driven.append(
                SumoDriven(
                    child=c, vehicle=v, model=model.model, parameters=model.parameters, edges=tuple(edges)
                )
            )
    return driven


def _paint(world: SumoWorld, cast: Cast) -> None:
    """Each vehicle in the color of its model."""
    colors = model_colors(cast.names)
    for (child, vehicle), model in np.ndenumerate(cast.assignment):
        world.color(child, vehicle, colors[model])
