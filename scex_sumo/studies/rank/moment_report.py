"""Reports of single moments of a ranking, from their children run once more."""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from scex_sumo.base.errors import ScexError
from scex_sumo.base.files import TemporaryFolder, write_atomic
from scex_sumo.extrapolation.engine import RunOptions, run_scene
from scex_sumo.extrapolation.workers import Workers
from scex_sumo.reports.page.contents import report_contents
from scex_sumo.reports.page.html import Html
from scex_sumo.reports.page.report import filled_report
from scex_sumo.reports.page.scene import scene_svg
from scex_sumo.studies.moments.run import MomentTask, unpack_road


@dataclass(frozen=True, kw_only=True)
class MomentReport:
    """A written report, and the picture of its scene."""

    path: Path
    picture: Html


def write_moment_report(
    task: MomentTask, command: Sequence[str], path: Path, workers: Workers
) -> MomentReport | None:
    """Run the children of a moment and write their report; None if they cannot be run.

    Args:
        task: the moment with its road.
        command: runs the moment by itself; its last word is the folder.
    """
    assert task.road is not None
    scene = dataclasses.replace(task.scene, road=unpack_road(task.road))
    settings = dataclasses.replace(task.settings.run, children=len(task.children))
    folder = TemporaryFolder()
    with folder:
        try:
            out = Path(folder.name) / "run"
            options = RunOptions(compared=False)
            run = run_scene(scene, settings, out=out, workers=workers, options=options)
        except ScexError:
            return None
        info, arrays = report_contents(run, scene)
        info |= {"folder": command[-1], "command": shlex.join(command)}
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, filled_report(run, info, arrays).encode())
        return MomentReport(path=path, picture=scene_svg(info, arrays))
