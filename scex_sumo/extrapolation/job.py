"""Job of a run: batches of futures that a process simulates and measures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import ScexError
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.base import driven_by_sumo
from scex_sumo.converters.net.sumo_net import SumoNet
from scex_sumo.converters.registries import signals_of
from scex_sumo.extrapolation.assignments import future_generator, route_draws
from scex_sumo.extrapolation.loop.measure import evaluated_tracks, measure_conflicts, measure_outcome
from scex_sumo.extrapolation.loop.rollout import Batch, Rollout, roll_out
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.metrics.evaluate import evaluate
from scex_sumo.results.design import intervals_of
from scex_sumo.results.folder import assignments_table, horizons_of
from scex_sumo.results.info import describe
from scex_sumo.results.parts import Part, joined_parts, save_part
from scex_sumo.results.tables.columns import rows_table
from scex_sumo.results.tables.outcomes import SMALL, collisions_table, worst_table
from scex_sumo.road import Road
from scex_sumo.scene import LOGGED_HISTORY, STEP_S, SeedScene
from scex_sumo.statistics.intervals import DesignIntervals
from scex_sumo.world.base import WORLDS, BatchStart, Simulator, SumoDriven, WorldRequest
from scex_sumo.world.tiles import TILE_SLOTS

OnStep = Callable[[int], None]

# vehicles that stand before a junction that may have lights without a map's word
QUEUED, STANDING_MPS = 4, 0.5
VEHICLES_AT_ONCE = 5400  # over all futures of a batch
BATCHES_EACH = 2  # of each process: one that starts later does less


@dataclass(frozen=True, eq=False)
class Job:
    """Everything that a process needs to run any future of a run.

    Attributes:
        assignment: (C, V) index into ``models``, for all futures.
        counted: (T, V) steps in which a vehicle counts in metrics; None: all.
        on_paths: measure TTC, PET and DRAC of encounters, too.
        conflicts: measure needed braking and time margins of all pairs, too.
    """

    scene: SeedScene
    net: SumoNet
    settings: RunSettings
    models: ModelSet
    assignment: IntArray
    folder: Path
    gui: bool = False
    counted: BoolArray | None = None
    on_paths: bool = True
    conflicts: bool = False

    @property
    def road(self) -> Road:
        """The map of the seed scene."""
        assert self.scene.road is not None
        return self.scene.road

    @property
    def info(self) -> dict[str, Any]:
        """Entries of ``run.json`` that are known before the futures run."""
        own = {**self.models.to_json(), **self.settings.to_json(), "futures": len(self.assignment)}
        return {"seed_scene": describe(self.scene), **own}

    @cached_property
    def intervals(self) -> DesignIntervals:
        """Intervals of the run's design."""
        drawn = assignments_table(self.scene, self.assignment, self.models.names)
        return intervals_of(self.info, drawn, len(self.assignment))

    @property
    def apart(self) -> bool:
        """Whether each future needs its own tile: SUMO's drivers and sumo-gui see a whole tile."""
        return self.gui or self.models.world == "sumo"

    def slots(self, futures: IntArray) -> IntArray:
        """Return the tile slot (C,) of each future."""
        return futures % TILE_SLOTS if self.apart else np.zeros_like(futures)


def ruled(scene: SeedScene, net: SumoNet, settings: RunSettings) -> tuple[SeedScene, SumoNet]:
    """Return the scene of a job with the rules of its road, and the net with notes on them.

    In longer futures vehicles choose their ways at further forks.
    """
    scene = _looking_ahead(scene, STEP_S * settings.steps)
    if not settings.obeys or not has_rules(scene):
        return scene if scene.rules is None else replace(scene, rules=None), net
    from scex_sumo.rules.net import with_rules

    scene, notes = with_rules(scene, net)
    return scene, replace(net, notes=(*net.notes, *notes))


