"""Run of a ranking in its folder: the pairs of all moments; its tables."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from scex_sumo.base.errors import TrackError
from scex_sumo.base.files import replacing
from scex_sumo.decision.decide import span
from scex_sumo.decision.moment import FUTURES as HUMAN_FUTURES
from scex_sumo.extrapolation.job import ruled
from scex_sumo.page.document import Column, Row
from scex_sumo.results.tables.columns import schema
from scex_sumo.results.tables.pairs import any_of, arrow, one_in
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.encounters import pairs_of_moment
from scex_sumo.studies.moments.folder import SEEDS, MomentRef, StudyFolder, as_row
from scex_sumo.studies.moments.run import MomentTask, net_of
from scex_sumo.studies.moments.study import MIN_VEHICLES, MomentRun

REPORTS = "moments"
"""Folder of the reports of the moments that are shown."""
_PAIRS = "pairs"


class RankingRun(MomentRun):
    """A ranking under way."""

    folder: RankFolder

    @cached_property
    def pairs(self) -> Sequence[tuple[MomentRef, pa.Table]]:
        """Pairs of all moments, once these have run."""
        return [(ref, self.folder.pairs(ref)) for ref in self.refs]


def run_moment(task: MomentTask, scene: SeedScene) -> pa.Table:
    """Return the pairs of a moment."""
    scene, net = ruled(scene, net_of(task.road), task.settings.run)
    return pairs_of_moment(scene, net, futures=HUMAN_FUTURES, seed=task.settings.run.seed)


class RankFolder(StudyFolder):
    """Folder of a ranking under way: ``pairs/location=L/seed=S/pairs.parquet``."""

    info, what = "rank.json", "ranking"
    another = "another ranking, of other recordings or with other options"
    evidence = ("ranking.parquet", "ranking.csv", SEEDS)
    trees = (_PAIRS,)
    kept = ("ranking.parquet", "ranking.csv", "moments.parquet", "moments.csv", "ranking.html", REPORTS)

    def save(self, ref: MomentRef, pairs: pa.Table) -> None:
        """Keep the pairs of a moment, unless they are there."""
        if not self.has(ref):
            # Of so few rows, statistics and schema would be the larger part.
            self._add(ref.moment, {_file(ref): pairs}, write_statistics=False, store_schema=False)

    def pairs(self, ref: MomentRef) -> pa.Table:
        """Read the pairs of a moment."""
        return self._read(ref.moment, _file(ref))


def _file(ref: MomentRef) -> str:
    return f"{_PAIRS}/location={ref.location}/seed={ref.moment}/{_PAIRS}.parquet"


MOMENTS: Final = schema("seed location recording case time_s human_p_collision vehicles failure")
"""Columns of ``moments.parquet``."""


def moments_table(run: RankingRun) -> pa.Table:
    """Return the moments of a ranking by P of any contact, largest first; then those that failed."""
    failed = [*run.unreadable.values(), *(failure for _, failure in sorted(run.failures.items()))]
    if not run.pairs:
        reason = f"; the first of {len(failed)} failures: {failed[0].reason}" if failed else ""
        raise TrackError(
            f"none of {len(run.recordings)} recordings has a moment with {MIN_VEHICLES} moving "
            f"vehicles that could be run{reason}; lower --every, or look at the recordings"
        )
    rows = []
    for ref, pairs in run.pairs:  # P of a contact of any pair whose data are not doubtful
        sure = pairs.filter(pc.is_null(pairs["doubt"]))["probability"].to_pylist()
        rows.append(as_row(ref) | {"human_p_collision": any_of(sure)})
    rows.sort(key=lambda row: (-row["human_p_collision"], row["seed"]))
    rows += [as_row(failure) | {"failure": failure.reason} for failure in failed]
    return pa.Table.from_pylist(rows, schema=MOMENTS)


def stress_words(row: Row) -> str | None:
    """Return the share of the stress test in which a pair collides; None where no futures were run."""
    share = row["stress_p_collision"]
    return None if share is None else f"{share:.0%}"


PAGE_COLUMNS: Final = (
    Column("rank", "place"),
    Column(arrow, "pair", "words", "Hits or follows → the other one"),
    Column("what", "what", "words"),
    Column("how", "how it comes to it", "words"),
    Column("location", "site", "words"),
    Column("recording", "recording", "words"),
    Column("time_s", "time", "seconds", "In the recording, of its most critical moment"),
    Column("probability", "people collide", "often", "P of a contact within 3 s"),
    Column("needed_braking", "needed braking", "tenths", "In the future that decides, m/s²"),
    Column("time_margin", "time margin", "seconds", "In the future that decides"),
    Column("conflict_s", "after", "seconds", "Time of the conflict after the moment"),
    Column("stress_p_collision", "stress test", "percent", "P(collision) with the drawn models"),
    Column("doubt", "doubt", "words"),
    Column(lambda row: "yes" if row["to_test"] else "no", "to test", "words"),
    Column("verdict", "verdict", "words"),
)
"""Columns of encounters on the page."""


PRINTED_COLUMNS: Final = (
    Column("rank", "rank"),
    Column(arrow, "pair", "words"),
    Column("what", "what", "words"),
    Column("how", "how it comes to it", "words"),
    Column(lambda row: f"{row['recording']} {row['case']}".rstrip(), "recording", "words"),
    Column("time_s", "time", "seconds"),
    Column(lambda row: one_in(row["probability"]), "people: 1 in", "text"),
    Column(span, "range", "words"),
    Column(stress_words, "stress", "text"),
)
"""Columns of encounters in the terminal."""


def write_table(path: Path, table: pa.Table) -> None:
    """Write a table as Parquet and CSV, by a path without suffix."""
    with replacing(path.with_name(f"{path.name}.parquet")) as file:
        pq.write_table(table, file, compression="zstd")
    with replacing(path.with_name(f"{path.name}.csv")) as file:
        pa_csv.write_csv(table, file)
