"""Plans that are not the models' own are counted the same, whatever batches their futures ran in."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scex_sumo.results.folder import ResultFolder
from scex_sumo.results.parts import save_part
from scex_sumo.results.tables.fallbacks import fallbacks_table
from tests.results.test_folder import part_of

NAMES = ["standard_driver", "mine"]
ASSIGNMENT = np.array([[0, 1], [1, 1], [1, 0]])
TRACKS = np.array([17, 23])


def table_of(*rows: tuple[int, int, int, str]):  # type: ignore[no-untyped-def]
    """Table of rows of future, vehicle, step and reason."""
    if not rows:
        return None
    replaced = [(c, step, vehicle, NAMES[ASSIGNMENT[c, vehicle]], why) for c, vehicle, step, why in rows]
    return fallbacks_table(replaced, TRACKS)


def test_rows_are_ordered_and_name_vehicle_and_model() -> None:
    table = table_of((2, 0, 5, "late"), (1, 1, 0, "lost"), (1, 0, 0, "lost"))
    assert table.to_pydict() == {
        "future": [1, 1, 2],
        "track_id": [17, 23, 17],
        "step": [0, 0, 5],
        "model": ["mine"] * 3,
        "reason": ["lost", "lost", "late"],
    }


def test_batches_of_any_size_leave_the_same_table(tmp_path: Path) -> None:
    import dataclasses

    rows = [(2, 0, 5, "late"), (1, 1, 0, "lost"), (1, 0, 10, "lost")]

    def collected(name: str, *batches: list[int]):  # type: ignore[no-untyped-def]
        folder = ResultFolder(tmp_path / name, {"seed": 1})
        for batch in batches:
            own = table_of(*(row for row in rows if row[0] in batch))
            save_part(folder.path, dataclasses.replace(part_of(batch), fallbacks=own))
        return next(folder.in_order(3, size=3)).fallbacks

    whole = collected("whole", [0, 1, 2])
    assert whole.num_rows == 3
    assert collected("split", [2], [0, 1]).equals(whole)
    assert collected("single", [2], [1], [0]).equals(whole)