@owner_cache
def _looking_ahead(scene: SeedScene, horizon_s: float) -> SeedScene:
    return replace(scene, horizon_s=horizon_s) if horizon_s > scene.horizon_s + 1e-9 else scene


def has_rules(scene: SeedScene) -> bool:
    """Whether the road of a scene has rules or crossing lanes, or its recording lights, queues or people."""
    road = scene.road
    if road is None:
        return False
    people = scene.obstacles is not None or scene.people is not None
    crossed = people and any(area.kind == "crosswalk" for area in road.areas)
    queues = int((scene.now.speed < STANDING_MPS).sum()) >= QUEUED
    meet = any(lane.conflicts for lane in road.lanes.values())
    return bool(road.regulations or road.net or meet or crossed or queues or signals_of(scene))


def batches_of(futures: Sequence[int] | IntArray, size: int, *, apart: bool) -> list[IntArray]:
    """Cut futures into batches of at most ``size``; with ``apart``, those of a batch have different slots.

    ``size`` is at most `TILE_SLOTS`, then.
    """
    numbers = np.asarray(futures, dtype=np.int64)
    batch = (numbers if apart else np.arange(len(numbers))) // size
    return [numbers[batch == number] for number in np.unique(batch)]


def batch_size(job: Job, processes: int = 1) -> int:
    """Return the number of futures in a batch: at most 5400 vehicles, and two batches for each process.

    A step costs the same for one vehicle as for some hundreds.
    """
    if job.apart:
        return TILE_SLOTS
    futures, vehicles = (int(count) for count in job.assignment.shape)
    rounds = processes if processes == 1 else BATCHES_EACH * processes
    batches = math.ceil(futures * vehicles / VEHICLES_AT_ONCE / rounds) * rounds
    return math.ceil(futures / batches)


@contextmanager
def batch_runner(job: Job, futures: IntArray) -> Iterator[Callable[[IntArray, OnStep], IntArray]]:
    """Open the simulator of a job for futures; yield the function that runs a batch and saves its part."""
    with _simulator(job, futures) as simulator:

        def run(batch: IntArray, on_step: OnStep) -> IntArray:
            save_part(job.folder, _run_batch(job, simulator, batch, on_step=on_step))
            return batch

        yield run


def run_in_memory(
    scene: SeedScene, net: SumoNet, settings: RunSettings, models: ModelSet, **measured: Any
) -> Part:
    """Draw models, and run the futures of the settings in this process, without saving them.

    Args:
        scene: as of `ruled`.
        measured: fields of `Job`.
    """
    drawn = models.draw(scene, futures=settings.count, seed=settings.seed)
    job, futures = Job(scene, net, settings, models, drawn, net.path.parent, **measured), range(len(drawn))
    batches = batches_of(futures, batch_size(job), apart=job.apart)
    with _simulator(job, np.asarray(futures)) as simulator:
        return joined_parts([_run_batch(job, simulator, batch) for batch in batches])


def _simulator(job: Job, futures: IntArray) -> Simulator:
    slots = np.unique(job.slots(futures)).tolist()
    request = WorldRequest(scene=job.scene, net=job.net, models=job.models.names, slots=slots, gui=job.gui)
    simulator = WORLDS.load(job.settings.world)
    # sumo-gui shows the map as it is.
    if job.road.left_hand and simulator.has_sumo and not job.gui:
        from scex_sumo.world.mirror import MirroredSimulator

        simulator = partial(MirroredSimulator, simulator)
    return cast("Simulator", simulator(request))


