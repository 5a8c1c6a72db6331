"""Pairs of a moment of a recording: P(contact) of each two road users, one row each."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import BoolArray
from scex_sumo.converters.net.sumo_net import SumoNet
from scex_sumo.decision.decide import is_to_be_tested
from scex_sumo.decision.moment import human_part, pairs_of_part
from scex_sumo.decision.typology import kinds_of
from scex_sumo.results.tables.columns import schema
from scex_sumo.results.tables.pairs import PAIRS as DECIDED
from scex_sumo.scene import HISTORY_STEPS, SeedScene, States

PAIRS = pa.schema([*DECIDED, *schema("to_test conflict")])
"""Columns of pairs; ``conflict`` is one of `typology.CONFLICTS`, null where nobody asks for it."""


def pairs_of_moment(scene: SeedScene, net: SumoNet, *, futures: int, seed: int = 0) -> pa.Table:
    """Return the pairs of a moment, see `PAIRS`, the most probable contact first.

    Args:
        scene: with its road, ruled.
        futures: human-like ones.
    """
    part = human_part(scene, net, futures=futures, seed=seed)
    table = pairs_of_part(scene, part)
    rows = table.select(["track_id", "other_id", "probability", "future"]).to_pylist()
    table = table.append_column("to_test", pa.array([is_to_be_tested(row) for row in rows], pa.bool_()))
    return table.append_column("conflict", pa.array(kinds_of(scene, rows, part), pa.string()))


def recorded(scene: SeedScene) -> tuple[States, BoolArray]:
    """Return the states (V, T) of a recording from 1 s before a moment on, and which of them are recorded."""
    history = np.arange(HISTORY_STEPS, -1, -1) <= scene.recorded_steps[:, None]
    if scene.future is None:
        return scene.history, history
    future = np.ones(scene.future.shape, np.bool_) if scene.future_valid is None else scene.future_valid
    states = States.concatenate([scene.history, scene.future], axis=1)
    return states, np.concatenate([history, future], axis=1)
