"""Decision as an extra of a run: pairs of the human-like futures, ``pairs.parquet`` and ``decision.json``."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

from scex_sumo.base.errors import ResultError
from scex_sumo.base.files import replacing, write_atomic
from scex_sumo.extrapolation.extras import Extra, Work
from scex_sumo.results.extras import Decision
from scex_sumo.results.participants import with_everybody
from scex_sumo.results.tables.conflicts import CONFLICTS, conflicts_of
from scex_sumo.results.tables.pairs import PAIRS_FILE, any_of
from scex_sumo.scene import HISTORY_STEPS, LOGGED_HISTORY, States

if TYPE_CHECKING:
    import pyarrow as pa

    from scex_sumo.results.run import Run

DECISION_FILE: Final = "decision.json"


@dataclass(frozen=True, kw_only=True)
class DecisionStep(Extra):
    """Verdict on the moment of a run, from its human-like futures, see docs/decision.md."""

    order: ClassVar[int] = 25  # after the reference
    nested: ClassVar[bool] = False
    files: ClassVar[tuple[str, ...]] = (PAIRS_FILE, DECISION_FILE)

    def finish(self, run: Run, work: Work) -> Mapping[str, Path]:
        """Write the pairs and the decision."""
        human = run.reference
        if human is None or work.is_reference:
            return {}
        from scex_sumo.decision.pairs import pair_table

        scene = work.job.scene

        def states_of(future: int) -> States:
            """Return the states of one human-like future, with people."""
            driven = human.states(future)[:, LOGGED_HISTORY:].swapaxes(0, 1).repeat(1)
            return with_everybody(scene, driven)[0, HISTORY_STEPS:].swapaxes(0, 1)

        found = conflicts_of(human.table(CONFLICTS))
        table = pair_table(scene, found, futures=human.futures, states_of=states_of)
        write_decision(run.folder, table, futures=human.futures)
        return {}

    def decision(self, run: Run) -> Decision | None:
        """Return the verdict of a finished run."""
        file = run.folder / DECISION_FILE
        if not file.is_file():
            return None
        try:
            content = json.loads(file.read_bytes())
            return Decision(**content | {"pair": content["pair"] and tuple(content["pair"])})
        except (OSError, ValueError, KeyError, TypeError, AssertionError) as error:
            raise ResultError(f"{file}: cannot be read ({str(error)[:80]}); run again") from None

    def answer(self, run: Run) -> Mapping[str, Any]:
        """Return ``human_like``: the pairs, and P of a contact of any two without doubt."""
        table = pairs_of_run(run)
        if table is None:
            return {"human_like": None}
        sure = [row for row in table.to_pylist() if not row["doubt"]]
        return {
            "human_like": {
                "futures": run.reference.futures if run.reference is not None else None,
                "any": any_of(row["probability"] for row in sure),
                "pairs": [row for row in table.to_pylist() if row["probability"] >= LISTED],
            }
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
    write_atomic(folder / DECISION_FILE, json.dumps(dataclasses.asdict(verdict)).encode())


LISTED: Final = 1e-9
"""P from which JSON has a pair."""


def pairs_of_run(run: Run) -> pa.Table | None:
    """Return the pairs of a finished run, see `tables.pairs.PAIRS`; None without a reference."""
    return run.table(PAIRS_FILE) if (run.folder / PAIRS_FILE).is_file() else None
