"""Futures of a case with a driving function in closed loop, and what came of them.

A quarter of the futures is typical: the initiator drives as expected, and the vehicles near the two are
drawn human-like. In the other futures the initiator acts, each action with each value equally often. Draws
follow from the suite's seed and the number of the future, the same for all functions. A human-like driver
under test is people as critical responses have them: it moves as expected until its response time after
an action, and then brakes; in typical futures it does not collide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import ScexError
from scex_sumo.behaviors.base import PLAN_STEPS, Behavior, is_driven_by_sumo, layer_with
from scex_sumo.certainty.response.critical import DECELERATIONS, responded
from scex_sumo.certainty.response.motion.actions import LEVELS, TIME_S
from scex_sumo.drivers.registry import ModelSpec, build, parse_models
from scex_sumo.extrapolation.assignments import future_generator, route_draws
from scex_sumo.extrapolation.loop.rollout import Batch, Rollout, roll_out
from scex_sumo.geometry.rectangles import Rectangles, separation
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, States, VehicleIndex
from scex_sumo.suites.situation import STEPS, Situation
from scex_sumo.world.plain import PlainWorld

REPLAN: Final = 5
OTHERS: Final = "likely_driver"
"""Driver of the others."""
EXPECTED: Final = "likely_driver:spread=0:inattention=0"
"""Driver of the initiator that does not act."""
_FUNCTION, _OTHERS, _EXPECTED, _SCRIPT = range(4)
_RESPONSE_STREAM = 7
_STANDS_MPS = 0.5
_PARTS, _NEAR = 3, 10.0  # of P of a later response: up to that of a contact, to 10 times it, and above


@dataclass(frozen=True, kw_only=True, eq=False)
class Draws:
    """Futures of a case, (C,) each.

    Attributes:
        row: of the situation's cases; -1 in typical futures.
        weight: of a future among those of its row.
        low: least P of a later response than that of the future; ``high`` the largest.
        response_s: of people.
        braking: of people, index into `DECELERATIONS`.
    """

    row: IntArray
    weight: FloatArray
    low: FloatArray
    high: FloatArray
    response_s: FloatArray
    braking: IntArray
    route: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcomes:
    """What came of the futures of a case, (C,) each.

    Attributes:
        contact_s: of the two vehicles; inf without.
        closing_mps: relative speed at the contact.
        struck: whether the vehicle under test stands at the contact.
        other_s: of the vehicle under test with another one, before; inf without.
        gap_m: least distance of the two before a contact.
        braking_mps2: hardest of the vehicle under test; ``jerk_mps3`` the largest.
        drac_mps2: largest deceleration rate to avoid a crash; ``ttc_s`` the least time to collision.
        states: (C, V, T) of all vehicles from the seed moment on.
    """

    draws: Draws
    contact_s: FloatArray
    closing_mps: FloatArray
    struck: BoolArray
    other_s: FloatArray
    gap_m: FloatArray
    braking_mps2: FloatArray
    jerk_mps3: FloatArray
    drac_mps2: FloatArray
    ttc_s: FloatArray
    states: States

    @property
    def hit(self) -> BoolArray:
        """Whether the two touch."""
        return np.isfinite(self.contact_s)


def draws_of(situation: Situation, futures: int, *, seed: int, human_like: bool) -> Draws:
    """Return the draws of a number of futures; more if the actions need them.

    Response times of people are drawn in three parts of their distribution, for each deceleration, as
    contacts are rare.
    """
    typical, levels = max(1, futures // 4), situation.levels
    each = _PARTS * len(DECELERATIONS) * levels if human_like else levels
    count = max(futures - typical, each)
    acting = np.arange(-(-count // each) * each if human_like else count)
    row = np.concatenate([np.full(typical, -1), acting % levels])
    number = np.arange(len(row))
    uniform = np.array([future_generator(seed, int(c), _RESPONSE_STREAM).random() for c in number])
    weight = 1 / np.bincount(row[typical:], minlength=levels)[row]
    low, high = np.zeros(len(row)), np.ones(len(row))
    braking, part = ((number - typical) // levels // k % n for k, n in ((1, len(DECELERATIONS)), (3, _PARTS)))
    if human_like:
        late = situation.late_by[row, braking]
        edges = np.stack([np.ones_like(late), np.minimum(1.0, _NEAR * late), late, np.zeros_like(late)])
        low, high = edges[part + 1, number], edges[part, number]
        shares = situation.people.decelerations / situation.people.decelerations.sum()
        weight = weight * each / levels * (high - low) * shares[braking]
    survival = low + (high - low) * uniform
    weight[row < 0] = 1 / typical
    response = np.full(len(row), np.inf)
    acts = np.flatnonzero(row >= 0)
    if human_like and len(acts):
        response[acts] = situation.responses(row[acts], survival[acts])
    return Draws(
        row=row,
        weight=weight,
        low=low,
        high=high,
        response_s=response,
        braking=braking,
        route=route_draws(number, situation.scene.vehicles, seed=seed),
    )


class Script:
    """Driver that moves vehicles along given states (C, V, T)."""

    def __init__(self, states: States) -> None:
        self.states = states

    def plan(
        self, history: SceneHistory, road: Road, who: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Return the states of the next steps."""
        steps = slice(history.step + 1, history.step + 1 + PLAN_STEPS)
        return Plan(**vars(self.states[who.future, who.vehicle][:, steps]))


