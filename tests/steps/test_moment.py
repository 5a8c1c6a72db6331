"""Steps of a run: what is off leaves no file behind."""

from __future__ import annotations

from pathlib import Path

import scex_sumo as scex

STEPS = ("report.html", "reference", "pairs.parquet", "decision.json", "baseline")


def test_steps_that_are_off_take_their_files_away(tmp_path: Path) -> None:
    scene = scex.read_seed(scex.example_path("roundabout"))
    for report, reference in ((True, "likely"), (False, "likely"), (False, None)):
        scex.extrapolate(
            scene,
            futures=1,
            steps=1,
            under_test={8: "emergency_brake"},
            report=report,
            reference=reference,
            out=tmp_path,
        )
        there = [(tmp_path / name).exists() for name in STEPS]
        assert there == [report, *[reference is not None] * 3, True]
    scex.extrapolate(scene, futures=1, steps=1, report=False, reference=None, out=tmp_path, overwrite=True)
    assert not any((tmp_path / name).exists() for name in STEPS)
