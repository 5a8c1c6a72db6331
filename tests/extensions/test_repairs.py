"""A repair of another package is one function: it changes the seed scene, and its phrase is noted."""

from __future__ import annotations

import json
from pathlib import Path

from scex_sumo import example_path
from tests.command import ALONE
from tests.extensions.package import install, scex

CODE = """
from dataclasses import replace


def tracks(table, exact):
    longer = table.vehicles.with_columns(length=table.vehicles.length + 1.0)
    return replace(table, vehicles=longer), ("boxes lengthened by 1 m",)
"""


def seed_of(folder: Path, name: str) -> tuple[dict, list[str]]:
    options = ("--time", 4, "--futures", 1, "--models", "constant_velocity", *ALONE)
    done = scex(folder, "run", example_path("roundabout"), *options, "-o", folder / name)
    assert done.returncode == 0, done.stderr
    rows = (folder / name / "seed.csv").read_text().splitlines()
    length = rows[0].split(",").index("length")
    return json.loads((folder / name / "run.json").read_text()), [row.split(",")[length] for row in rows[1:]]


def test_a_repair_of_another_package_is_applied_and_noted(tmp_path: Path) -> None:
    before, lengths = seed_of(tmp_path, "before")
    install(tmp_path, group="scex_sumo.repairs", name="longer", target="stranger", code=CODE)
    after, longer = seed_of(tmp_path, "after")
    assert "boxes lengthened by 1 m" not in str(before) and "boxes lengthened by 1 m" in str(after)
    assert [round(float(b) - float(a), 6) for a, b in zip(lengths, longer, strict=True)] == [1.0] * len(
        longer
    )
