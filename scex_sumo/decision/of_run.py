"""Decision of a run: pairs of its human-like futures, ``pairs.parquet`` and ``decision.json``."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from scex_sumo.base.files import replacing, write_atomic
from scex_sumo.conflicts.pairs import Conflicts
from scex_sumo.decision.decide import decide
from scex_sumo.decision.pairs import pair_table
from scex_sumo.results.decision import DECISION
from scex_sumo.results.participants import with_everybody
from scex_sumo.results.run import Run
from scex_sumo.results.tables.columns import rows_in
from scex_sumo.results.tables.outcomes import CONFLICTS
from scex_sumo.results.tables.pairs import PAIRS_FILE
from scex_sumo.scene import HISTORY_STEPS, LOGGED_HISTORY, SeedScene, States


def decide_run(run: Run, scene: SeedScene) -> None:
    """Write the pairs and the verdict of a run with human-like futures, see docs/decision.md."""
    human = run.reference
    assert human is not None

    def states_of(future: int) -> States:
        """Return the states of one human-like future, with people."""
        driven = human.states(future)[:, LOGGED_HISTORY:].swapaxes(0, 1).repeat(1)
        return with_everybody(scene, driven)[0, HISTORY_STEPS:].swapaxes(0, 1)

    conflicts = rows_in(Conflicts, human.table(CONFLICTS))
    table = pair_table(scene, conflicts, futures=human.futures, states_of=states_of)
    write_decision(run.folder, table, futures=human.futures)


def write_decision(folder: Path, table: pa.Table, *, futures: int) -> None:
    """Write the pairs of a moment and the verdict into the folder of its run.

    Args:
        table: see `scex_sumo.results.tables.pairs.PAIRS`.
        futures: number of human-like futures.
    """
    verdict = decide(table.to_pylist(), futures=futures)
    with replacing(folder / PAIRS_FILE) as temporary:
        pq.write_table(table, temporary)
    write_atomic(folder / DECISION, json.dumps(dataclasses.asdict(verdict)).encode())
