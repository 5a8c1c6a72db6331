"""Risk of a moment: who leads, what a vehicle's P is, names and ghosts of a simulation that stands still."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np

from scex_sumo.live.risk import PairRisk, Question, Risk, assess
from tests.command import script
from tests.formats.sumo.simulations import start_words, write_grid

PAIR = PairRisk(hits="a", other="b", kind="crossing", human_like=0.1, stress=0.5)


def risk(*pairs: PairRisk) -> Risk:
    return Risk(time_s=1.0, pairs=pairs, vehicles=("a", "b", "c"))


def test_a_pair_with_doubtful_data_neither_leads_nor_counts() -> None:
    doubtful = replace(PAIR, human_like=0.9, doubt="boxes overlap")
    assert risk(doubtful, PAIR).worst == PAIR and risk(doubtful).worst is None
    assert risk(doubtful).of("a") == 0.0


MOMENT = """
import pickle, sys
import libsumo as sumo
from scex_sumo.live.watch import Watch
sumo.start({start})
watch = Watch(sumo, None)
sumo.simulationStep(30)
for _ in range(11):
    sumo.simulationStep()
pickle.dump((watch.moment(), sumo.vehicle.getIDList()), open("moment", "wb"))
"""


def test_a_moment_travels_and_its_pairs_have_sumos_names(tmp_path: Path) -> None:
    write_grid(tmp_path)
    script(MOMENT.format(start=start_words()), cwd=tmp_path).check_returncode()
    moment, names = pickle.loads((tmp_path / "moment").read_bytes())
    found = assess(moment, Question(futures=4))
    assert found.time_s == 31.1 and set(found.vehicles) <= set(names) and found.pairs
    assert {pair.hits for pair in found.pairs} <= set(found.vehicles)
    assert all(pair.stress in (0.0, 0.25, 0.5, 0.75, 1.0) for pair in found.pairs)
    assert set(found.ghosts) <= set(found.vehicles)
    for shape in found.ghosts.values():
        assert shape.shape[1:] == (5, 2) and np.array_equal(shape[:, 0], shape[:, 4])
