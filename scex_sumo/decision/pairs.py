"""Pairs of a moment: P(contact) of each two road users, from the human-like futures.

One function gives the number that the headline, the list, the page, ``rank``, ``catalogue``, ``watch`` and
``validate`` show.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import IntArray
from scex_sumo.conflicts.pairs import Conflicts
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.decision.law import Law, at_level, error_over_futures, law, over_futures, second_of_each
from scex_sumo.decision.words import BESIDE, REAR_END, how, what
from scex_sumo.results.participants import everybody
from scex_sumo.results.tables.pairs import PAIRS, TOLD
from scex_sumo.roads.doubts import doubts_of
from scex_sumo.roads.places import places_of
from scex_sumo.scene import STEP_S, SeedScene, States

_ALIKE = 0.1  # of the largest P of one future


def pair_table(
    scene: SeedScene, conflicts: Conflicts, *, futures: int, states_of: Callable[[int], States]
) -> pa.Table:
    """Return the pairs of a moment, see `PAIRS`, the most probable contact first.

    Args:
        scene: with its road.
        conflicts: of all human-like futures.
        states_of: returns the states (V, T) of a future of all that `everybody` has, from the moment on.
    """
    whole, rule = everybody(scene), law()
    key = conflicts.one * whole.vehicles + conflicts.two
    keys, pair = np.unique(key, return_inverse=True)
    contact = rule.contact(conflicts, whole.types)
    count = {"pairs": len(keys), "futures": futures}
    probability = over_futures(pair, contact, **count)
    least, most = (
        over_futures(pair, at_level(contact, factor), **count)
        for factor in (1 / rule.level_factor, rule.level_factor)
    )
    error = error_over_futures(pair, contact, **count)
    decides = second_of_each(pair, contact, futures)[1]
    alike = np.bincount(pair, contact >= _ALIKE * contact[decides][pair], minlength=len(keys))
    collide = np.bincount(pair, conflicts.gap <= 0, minlength=len(keys)) / futures
    ranked = np.argsort(-probability, kind="stable")
    sentences = _Told(whole, conflicts.take(decides[ranked]), rule, states_of)
    rows = [sentences.row(k, float(p)) for k, p in enumerate(probability[ranked])]
    placed = [row for row in rows if "x" in row]
    if placed:
        assert whole.road is not None
        places = places_of(whole.road, np.array([[row["x"], row["y"]] for row in placed]))
        for row, place in zip(placed, places, strict=True):
            row["place"] = place
    own = np.array([[row.pop("_own"), row.pop("_other")] for row in rows], dtype=np.int64).reshape(-1, 2)
    columns: dict[str, Any] = {name: [row.get(name) for row in rows] for name in PAIRS.names}
    columns |= {
        "probability": probability[ranked],
        "least": np.minimum(least, probability / error)[ranked],
        "most": np.maximum(most, np.minimum(probability * error, 1.0))[ranked],
        "futures": alike[ranked].astype(np.int32),
        "collide": collide[ranked],
        "doubt": doubts_of(whole, own[:, 0], own[:, 1], vehicles=scene.vehicles, names=_names(whole)),
    }
    return pa.table({name: pa.array(columns[name], PAIRS.field(name).type) for name in PAIRS.names})


def _names(whole: SeedScene) -> list[str]:
    """Return the names (V,) of road users: those of vehicles, kind and id of people."""
    people = np.zeros(whole.vehicles, np.bool_) if whole.people is None else whole.people
    ids = zip(whole.names, whole.types, people.tolist(), strict=True)
    return [f"{road_user(kind)} {name}" if person else name for name, kind, person in ids]


class _Told:
    """What is told of pairs, by its row of `Conflicts` that has the largest share of P."""

    def __init__(
        self, whole: SeedScene, conflicts: Conflicts, rule: Law, states_of: Callable[[int], States]
    ) -> None:
        self._whole, self._conflicts, self._states_of = whole, conflicts, cache(states_of)
        self._parts = np.array(rule.parts(conflicts, whole.types))  # (3, P)
        self._names = _names(whole)
        self._people = whole.people if whole.people is not None else np.zeros(whole.vehicles, np.bool_)

    def row(self, k: int, probability: float) -> dict[str, Any]:
        """Return the columns of `PAIRS` that one future tells, but for its place, and both indices."""
        conflicts = self._conflicts
        one, two, future = int(conflicts.one[k]), int(conflicts.two[k]), int(conflicts.future[k])
        axis, first, step = self._axis(k)
        own, other = (one, two) if first else (two, one)
        if self._people[own] and not self._people[other]:  # vehicles respond to people
            own, other = other, own
        kind = what(self._whole, own, other, float(conflicts.meets_rad[k]), person=bool(self._people[other]))
        if kind in (REAR_END, BESIDE) and axis == "gap" and self._is_ahead(own, other):
            own, other = other, own
        row: dict[str, Any] = {
            "_own": own,
            "_other": other,
            "track_id": int(self._whole.track_ids[own]),
            "other_id": int(self._whole.track_ids[other]),
            "person": self._names[other] if self._people[other] else None,
            "name": self._names[own],
            "other_name": self._names[other],
            "future": future,
            "needed_braking": float(conflicts.braking[k]),
            "time_margin": float(conflicts.margin[k]) if np.isfinite(conflicts.margin[k]) else None,
            "gap_m": float(conflicts.gap[k]),
            "conflict_s": STEP_S * step,
            "what": kind,
        }
        if probability < TOLD:
            return row
        states = self._states_of(future)
        both = states[[own, other], min(step, states.shape[1] - 1)]
        vx, vy = (np.diff(both.speed * turn(both.heading))[0] for turn in (np.cos, np.sin))
        return {
            **row,
            "how": how(states[[own, other]], axis, row, kind, (self._names[own], self._names[other])),
            "speed_mps": float(np.hypot(vx, vy)),
            "x": float(both.x[0]),
            "y": float(both.y[0]),
        }

    def _is_ahead(self, one: int, other: int) -> bool:
        """Return whether a vehicle is ahead of another one now, along the heading of that one."""
        now = self._whole.now
        return bool(now[other].ahead_and_left(now.x[one], now.y[one])[0] > 0)

    def _axis(self, k: int) -> tuple[str, bool, int]:
        """Return what decides in a row, whether the first vehicle responds, and the step."""
        conflicts = self._conflicts
        braking, margin, gap = self._parts[:, k].tolist()
        brakes, later_one = bool(conflicts.brakes_one[k]), bool(conflicts.later_one[k])
        if conflicts.gap[k] <= 0:
            return "contact", brakes if conflicts.braking[k] > 0 else later_one, int(conflicts.gap_step[k])
        if braking >= max(margin, gap):
            return "braking", brakes, int(conflicts.braking_step[k])
        if margin >= gap:
            return "margin", later_one, int(conflicts.margin_step[k])
        return "gap", True, int(conflicts.gap_step[k])


def indices_of(whole: SeedScene, track_ids: Sequence[int]) -> IntArray:
    """Return the indices of road users by track id."""
    place = {int(track): v for v, track in enumerate(whole.track_ids)}
    return np.array([place[track] for track in track_ids], dtype=np.int64)
