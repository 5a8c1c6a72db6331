"""Decision of a run: pairs of its human-like futures, ``pairs.parquet`` and ``decision.json``."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from scex_sumo.base.files import replacing, write_atomic
from scex_sumo.results.decision import DECISION
from scex_sumo.results.participants import with_everybody
from scex_sumo.results.tables.columns import rows_in
from scex_sumo.results.tables.outcomes import CONFLICTS
from scex_sumo.results.tables.pairs import PAIRS_FILE, any_of
from scex_sumo.scene import HISTORY_STEPS, LOGGED_HISTORY, SeedScene, States

if TYPE_CHECKING:
    import pyarrow as pa

    from scex_sumo.results.run import Run

LISTED: Final = 1e-9
"""P from which JSON has a pair."""


def decide_run(run: Run, scene: SeedScene) -> None:
    """Write the pairs and the verdict of a run with human-like futures, see docs/decision.md."""
    from scex_sumo.conflicts.pairs import Conflicts
    from scex_sumo.decision.pairs import pair_table

    human = run.reference
    assert human is not None

    def states_of(future: int) -> States:
        """Return the states of one human-like future, with people."""
        driven = human.states(future)[:, LOGGED_HISTORY:].swapaxes(0, 1).repeat(1)
        return with_everybody(scene, driven)[0, HISTORY_STEPS:].swapaxes(0, 1)

    conflicts = rows_in(Conflicts, human.table(CONFLICTS))
    table = pair_table(scene, conflicts, futures=human.futures, states_of=states_of)
    write_decision(run.folder, table, futures=human.futures)


def human_like_answer(run: Run) -> dict[str, Any] | None:
    """Return the pairs for JSON, and P of a contact of any two without doubt; None without a reference."""
    if not (run.folder / PAIRS_FILE).is_file():
        return None
    rows = run.table(PAIRS_FILE).to_pylist()
    return {
        "futures": run.reference.futures if run.reference is not None else None,
        "any": any_of(row["probability"] for row in rows if not row["doubt"]),
        "pairs": [row for row in rows if row["probability"] >= LISTED],
    }


def write_decision(folder: Path, table: pa.Table, *, futures: int) -> None:
    """Write the pairs of a moment and the verdict into the folder of its run.

    Args:
        table: see `scex_sumo.results.tables.pairs.PAIRS`.
        futures: number of human-like futures.
    """
    import pyarrow.parquet as pq

    from scex_sumo.decision.decide import decide

    verdict = decide(table.to_pylist(), futures=futures)
    with replacing(folder / PAIRS_FILE) as temporary:
        pq.write_table(table, temporary)
    write_atomic(folder / DECISION, json.dumps(dataclasses.asdict(verdict)).encode())
