"""Situation of a case: who drives, who acts, how often people act so, and how often they respond too late."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.certainty.response.critical import HARD_MPS, TYPICAL, by_action, critical_response
from scex_sumo.certainty.response.motion.actions import (
    ACTIONS,
    GRAZE_M,
    LEVELS,
    TIME_S,
    Cases,
    cases_of,
    contexts,
    pairs_of,
)
from scex_sumo.certainty.response.motion.expected import Expected, expected_motion
from scex_sumo.certainty.response.people import (
    People,
    later_than,
    left_at,
    people_of,
    probabilities,
    time_gaps,
)
from scex_sumo.results.tables.outcomes import masses, pair_injuries
from scex_sumo.scene import SeedScene, States

STEPS: Final = len(TIME_S) - 1
"""Steps of a case: as long as contact is looked for in critical responses."""
NEAR: Final = 6
"""Vehicles, besides the two, that react; those farther away move as expected."""
_MIN_PROBABILITY = 1e-9
_GRID_S = np.arange(0.0, 6.5, 0.1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Situation:
    """A seed scene with the vehicle that is driven, and all actions of the other one.

    Attributes:
        scene: with people as its last vehicles.
        initiator: index of the one that acts; so ``responder``, whose place the function takes.
        near: indices of the vehicles that react, without these two.
        cases: ten rows for each of the n actions.
        kinds: (n,) index into `ACTIONS`.
        often: (n, 10) how often the initiator does it with at least each value.
        late: (n, 10) P that people respond too late.
        late_by: (10 n, A) the same for each of `DECELERATIONS`.
        critical_by: (10 n, A) latest response without contact, s; inf where nobody has to respond.
    """

    expected: Expected
    scene: SeedScene
    people: People
    initiator: int
    responder: int
    near: Sequence[int]
    cases: Cases
    kinds: IntArray
    often: FloatArray
    late: FloatArray
    late_by: FloatArray
    critical_by: FloatArray

    @property
    def critical(self) -> FloatArray:
        """Latest response (10 n,) without contact, with the least deceleration, s."""
        return np.asarray(self.critical_by.min(axis=1))

    @property
    def levels(self) -> int:
        """Number of actions with their values."""
        return len(self.cases)

    def probability(self, shares: FloatArray) -> float:
        """Return P of a contact by the shares (n, 10) of contacts after each action with each value."""
        each = probabilities(self.often, shares, self.kinds)
        return float(-np.expm1(np.log1p(-np.minimum(each, 1 - 1e-12)).sum()))

    def total(self, values: FloatArray) -> float:
        """Return the expected sum of values (n, 10) that follow each action with each value."""
        return float(probabilities(self.often, values, self.kinds).sum())

    @property
    def human_like(self) -> float:
        """P of a contact with people."""
        return self.probability(self.late)

    @property
    def most(self) -> float:
        """P of a contact with a driver that every action hits."""
        return self.probability(np.ones_like(self.late))

    def worst(self) -> int:
        """Return the row of the cases with the most probable action to which people respond too late."""
        share = self.often - np.concatenate([self.often[:, 1:], np.zeros((len(self.often), 1))], axis=1)
        return int(np.argmax(share * self.late))

    def words(self, row: int) -> str:
        """Return the action of a row in words."""
        action, value = ACTIONS[int(self.cases.action[row])], float(self.cases.value[row])
        words = action.words.format(f"{value:g}").replace(" or more", "")
        return words if value else words.partition(",")[0]

    def responses(self, row: IntArray, survival: FloatArray) -> FloatArray:
        """Return response times (m,) of people after the actions of rows (m,), s; inf where none is needed.

        Args:
            survival: (m,) probability that one responds later.
        """
        cases = self.cases
        grid = np.repeat(_GRID_S[None], len(cases), axis=0)
        later = self.people.later(
            grid, cases.action[:, None], time_gaps(cases)[:, None], left_at(cases, grid)
        )
        later = np.minimum.accumulate(later, axis=1)
        times_s = [
            np.interp(-u, -later[k], _GRID_S, right=np.inf)
            for k, u in zip(row.tolist(), survival, strict=True)
        ]
        return np.where(np.isinf(self.critical[row]) & (self.critical[row] > 0), np.inf, times_s)

    def scripted(self, rows: IntArray, extra: int) -> States:
        """Return states (C, V, 1 + STEPS + extra) in which all move as expected, and the initiator acts.

        Args:
            rows: (C,) of the cases; -1: the initiator moves as expected, too.
        """
        who = np.arange(self.scene.vehicles)
        x, y, heading = self.expected.lines.at(who, self.expected.s)
        usual = States(x=x, y=y, heading=heading, speed=self.expected.speed)
        states = usual.repeat(len(rows))
        acts = np.flatnonzero(rows >= 0)
        outlines, velocity = self.cases.outlines, self.cases.velocity[rows[acts]]
        moved = outlines.part(rows[acts])
        states.assign(
            (acts, self.initiator),
            States(x=moved.x, y=moved.y, heading=moved.heading, speed=np.hypot(*velocity.transpose(2, 0, 1))),
        )
        return states[:, :, np.minimum(np.arange(1 + STEPS + extra), STEPS)]

    def injuries(self, closing_mps: FloatArray) -> FloatArray:
        """Return the expected severe injuries of contacts (m,) at closing speeds; 0 below `HARD_MPS`."""
        i, j, scene = self.initiator, self.responder, self.scene
        mass = masses(scene.types, scene.length)
        shares = np.array([[mass[j]], [mass[i]]]) / (mass[i] + mass[j])
        risk = pair_injuries(([scene.types[i]], [scene.types[j]]), shares, closing_mps).sum(axis=0)
        return np.where(closing_mps >= HARD_MPS, risk, 0.0)

    @property
    def size(self) -> tuple[FloatArray, FloatArray]:
        """Lengths and widths (V,) by which contacts count: a graze of the responder is none."""
        width = self.scene.width.copy()
        width[self.responder] -= GRAZE_M
        return self.scene.length, width


def situation_of(scene: SeedScene, initiator: int, responder: int) -> Situation:
    """Return the situation of two vehicles by track id in a seed scene with a road.

    Raises:
        UsageError: the initiator can do nothing that concerns the responder.
    """
    expected, people = expected_motion(scene), people_of()
    ids = expected.scene.track_ids.tolist()
    for track in (initiator, responder):
        if track not in ids:
            raise UsageError(f"{scene.name}: no vehicle {track} in the seed scene")
    i, j = ids.index(initiator), ids.index(responder)
    pairs = pairs_of(expected)
    cases = cases_of(pairs, (pairs.initiator == i) & (pairs.responder == j))
    if not len(cases):
        raise UsageError(f"{scene.name}: {initiator} can do nothing that concerns {responder}")
    response = critical_response(cases)
    kinds = cases.action[::LEVELS]
    often = people.often(
        action=kinds,
        speed=np.full(len(kinds), expected.scene.now.speed[i]),
        follows=contexts(pairs)[cases.pair[::LEVELS]],
        response_s=by_action(response[:, TYPICAL]),
    )
    late = later_than(people, cases, response)
    gap, left = time_gaps(cases)[:, None], left_at(cases, response)
    late_by = people.later(response, cases.action[:, None], gap, left)
    kept = probabilities(often, np.ones_like(late), kinds) >= _MIN_PROBABILITY
    rows = np.flatnonzero(np.repeat(kept, LEVELS))
    return Situation(
        expected=expected,
        scene=_bare(expected.scene),
        people=people,
        initiator=i,
        responder=j,
        near=_near(expected, i, j),
        cases=cases.take(rows),
        kinds=kinds[kept],
        often=often[kept],
        late=late[kept],
        late_by=late_by[rows],
        critical_by=response[rows],
    )


def _bare(scene: SeedScene) -> SeedScene:
    """Return a scene without obstacles and intentions; the same object without any."""
    if scene.obstacles is None and not scene.intentions:
        return scene
    return replace(scene, obstacles=None, intentions=())


def _near(expected: Expected, i: int, j: int) -> list[int]:
    """Return the vehicles that come nearest to one of two, as expected; at most `NEAR`."""
    x, y, _ = expected.lines.at(np.arange(len(expected.s)), expected.s)
    apart = np.minimum(*(np.hypot(x - x[v], y - y[v]).min(axis=1) for v in (i, j)))
    order = [v for v in np.argsort(apart, kind="stable").tolist() if v not in (i, j)]
    return [v for v in order if v < expected.vehicles][:NEAR]
