"""Run of a ranking in its folder: the pairs of all moments."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import pyarrow as pa

from scex_sumo.decision.moment import FUTURES as HUMAN_FUTURES
from scex_sumo.extrapolation.job import ruled
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.encounters import pairs_of_moment
from scex_sumo.studies.moments.folder import SEEDS, MomentRef, StudyFolder
from scex_sumo.studies.moments.run import MomentTask, net_of
from scex_sumo.studies.moments.study import MomentRun

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
