"""Cost of people: 12 vehicles with 20 people that decide for themselves, beside 32 vehicles, interleaved.

Processor time of a run's simulation and metrics, after a first run that is not counted.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import scex_sumo as scex


def main(
    map_path: Annotated[Path, typer.Argument()] = scex.example_path("urban_intersection"),  # noqa: B008
    futures: int = 64,
    repeat: int = 3,
    models: str = "likely",
) -> None:
    """Print the medians of both, and their ratio."""
    some, many = (
        scex.synthetic_seed(map_path, vehicles=count, people=people, like="recorded")
        for count, people in ((12, 20), (32, 0))
    )
    for scene in (some, many):
        _spent(scene, 2, models)
    rows = [(_spent(some, futures, models), _spent(many, futures, models)) for _ in range(repeat)]
    with_people, vehicles = np.median(rows, axis=0)
    print(f"12 vehicles and 20 people {with_people:.2f} s, 32 vehicles {vehicles:.2f} s of processor time")
    print(f"ratio {with_people / vehicles:.2f}; of single pairs {[round(a / b, 2) for a, b in rows]}")


def _spent(scene: scex.SeedScene, futures: int, models: str) -> float:
    with tempfile.TemporaryDirectory() as folder:
        start = sum(os.times()[:4])
        scex.extrapolate(
            scene,
            futures=futures,
            models=models,
            reference="none",
            response=None,
            report=False,
            workers=1,
            vru="model",
            out=Path(folder) / "out",
        )
        return sum(os.times()[:4]) - start


if __name__ == "__main__":
    typer.run(main)
