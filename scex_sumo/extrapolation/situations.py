"""Situations of a replan: a model is asked once for all vehicles that it sees in the same one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from scex_sumo.arrays import IntArray, distinct
from scex_sumo.behaviors.base import Behavior, Sight
from scex_sumo.behaviors.driving.distinct import handed_out, own_motion
from scex_sumo.behaviors.driving.together import DrivesAlong, Intent, driven
from scex_sumo.behaviors.guard.guarded import Guarded
from scex_sumo.behaviors.plug_in.fallback import Fallible
from scex_sumo.derived import derived
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, Who


def plans_of(
    models: Sequence[Behavior],
    groups: Sequence[Who],
    history: SceneHistory,
    road: Road,
    rng: Sequence[np.random.Generator],
) -> Iterator[tuple[int, Plan]]:
    """What `Behavior.plan` of each model gives for its group, where that is not empty.

    Models of ours that drive along paths do so side by side; every other one is asked by itself.
    """
    some = [index for index, who in enumerate(groups) if len(who)]
    along = {index: one for index in some if (one := _intent(models[index], history, road, groups[index]))}
    together = dict(zip(along, driven(history, list(along.values())), strict=True))
    for index in some:
        made = together.get(index)
        yield index, plan_once(models[index], history, road, groups[index], rng) if made is None else made


def _intent(model: Behavior, history: SceneHistory, road: Road, who: Who) -> Intent | None:
    """The drives that a model wants, one for all vehicles in equal situations; None for another's model."""
    sight = sight_of(model)
    if sight is None or not isinstance(model, DrivesAlong):
        return None
    if sight == "itself":
        first, kind = distinct(own_motion(history, who))
    else:
        first, kind = distinct(np.stack([_alike(history)[who.child], who.vehicle], axis=1).astype(np.float64))
    return model.intend(history, road, _some(who, first)).of(kind)


def plan_once(
    model: Behavior, history: SceneHistory, road: Road, who: Who, rng: Sequence[np.random.Generator]
) -> Plan:
    """What `Behavior.plan` gives, asked once for all vehicles whose situations are equal to the bit.

    All children begin in one scene: the first plan of a network is one for each vehicle, not one for each
    vehicle and child.
    """
    sight = sight_of(model)
    if sight is None or len(who) < 2:
        return model.plan(history, road, who, rng)
    if sight == "itself":
        first, kind = distinct(own_motion(history, who))
        return handed_out(model.plan(history, road, _some(who, first), rng), kind)
    alike = _alike(history)
    if len(alike) == len(np.unique(alike)):
        return model.plan(history, road, who, rng)
    few, children = _few(history)
    child = np.searchsorted(children, alike[who.child])
    first, kind = distinct(np.stack([child, who.vehicle], axis=1).astype(np.float64))
    asked = _some(Who(child=child, vehicle=who.vehicle), first)
    return handed_out(model.plan(few, road, asked, [rng[c] for c in children.tolist()]), kind)


def sight_of(model: Behavior) -> Sight | None:
    """What decides on a model's plans; None for a user's model, which may use whatever it is given."""
    guarded = False
    while isinstance(model, Guarded | Fallible):
        guarded |= isinstance(model, Guarded)
        model = model.model
    if type(model).__module__.partition(".")[0] != __name__.partition(".")[0]:
        return None
    sight: Sight | None = getattr(model, "sight", None)
    return "everyone" if guarded and sight is not None else sight


@derived
def _alike(history: SceneHistory) -> IntArray:
    """(C,) the first child whose vehicles have the same states as those of each child."""
    states = history.states
    count = states.shape[0]
    values = np.concatenate(
        [v.reshape(count, -1) for v in (states.x, states.y, states.heading, states.speed)], 1
    )
    first, kind = distinct(values)
    return first[kind]


@derived
def _few(history: SceneHistory) -> tuple[SceneHistory, IntArray]:
    """One child of each kind, and (k,) their indices."""
    children = np.unique(_alike(history))
    few = replace(
        history,
        states=history.states[children],
        children=history.children[children],
        route_draw=history.route_draw[children],
    )
    return few, children


def _some(who: Who, index: IntArray) -> Who:
    return Who(child=who.child[index], vehicle=who.vehicle[index])
