"""Folder of a ranking: moments of the recordings and their pairs, found again after an interruption."""

from __future__ import annotations

import pyarrow as pa

from scex_sumo.decision.moment import FUTURES as HUMAN_FUTURES
from scex_sumo.extrapolation.job import ruled
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.encounters import pairs_of_moment
from scex_sumo.studies.moments.folder import Failure, Listing, MomentRef, StudyFolder, as_row, from_row
from scex_sumo.studies.moments.run import MomentTask, attempt, net_of

REPORTS = "moments"
"""Folder of the reports of the moments that are shown."""
_PAIRS, _SEEDS = "pairs", "seeds"


def run_moment(task: MomentTask, road: bytes | None = None) -> pa.Table | Failure:
    """Return the pairs of a moment, on its road or the one given; or its failure."""
    return attempt(_run, task, road)


def _run(task: MomentTask, scene: SeedScene, road: bytes) -> pa.Table:
    scene, net = ruled(scene, net_of(road, task.settings.cache), task.settings.run)
    return pairs_of_moment(scene, net, futures=HUMAN_FUTURES, seed=task.settings.run.seed)


class RankFolder(StudyFolder):
    """Folder of a ranking under way: ``pairs/location=L/seed=S/pairs.parquet``."""

    info, what = "rank.json", "ranking"
    another = "another ranking, of other recordings or with other options"
    evidence = ("ranking.parquet", "ranking.csv", _SEEDS)
    trees, records = (_PAIRS,), (_SEEDS,)
    kept = ("ranking.parquet", "ranking.csv", "moments.parquet", "moments.csv", "ranking.html", REPORTS)

    def listing(self, recording: str) -> Listing | None:
        """Return the moments of a recording; None if it is not listed, or the file is damaged."""
        rows = self._load(_SEEDS, recording)
        refs = None if rows is None else tuple(MomentRef(**from_row(row)) for row in rows)
        return None if refs is None else Listing(recording=recording, moments=refs)

    def save_listing(self, listing: Listing) -> None:
        """Keep the moments of a recording."""
        self._save(_SEEDS, listing.recording, [as_row(ref) for ref in listing.moments])

    def has(self, ref: MomentRef) -> bool:
        """Whether the pairs of a moment are there."""
        return self._has(ref.moment, _PAIRS)

    def save(self, ref: MomentRef, pairs: pa.Table) -> None:
        """Keep the pairs of a moment, unless they are there."""
        if not self.has(ref):
            # Of so few rows, statistics and schema would be the larger part.
            self._add(ref.moment, _PAIRS, {_file(ref): pairs}, write_statistics=False, store_schema=False)

    def pairs(self, ref: MomentRef) -> pa.Table:
        """Read the pairs of a moment."""
        return self._read(ref.moment, _PAIRS, _file(ref))


def _file(ref: MomentRef) -> str:
    return f"{_PAIRS}/location={ref.location}/seed={ref.moment}/{_PAIRS}.parquet"
