"""A behaviour model of another package is one file: listed, checked and run by its name."""

from __future__ import annotations

import json
from pathlib import Path

from tests.command import ALONE
from tests.extensions.package import install, scex

MAP = Path(__file__).parents[2] / "scex_sumo/scenarios/data/roundabout.osm"
CODE = '''
import numpy as np

from scex_sumo.behaviors.driving.motion import drive_along


class Braker:
    """Brakes gently along its path."""

    def __init__(self, *, deceleration: float = 1.0) -> None:
        self.deceleration = deceleration

    def plan(self, history, road, who, rng):
        return drive_along(history, road, who, "straight", lambda *_: np.full(len(who), -self.deceleration))
'''


def test_a_model_of_another_package_drives_by_its_name(tmp_path: Path) -> None:
    install(tmp_path, group="scex_sumo.behaviors", name="braker", target="stranger:Braker", code=CODE)
    listed = scex(tmp_path, "models").stdout
    assert "braker" in listed and "Brakes gently" in listed
    wrong = scex(tmp_path, "run", MAP, "--synthetic", 3, "--models", "braker:speed=2")
    assert wrong.returncode == 2 and "braker: unknown parameter 'speed'; nearest:" in wrong.stderr
    out = tmp_path / "out"
    run = [MAP, "--synthetic", 3, "--futures", 2, "--steps", 10, "-o", out, "--workers", 1]
    done = scex(tmp_path, "run", *run, *ALONE, "--models", "braker:deceleration=2")
    assert done.returncode == 0, done.stderr
    said = json.loads((out / "run.json").read_text())
    assert "braker:deceleration=2" in json.dumps(said["models"])


def test_a_model_that_cannot_be_imported_leaves_the_others_listed(tmp_path: Path) -> None:
    install(
        tmp_path, group="scex_sumo.behaviors", name="braker", target="stranger:No", code="import nothing_here"
    )
    listed = scex(tmp_path, "models")
    assert listed.returncode == 0 and "standard_driver" in listed.stdout and "nothing_here" in listed.stdout
    asked = scex(tmp_path, "run", MAP, "--synthetic", 3, "--models", "braker")
    assert asked.returncode == 2 and asked.stderr.startswith("error: braker: stranger:No")
    assert "Traceback" not in asked.stderr
