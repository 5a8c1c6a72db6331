"""Human-like futures of a moment in memory, and its pairs: for ranking, watching and whole recordings."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa

from scex_sumo.base.arguments import checked
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.conflicts.pairs import Conflicts
from scex_sumo.converters.net.sumo_net import SumoNet
from scex_sumo.decision.pairs import pair_table
from scex_sumo.extrapolation.job import ruled, run_in_memory
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.results.participants import with_everybody
from scex_sumo.results.parts import Part
from scex_sumo.results.tables.columns import rows_in
from scex_sumo.scene import HISTORY_STEPS, SeedScene, States

STEPS: Final = 30
FUTURES: Final = 16
"""Human-like futures from which the pairs of a moment get their P."""


@cache
def _drivers(futures: int, seed: int) -> tuple[RunSettings, ModelSet]:
    settings = RunSettings(
        models="likely", futures=futures, seed=seed, steps=STEPS, metrics="gap", world="plain"
    )
    return settings, ModelSet.of(settings)


def human_part(scene: SeedScene, net: SumoNet, *, futures: int = FUTURES, seed: int = 0) -> Part:
    """Run human-like futures of a moment with their conflicts.

    Args:
        scene: with its road, ruled.
    """
    return run_in_memory(scene, net, *_drivers(futures, seed), on_paths=False, conflicts=True)


@checked
def moment_pairs(scene: SeedScene, *, futures: int = FUTURES, seed: int = 0) -> pa.Table:
    """Return the pairs of road users of a moment with P of a contact between people, the largest first.

    Args:
        scene: with its road.
        futures: human-like ones.

    Returns:
        One row for each pair, see `scex_sumo.decision.pairs.PAIRS`.

    Example:
        >>> pairs = scex.moment_pairs(scex.read_seed(scex.example_path("roundabout")), futures=4)
        >>> pairs["probability"][0].as_py() < 1e-3
        True
    """
    assert scene.road is not None
    with TemporaryFolder() as folder:
        net = converted(scene.road, Path(folder) / "road.net.xml")
        scene, net = ruled(scene, net, _drivers(futures, seed)[0])
        return pairs_of_part(scene, human_part(scene, net, futures=futures, seed=seed))


def pairs_of_part(scene: SeedScene, part: Part) -> pa.Table:
    """Return the pairs of a moment by its human-like futures, see `PAIRS`."""
    assert part.conflicts is not None

    def states_of(future: int) -> States:
        index = int(np.searchsorted(part.futures, future))
        return with_everybody(scene, part.states[index : index + 1])[0, HISTORY_STEPS:].swapaxes(0, 1)

    conflicts = rows_in(Conflicts, part.conflicts)
    return pair_table(scene, conflicts, futures=len(part.futures), states_of=states_of)
