"""Plans made once for all vehicles in equal situations, whatever their future."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from scex_sumo.base.arrays import IntArray, distinct
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.base import PLAN_STEPS, BatchBehavior, declared, layers
from scex_sumo.behaviors.driving.motion import DrivesAlong, Intent, driven, handed_out, own_motion
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, VehicleIndex


def plans_of(
    models: Sequence[BatchBehavior],
    groups: Sequence[VehicleIndex],
    history: SceneHistory,
    road: Road,
    rng: Sequence[np.random.Generator],
    steps: int = PLAN_STEPS,
) -> Iterator[tuple[int, Plan]]:
    """Yield the index of each model that drives vehicles, and its plan for them.

    Path-following models plan together, and ``steps`` only.
    """
    if road.left_hand:
        yield from _mirrored_plans(models, groups, history, road, rng, steps)
        return
    driving = [index for index, vehicles in enumerate(groups) if len(vehicles)]
    along = _intents({index: models[index] for index in driving}, history, road, groups)
    together = dict(zip(along, driven(history, list(along.values()), steps), strict=True))
    for index in driving:
        plan = together.get(index)
        yield index, plan_once(models[index], history, road, groups[index], rng) if plan is None else plan


def _mirrored_plans(
    models: Sequence[BatchBehavior],
    groups: Sequence[VehicleIndex],
    history: SceneHistory,
    road: Road,
    rng: Sequence[np.random.Generator],
    steps: int,
) -> Iterator[tuple[int, Plan]]:
    """Yield the plans on a road with traffic on the left: our models see its mirror image, others itself."""
    from scex_sumo.roads.mirror import mirrored_history, mirrored_road, mirrored_states

    nobody = VehicleIndex(future=np.empty(0, dtype=np.int64), vehicle=np.empty(0, dtype=np.int64))
    own = [any(layer.inner is None for layer in layers(model)) for model in models]
    ours = [vehicles if mine else nobody for vehicles, mine in zip(groups, own, strict=True)]
    image = mirrored_history(history), mirrored_road(road)
    for index, plan in plans_of(models, ours, *image, rng, steps):
        yield index, mirrored_states(plan)
    for index, vehicles in enumerate(groups):
        if len(vehicles) and not own[index]:
            yield index, plan_once(models[index], history, road, vehicles, rng)


def _intents(
    models: Mapping[int, BatchBehavior], history: SceneHistory, road: Road, groups: Sequence[VehicleIndex]
) -> dict[int, Intent]:
    """Return the intents of the path-following models, once for equal situations."""
    alike, intents = dict[Hashable, dict[int, DrivesAlong]](), dict[int, Intent]()
    for index, model in models.items():
        if declared(model).sight is None:
            continue
        if isinstance(model, DrivesAlong):
            alike.setdefault(model.looks, {})[index] = model
        elif (intent := _intent(model, history, road, groups[index])) is not None:
            intents[index] = intent
    for drivers in alike.values():
        situations = [_situations(model, history, groups[index]) for index, model in drivers.items()]
        few = [groups[index][first] for index, (first, _) in zip(drivers, situations, strict=True)]
        together = [*drivers.values()]
        shared_intents = together[0].intend_together(together, history, road, few)
        intents |= {
            index: intent.of(kind)
            for index, intent, (_, kind) in zip(drivers, shared_intents, situations, strict=True)
        }
    return {index: intents[index] for index in models if index in intents}


def _intent(model: BatchBehavior, history: SceneHistory, road: Road, vehicles: VehicleIndex) -> Intent | None:
    """Return the intent of a learned driver along paths, once for equal situations; None for other models."""
    first, kind = _situations(model, history, vehicles)
    few, asked, futures = _in_few(history, vehicles[first])
    intent: Intent | None = declared(model).intend(few, road, asked)
    if intent is None:
        return None
    here = VehicleIndex(future=futures[intent.vehicles.future], vehicle=intent.vehicles.vehicle)
    return replace(intent, vehicles=here).of(kind)


def _situations(
    model: BatchBehavior, history: SceneHistory, vehicles: VehicleIndex
) -> tuple[IntArray, IntArray]:
    """Return the first vehicle (k,) in each situation, and the situation (n,) of each."""
    if declared(model).sight == "itself":
        return distinct(own_motion(history, vehicles))
    return distinct(
        np.stack([_first_alike(history)[vehicles.future], vehicles.vehicle], axis=1).astype(np.float64)
    )


def plan_once(
    model: BatchBehavior,
    history: SceneHistory,
    road: Road,
    vehicles: VehicleIndex,
    rng: Sequence[np.random.Generator],
) -> Plan:
    """Return a model's plan, made once for all vehicles in situations equal to the bit.

    All futures begin in one scene, so that the first plans differ by vehicle only.
    """
    if declared(model).sight is None or len(vehicles) < 2:
        return model.plan(history, road, vehicles, rng)
    first, kind = _situations(model, history, vehicles)
    few, asked, futures = _in_few(history, vehicles[first])
    return handed_out(model.plan(few, road, asked, [rng[c] for c in futures.tolist()]), kind)


def _in_few(history: SceneHistory, vehicles: VehicleIndex) -> tuple[SceneHistory, VehicleIndex, IntArray]:
    """Return one of each of the equal futures, the vehicles there, and (C',) indices of these futures."""
    few, futures = _one_of_each(history)
    future = np.searchsorted(futures, _first_alike(history)[vehicles.future])
    return few, VehicleIndex(future=future, vehicle=vehicles.vehicle), futures


@owner_cache
def _first_alike(history: SceneHistory) -> IntArray:
    states = history.states
    count = states.shape[0]
    values = np.concatenate(
        [v.reshape(count, -1) for v in (states.x, states.y, states.heading, states.speed)], 1
    )
    first, kind = distinct(values)
    return first[kind]


@owner_cache
def _one_of_each(history: SceneHistory) -> tuple[SceneHistory, IntArray]:
    futures = np.unique(_first_alike(history))
    return history if len(futures) == history.states.shape[0] else history.part(futures), futures
