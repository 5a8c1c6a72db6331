"""Plain world: what SUMO holds too, where SUMO drives nobody: states and metrics to the bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import scex_sumo
from scex_sumo.base.errors import UsageError
from scex_sumo.results.run import Run
from scex_sumo.scene import SeedScene
from tests.runs import extrapolate

MODELS = "rules,calibrated_driver,replay,risky_driver:path=random,constant_velocity:guard=true"


def in_both(scene: SeedScene, out: Path, **settings: object) -> list[Run]:
    worlds = ("sumo", "plain")
    return [extrapolate(scene, out=out / world, world=world, **settings) for world in worlds]


def assert_equal(runs: list[Run]) -> None:
    for name in ("tracks", "metrics"):
        sumo, plain = (getattr(run, name) for run in runs)
        assert sumo.column_names == plain.column_names
        for column in sumo.column_names:
            one, other = (table[column].to_numpy(zero_copy_only=False) for table in (sumo, plain))
            np.testing.assert_array_equal(other, one, err_msg=f"{name} {column}")


@pytest.mark.parametrize("models", ["paper", "graph_image_predictor:head=free,graph_predictor:mode=draw"])
def test_both_worlds_hold_the_same_with_networks(models: str, tmp_path: Path) -> None:
    scene = scex_sumo.read_seed(scex_sumo.example_path("roundabout"))
    assert_equal(in_both(scene, tmp_path, models=models, futures=12))


def test_both_worlds_hold_the_same_on_real_maps(data: Path, tmp_path: Path) -> None:
    for path in sorted([*data.glob("interaction/maps/*.osm"), *data.glob("taf_bw/maps/*.osm")])[::4]:
        scene = scex_sumo.synthetic_seed(path, vehicles=10)
        assert_equal(
            in_both(scene, tmp_path / path.stem, models="rules,calibrated_driver:path=random", futures=6)
        )


def test_sumo_drives_nobody_in_the_plain_world() -> None:
    scene = scex_sumo.read_seed(scex_sumo.example_path("roundabout"))
    with pytest.raises(UsageError, match=r"^world plain: sumo:EIDM is driven by SUMO"):
        extrapolate(scene, models="sumo:EIDM", world="plain", futures=2)
    with pytest.raises(UsageError, match=r"^world: got 'moon', needs plain, sumo$"):
        extrapolate(scene, world="moon", futures=2)
