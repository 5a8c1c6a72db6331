"""The recorded future in other tools' formats: what was recorded, as long as it was."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.converters.datasets.recordings import read_recorded
from scex_sumo.exporters.command import export_command
from scex_sumo.exporters.request import EXPORTERS, RECORDED, Request
from scex_sumo.results.run import Run
from scex_sumo.scene import HISTORY_STEPS


@pytest.mark.parametrize("to", ["omega-prime", "commonroad"])
def test_the_states_read_back_are_the_recorded_ones(run: Run, tmp_path: Path, to: str) -> None:
    pytest.importorskip("betterosi" if to == "omega-prime" else "lxml")
    export_command(run.folder, recorded=True, to=to, out=tmp_path)
    (file,) = [path for path in tmp_path.iterdir() if path.suffix in (".mcap", ".xml")]
    rows, scene = read_recorded([file])[0].vehicles, run.scene
    assert scene.future is not None and scene.future_valid is not None
    steps = int(run.info["steps"])
    for v, track in enumerate(scene.track_ids.tolist()):
        mine = rows.track == list(rows.labels).index(str(track))
        there = scene.future_valid[v, :steps]  # one leaves before the end
        x = np.concatenate([scene.history.x[v, 1:], scene.future.x[v, :steps][there]])
        assert mine.sum() == HISTORY_STEPS + there.sum()
        np.testing.assert_allclose(rows.x[mine], x, atol=1e-4)


def test_without_a_recorded_future_or_its_format_one_line_says_so(run: Run, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"--recorded: not with --to mp4; openscenario, commonroad"):
        export_command(run.folder, recorded=True, to="mp4", out=tmp_path)
    request = Request(run=run, futures=(RECORDED,), out=tmp_path)
    request.__dict__["scene"] = replace(run.scene, future=None, future_valid=None)
    with pytest.raises(UsageError, match=r"--recorded: the seed scene \S+ has no recorded future"):
        EXPORTERS.load("scenarionet")(request)