def _run_batch(job: Job, simulator: Simulator, futures: IntArray, *, on_step: OnStep | None = None) -> Part:
    batch, settings = _batch(job, futures), job.settings
    world = simulator.begin(
        BatchStart(slots=job.slots(futures), assignment=batch.assignment, driven=_driven_by_sumo(job, batch))
    )
    rollout = roll_out(
        world, job.road, job.scene, batch, steps=settings.steps, replan=settings.replan, on_step=on_step
    )
    outcome = measure_outcome(
        job.scene,
        rollout,
        metrics=settings.measured,
        counted=job.counted,
        vehicles=settings.vehicles_that_count(job.scene),
        on_paths=job.on_paths,
    )
    conflicts = measure_conflicts(job.scene, rollout) if job.conflicts else None
    ids, values, horizons, fallbacks = job.scene.track_ids, outcome.values, None, None
    if horizons_of(settings.steps):
        from scex_sumo.results.tables.horizons import horizons_table

        horizons = horizons_table(values, settings.measured, futures, settings.steps)
    if rollout.replaced:
        from scex_sumo.results.tables.fallbacks import fallbacks_table

        fallbacks = fallbacks_table(rollout.replaced, ids)
    return Part(
        futures=futures,
        states=rollout.seen,
        values=values.values,
        defined=values.defined,
        worst=worst_table(values, futures=futures, track_ids=ids),
        plan_x=rollout.plan_x[:, -1].copy(),  # a view would keep all plans
        plan_y=rollout.plan_y[:, -1].copy(),
        fallbacks=fallbacks,
        tested=_tested(job, rollout),
        collisions=collisions_table(
            outcome.collisions, outcome.severity, futures=futures, track_ids=ids, first=LOGGED_HISTORY
        ),
        encounters=rows_table(outcome.encounters, futures, **SMALL),
        horizons=horizons,
        conflicts=rows_table(conflicts, futures, future=np.int32) if conflicts is not None else None,
    )


def _tested(job: Job, rollout: Rollout) -> FloatArray | None:
    """Return (C, 2, M) values of the vehicles under test alone, and 1 where defined."""
    tested = np.flatnonzero(np.isin(job.scene.track_ids, list(job.models.tested))).tolist()
    if not tested:
        return None
    own = evaluate(*evaluated_tracks(job.scene, rollout), metrics=job.settings.measured, vehicles=tested)
    return np.stack([own.values, own.defined.astype(np.float64)], axis=1)


def _batch(job: Job, futures: IntArray) -> Batch:
    seed, built = job.settings.seed, job.models.built
    return Batch(
        futures=futures,
        assignment=job.assignment[futures],
        models=built,
        names=job.models.names,
        overridden=np.array([not driven_by_sumo(model) for model in built]),
        route_draw=route_draws(futures, job.scene.vehicles, seed=seed),
        generators=[future_generator(seed, int(c)) for c in futures],
    )


def _driven_by_sumo(job: Job, batch: Batch) -> list[SumoDriven]:
    if batch.overridden.all():
        return []
    from scex_sumo.behaviors.models.sumo import SumoDriver

    driven = []
    scene, road = job.scene, job.road
    if road.left_hand:
        from scex_sumo.roads.mirror import mirrored_road, mirrored_scene

        scene, road = mirrored_scene(scene), mirrored_road(road)
    for index, model in enumerate(batch.models):
        if not isinstance(model, SumoDriver):
            continue
        future, vehicle = np.nonzero(batch.assignment == index)
        routes = model.routes(scene, road, vehicle, batch.route_draw[future, vehicle])
        for c, v, lanes in zip(future.tolist(), vehicle.tolist(), routes, strict=True):
            intention = job.scene.intention(v) if model.path in ("straight", "random") else None
            route = tuple(job.net.lanes.edges(lanes) if intention is None else intention.edges)
            if not route:
                raise ScexError(
                    f"{batch.names[index]}: vehicle {job.scene.track_ids[v]} is not on a mapped lane, "
                    "so SUMO cannot drive it; give it another model with --assign"
                )
            name, parameters = model.driving(job.scene, v)
            arrival = None if intention is None else intention.arrival
            driven.append(
                SumoDriven(
                    future=c, vehicle=v, model=name, parameters=parameters, edges=route, arrival=arrival
                )
            )
    return driven
