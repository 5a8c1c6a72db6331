"""Drives of several models as one: a step of hundreds of vehicles costs hardly more than one of a few."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from typing import Protocol, runtime_checkable

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.behaviors.driving.distinct import handed_out
from scex_sumo.behaviors.driving.motion import Accelerate, drive
from scex_sumo.behaviors.driving.paths import SeedPaths
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, Who


@dataclass(frozen=True, kw_only=True, eq=False)
class Intent:
    """What a model wants of n vehicles along their paths, before they are driven.

    Attributes:
        who: the n vehicles.
        paths: of the seed scene.
        row: (n,) path of each.
        accelerate: as `drive` takes it.
        kind: (m,) like which of the n each of the m vehicles that the model was asked for drives; None where
            these are the n.
    """

    who: Who
    paths: SeedPaths
    row: IntArray
    accelerate: Accelerate
    kind: IntArray | None = None

    def of(self, kind: IntArray) -> Intent:
        """The same for (k,) of the m vehicles, each as often as it is named."""
        return replace(self, kind=kind if self.kind is None else self.kind[kind])


@runtime_checkable
class DrivesAlong(Protocol):
    """A model whose plan is a drive along paths and nothing else."""

    def intend(self, history: SceneHistory, road: Road, who: Who) -> Intent:
        """What it wants of the vehicles that `Behavior.plan` is asked for."""


def driven(history: SceneHistory, intents: Sequence[Intent]) -> list[Plan]:
    """Plans of 3 s, one of each of some models, whose vehicles are driven side by side."""
    made: dict[int, Plan] = {}
    for paths in {id(one.paths): one.paths for one in intents}.values():
        mine = [index for index, one in enumerate(intents) if one.paths is paths]
        made |= zip(mine, _side_by_side(history, paths, [intents[index] for index in mine]), strict=True)
    return [made[index] for index in range(len(intents))]


def _side_by_side(history: SceneHistory, paths: SeedPaths, intents: Sequence[Intent]) -> list[Plan]:
    ends = [0, *accumulate(len(one.who) for one in intents)]
    parts = [(one.accelerate, slice(*part)) for one, part in zip(intents, pairwise(ends), strict=True)]
    who = Who(
        child=np.concatenate([one.who.child for one in intents]),
        vehicle=np.concatenate([one.who.vehicle for one in intents]),
    )

    def accelerate(step: int, v: FloatArray, travelled: FloatArray, s: FloatArray) -> FloatArray:
        return np.concatenate([own(step, v[k], travelled[k], s[k]) for own, k in parts])

    made = drive(history, who, paths, np.concatenate([one.row for one in intents]), accelerate)
    kinds = [np.arange(len(one.who)) if one.kind is None else one.kind for one in intents]
    return [handed_out(made, begin + kind) for begin, kind in zip(ends, kinds, strict=False)]
