"""A population of another package is one function, used by its name."""

from __future__ import annotations

import json
from pathlib import Path

from scex_sumo import example_path
from tests.extensions.package import install, scex

CODE = """
from dataclasses import replace
from scex_sumo.generators.generate import recorded_population


def convoy(road, *, vehicles, **options):
    return replace(recorded_population(road, vehicles=vehicles, speed=2.0), name=f"convoy{vehicles}")
"""


def test_a_population_of_another_package_is_used_by_its_name(tmp_path: Path) -> None:
    install(tmp_path, group="scex_sumo.populations", name="convoy", target="stranger:convoy", code=CODE)
    options = (
        "--futures",
        1,
        "--models",
        "constant_velocity",
        "--reference",
        "none",
        "-o",
        tmp_path / "out",
    )
    done = scex(tmp_path, "run", example_path("roundabout"), "--synthetic", 3, "--as", "convoy", *options)
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "out/run.json").read_text())["seed_scene"]["name"] == "convoy3"
