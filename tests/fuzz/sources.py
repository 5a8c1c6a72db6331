"""Sources of cases: files that commands and SUMO wrote, made once by processes of their own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Final

import scex_sumo
from scex_sumo.base.sumo.programs import environment, program
from tests.command import scex
from tests.formats.sumo.simulations import write_grid

EXAMPLES = Path(scex_sumo.__file__).parent / "scenarios/data"
RUN: Final = ("--futures", "3", "--steps", "5", "--no-plots", "--reference", "none")
KEPT: Final = {
    "run": ("run", "data/urban_intersection.osm", *RUN, "-o", "out"),
    "rank": ("rank", "data", "--every", "4", "--futures", "4", "--top", "1", "-o", "out"),
    "validate": ("validate", "data", "--every", "4", "--futures", "4", "-o", "out"),
}
"""Commands that keep what is finished; they run in a folder that has the recording in ``data``."""
RESULTS: Final = {"run": "metrics.parquet", "rank": "ranking.csv", "validate": "values.parquet"}
"""A file of theirs that an interruption does not change."""
EXPORTS: Final = {
    "interaction": "future.csv",
    "fcd": "future.fcd.xml",
    "commonroad": "cr",
    "scenarionet": "sn",
    "omega-prime": "future.mcap",
    "osi": "trace.osi",
    "openscenario": "xo",
}
_INTERRUPTED = (
    "from scex_sumo.results.folder import OutputFolder as F\n"
    "from scex_sumo.cli import main; import sys\n"
    "def stop(*_, **__): raise KeyboardInterrupt\n"
    "F.finish = stop; sys.argv = ['scex-sumo', *sys.argv[1:]]; main()"
)
_FLOWS = """<routes>
 <vType id="car" vClass="passenger"/><vType id="truck" vClass="truck"/>
 <flow id="f" type="car" begin="0" end="30" period="3" from="A0A1" to="C1C2" departLane="best"/>
 <flow id="t" type="truck" begin="0" end="30" period="7" from="C0B0" to="A1A2"/>
</routes>"""


class Sources:
    """Folders with files to be mutated; each is made when it is first asked for."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    @cache  # noqa: B019
    def result(self) -> Path:
        """A result folder."""
        folder = self._folder / "result"
        command = ("run", str(EXAMPLES / "urban_intersection.osm"), *RUN, "-o", str(folder))
        scex(*command).check_returncode()
        return folder

    @cache  # noqa: B019
    def exports(self) -> Path:
        """A folder with the second future of the result, in each format that we read."""
        folder = self._folder / "exports"
        folder.mkdir()
        for to, name in EXPORTS.items():
            words = ("export", str(self.result()), "--future", "1", "--to", to, "-o", str(folder / name))
            scex(*words).check_returncode()
        return folder

    ANSWERS: Final = ("--futures", "64", "--steps", "20", "--no-plots")

    @cache  # noqa: B019
    def answers(self) -> Path:
        """A result folder with both sets of futures."""
        folder = self._folder / "answers"
        scex("run", EXAMPLES / "urban_intersection.osm", *self.ANSWERS, "-o", folder).check_returncode()
        return folder

    @cache  # noqa: B019
    def suite(self) -> Path:
        """A folder with a test suite, and ``test``, the result of a driving function."""
        folder = self._recording("suites")
        scex("catalogue", "data", "--every", 2, "--count", 5, "--to", "none", "-o", "suite", cwd=folder)
        words = ("test", "suite", "--under-test", "emergency_brake", "--futures", 4, "--workers", 1)
        scex(*words, "-o", "test", cwd=folder).check_returncode()
        return folder

    @cache  # noqa: B019
    def scenario(self) -> Path:
        """A configuration of SUMO on a grid, ``mine.sumocfg``, with ``x.add.xml`` that is not there yet."""
        folder = self._folder / "scenario"
        folder.mkdir()
        files = '<additional-files value="x.add.xml"/>'
        write_grid(folder, files=files, output='<fcd-output value="written-fcd.xml"/>', end=30)
        return folder

    @cache  # noqa: B019
    def finished(self, command: str) -> bytes:
        """What a command of `KEPT` ends with where nothing is broken."""
        folder = self._recording(f"finished-{command}")
        scex(*KEPT[command], cwd=folder).check_returncode()
        return (folder / "out" / RESULTS[command]).read_bytes()

    def is_finished(self, command: str, folder: Path) -> bool:
        """Whether a command of `KEPT` ended in a folder as where nothing is broken."""
        return (folder / "out" / RESULTS[command]).read_bytes() == self.finished(command)

    @cache  # noqa: B019
    def interrupted(self, command: str) -> Path:
        """What a command of `KEPT` leaves that is interrupted before its last step."""
        folder = self._recording(f"interrupted-{command}")
        words = [sys.executable, "-c", _INTERRUPTED, *KEPT[command]]
        status = subprocess.run(words, cwd=folder, check=False, capture_output=True).returncode
        assert status == 130, f"{command} ended with {status}, not as interrupted"
        return folder

    @cache  # noqa: B019
    def simulation(self) -> Path:
        """Traffic on a grid: the net, its state at 12 s and floating car data."""
        folder = self._folder / "simulation"
        folder.mkdir()
        (folder / "r.rou.xml").write_text(_FLOWS)
        grid = ["--grid", "--grid.number", "3", "--grid.length", "80", "-L", "2", "-o", "g.net.xml"]
        files = ["-n", "g.net.xml", "-r", "r.rou.xml", "--fcd-output", "g.fcd.xml"]
        files += ["--save-state.files", "s.xml", "--save-state.times", "12", "--end", "16"]
        for name, options in (("netgenerate", grid), ("sumo", [*files, "--step-length", "0.5"])):
            words = [program(name), *options]
            subprocess.run(words, cwd=folder, check=True, capture_output=True, env=environment())
        return folder

    @cache  # noqa: B019
    def cache(self) -> Path:
        """The user's caches after a run on the recording, by the path that cases give."""
        folder = self._recording("cached")
        caches = folder / "caches"
        command = ("run", "urban_intersection.osm", *RUN, "-o", "out")
        words = [sys.executable, "-m", "scex_sumo", *command]
        places = {**os.environ, "XDG_CACHE_HOME": str(caches)}
        subprocess.run(words, cwd=folder / "data", check=True, capture_output=True, env=places)
        return caches

    def _recording(self, name: str) -> Path:
        folder = self._folder / name
        (folder / "data").mkdir(parents=True)
        for ending in ("osm", "csv"):
            shutil.copy(EXAMPLES / f"urban_intersection.{ending}", folder / "data")
        return folder
