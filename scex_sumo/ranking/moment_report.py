"""Reports of single moments of a ranking: their children, run once more, to be looked at."""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from scex_sumo.errors import ScexError
from scex_sumo.extrapolation.extrapolate import SETTINGS, extrapolate
from scex_sumo.extrapolation.workers.pool import Workers
from scex_sumo.files import TemporaryFolder, write_atomic
from scex_sumo.ranking.run_moment import MomentTask, unpack_road
from scex_sumo.reports.page.html import Html
from scex_sumo.reports.page.report import filled_report
from scex_sumo.reports.page.run.contents import report_contents
from scex_sumo.reports.page.scene_svg import scene_svg


@dataclass(frozen=True, kw_only=True)
class MomentReport:
    """A report that has been written, and the picture of its scene."""

    path: Path
    picture: Html


def write_moment_report(
    task: MomentTask, command: Sequence[str], path: Path, workers: Workers
) -> MomentReport | None:
    """Run the children of a moment and write their report; None where they cannot be run.

    Args:
        task: the moment, its road and its children.
        command: that runs the moment by itself; its last word is the folder.
        path: of the report.
        workers: processes that share the children.
    """
    assert task.road is not None
    scene = dataclasses.replace(task.scene, road=unpack_road(task.road))
    settings = {name: getattr(task.settings.run, name) for name in SETTINGS}
    folder = TemporaryFolder()
    with folder:
        try:
            out = Path(folder.name) / "run"
            settings["children"] = len(task.children)
            run = extrapolate(scene, out=out, workers=workers, compared=False, **settings)
        except ScexError:
            return None
        info, arrays = report_contents(run, scene)
        info |= {"folder": command[-1], "command": shlex.join(command)}
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, filled_report(run, info, arrays).encode())
        return MomentReport(path=path, picture=scene_svg(info, arrays))