class FewFutures:
    """Driver in some futures only, which it plans without the others.

    Args:
        inner: a driver whose plans in one future do not depend on the others.
    """

    def __init__(self, inner: Behavior) -> None:
        self.inner = inner

    def plan(
        self, history: SceneHistory, road: Road, who: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Return the inner driver's plan."""
        futures, future = np.unique(who.future, return_inverse=True)
        few = VehicleIndex(future=future, vehicle=who.vehicle)
        return self.inner.plan(history.part(futures), road, few, [rng[c] for c in futures.tolist()])


def simulate(
    situation: Situation, spec: ModelSpec, futures: int, *, seed: int, given: Behavior | None = None
) -> Outcomes:
    """Run the futures of a case with a driving function in the place of the responder.

    Args:
        given: the function, instead of making it.

    Raises:
        ScexError: the function has no usable plan, or SUMO drives it.
    """
    function = build(spec, fallback=True) if given is None else given
    if is_driven_by_sumo(function):
        raise ScexError(f"{spec}: is driven by SUMO, which a suite does not run; give a driving function")
    human_like = layer_with(function, "human_like") is not None
    draws = draws_of(situation, futures, seed=seed, human_like=human_like)
    script = situation.scripted(draws.row, PLAN_STEPS + REPLAN)
    if human_like:
        _respond(script, situation, draws)
    names = (str(spec), OTHERS, EXPECTED, "scripted")
    others, expected = (build(parse_models(name)[0]) for name in names[1:3])
    batch = Batch(
        futures=np.arange(len(draws.row)),
        assignment=_assignment(situation, draws, human_like=human_like),
        models=[function, others, FewFutures(expected), Script(script)],
        names=names,
        overridden=np.ones(len(names), dtype=np.bool_),
        route_draw=draws.route,
        generators=[future_generator(seed, c) for c in range(len(draws.row))],
    )
    scene = situation.scene
    assert scene.road is not None
    world = PlainWorld(len(draws.row), scene.vehicles, length=scene.length)
    rollout = roll_out(world, scene.road, scene, batch, steps=STEPS, replan=REPLAN, crash=False)
    _refuse_replaced(rollout, situation, str(spec))
    return outcomes_of(situation, draws, rollout, human_like=human_like)


def _assignment(situation: Situation, draws: Draws, *, human_like: bool) -> IntArray:
    assignment = np.full((len(draws.row), situation.scene.vehicles), _SCRIPT, dtype=np.int64)
    if human_like:  # who is scripted needs nobody that reacts
        return assignment
    assignment[:, list(situation.near)] = _OTHERS
    if situation.initiator < situation.expected.vehicles:
        assignment[draws.row < 0, situation.initiator] = _EXPECTED
    assignment[:, situation.responder] = _FUNCTION
    return assignment


def _respond(script: States, situation: Situation, draws: Draws) -> None:
    """Let the responder of a script move as people do, in place."""
    j, expected = situation.responder, situation.expected
    for k, deceleration in enumerate(DECELERATIONS):
        which = np.flatnonzero((draws.row >= 0) & (draws.braking == k))
        if not len(which):
            continue
        motion = responded(situation.cases.take(draws.row[which]), draws.response_s[which], deceleration)
        x, y, heading = expected.lines.at(np.full(len(which), j), motion.s)
        steps = np.minimum(np.arange(script.x.shape[2]), STEPS)
        moved = States(x=x, y=y, heading=heading, speed=motion.speed)
        script.assign((which, j), moved[:, steps])


def _refuse_replaced(rollout: Rollout, situation: Situation, name: str) -> None:
    own = [one for one in rollout.replaced if one.vehicle == situation.responder]
    if own:
        count, first = len(own), own[0]
        raise ScexError(
            f"{name}: {count} plans cannot be used, the first at {first.step * STEP_S:g} s: {first.reason}"
        )


def outcomes_of(
    situation: Situation, draws: Draws, rollout: Rollout, *, human_like: bool = False
) -> Outcomes:
    """Measure what came of the futures of a case."""
    scene, i, j = situation.scene, situation.initiator, situation.responder
    first = scene.now.repeat(len(draws.row))
    states = States.concatenate([first[:, :, None], rollout.states.swapaxes(1, 2)], axis=2)
    apart = _apart(situation, states, j, i)
    contact = _first_s(apart)
    others = [_first_s(_apart(situation, states, j, v)) for v in situation.near]
    other = np.min(others, axis=0) if others else np.full(len(contact), np.inf)
    contact = np.where(contact <= other, contact, np.inf)
    if human_like:
        nothing = (draws.row < 0) | (situation.critical[draws.row] == np.inf)  # nobody has to respond
        contact, other = np.where(nothing, np.inf, contact), np.full(len(contact), np.inf)
    end = np.minimum(np.minimum(contact, other), TIME_S[-1])
    until = end[:, None] + 1e-9 >= TIME_S
    speed = states.speed[:, j]
    braking = np.maximum(-np.gradient(speed, STEP_S, axis=1), 0.0)
    closing = -np.gradient(apart[:, ::2], STEP_S, axis=1)
    gap = np.maximum(apart[:, ::2], 1e-2)
    counts = until & (closing > 1e-9)
    at = np.clip(np.round(np.where(np.isfinite(contact), contact, 0.0) / STEP_S).astype(int), 0, STEPS)
    hit, each, before = np.isfinite(contact), np.arange(len(contact)), np.maximum(at - 1, 0)
    return Outcomes(
        draws=draws,
        contact_s=contact,
        closing_mps=np.where(hit, _closing(states, i, j, each, before), 0.0),
        struck=hit & (speed[each, before] < _STANDS_MPS),
        other_s=np.where(other < contact, other, np.inf),
        gap_m=np.where(until, np.maximum(apart[:, ::2], 0.0), np.inf).min(axis=1),
        braking_mps2=np.where(until, braking, 0.0).max(axis=1),
        jerk_mps3=np.where(until, np.abs(np.gradient(braking, STEP_S, axis=1)), 0.0).max(axis=1),
        drac_mps2=np.where(counts, closing**2 / (2 * gap), 0.0).max(axis=1),
        ttc_s=np.where(counts, gap / np.maximum(closing, 1e-9), np.inf).min(axis=1),
        states=states,
    )


def chances(situation: Situation, outcomes: Outcomes) -> tuple[float, float]:
    """Return the share of typical futures with a contact, and P of a contact after an action."""
    draws, hit = outcomes.draws, outcomes.hit
    shares = by_level(situation, draws.weight * hit, draws.row)
    return float(hit[draws.row < 0].mean()), situation.probability(shares)


def by_level(situation: Situation, values: FloatArray, row: IntArray) -> FloatArray:
    """Return the sums (n, 10) of values of futures by action and value."""
    sums = np.zeros(situation.levels)
    np.add.at(sums, row[row >= 0], values[row >= 0])
    return sums.reshape(-1, LEVELS)


def _closing(states: States, i: int, j: int, row: IntArray, step: IntArray) -> FloatArray:
    one, other = (states[row, v, step] for v in (i, j))
    return np.hypot(
        one.speed * np.cos(one.heading) - other.speed * np.cos(other.heading),
        one.speed * np.sin(one.heading) - other.speed * np.sin(other.heading),
    )


def _apart(situation: Situation, states: States, one: int, other: int) -> FloatArray:
    """Return (C, 2 T - 1) distance of two vehicles, negative if they overlap, also between the steps, m."""
    length, width = situation.size
    both = []
    for v in (one, other):
        own = states[:, v]
        turned = np.unwrap(own.heading, axis=1)
        values = [_halves(part) for part in (own.x, own.y, turned)]
        both.append(
            Rectangles(
                x=values[0],
                y=values[1],
                heading=values[2],
                half_length=np.full((1, 1), length[v] / 2),
                half_width=np.full((1, 1), width[v] / 2),
            )
        )
    return separation(*both)


def _halves(values: FloatArray) -> FloatArray:
    halves = np.empty((len(values), 2 * values.shape[1] - 1))
    halves[:, ::2], halves[:, 1::2] = values, (values[:, 1:] + values[:, :-1]) / 2
    return halves


def _first_s(apart: FloatArray) -> FloatArray:
    """Return (C,) time of the first contact after the seed moment, s; inf without, or if they touch then."""
    hit = apart < 0
    first_s = np.where(hit.any(axis=1), np.argmax(hit, axis=1) * STEP_S / 2, np.inf)
    return np.where(hit[:, 0], np.inf, first_s)
