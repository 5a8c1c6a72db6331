"""Cases of the fuzzer: our own example files, mutated, and the commands that read them."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Final

import scex_sumo
from tests.converters.commonroad.commonroad_maps import Lanelet, Vehicle, write_scenario
from tests.fuzz.forked import Ended, run_forked
from tests.fuzz.mutations import NUMBERS, mutated

EXAMPLES = Path(scex_sumo.__file__).parent / "scenarios/data"
MAPS = ("roundabout", "urban_intersection", "motorway_merge")
RUN = ("--children", "2", "--steps", "5", "--no-plots", "-o", "new")
REFERENCE_EVERY = 8
"""Of so many cases of `run`, one runs the 117 children of the reference, too."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One case: what was mutated how, what was run, and how it ended."""

    kind: str
    number: int
    how: str
    command: str
    ended: Ended


class Fuzzer:
    """Makes and runs cases in a folder; the same seed and number give the same case."""

    def __init__(self, folder: Path, seed: int = 0) -> None:
        self._folder, self._seed = folder, seed
        self._result: Path | None = None

    def case(self, kind: str, number: int) -> Case:
        """Make a case and run it."""
        rng = Random(f"{self._seed} {kind} {number}")
        work = self._folder / f"{kind}{number}"
        work.mkdir()
        how, arguments = KINDS[kind](self, work, rng)
        if arguments[0] == "run" and number % REFERENCE_EVERY:
            arguments += ["--reference", "none"]
        ended = run_forked(arguments, work)
        if ended.fine:
            shutil.rmtree(work, ignore_errors=True)
        return Case(kind=kind, number=number, how=how, command=" ".join(arguments), ended=ended)

    def result(self) -> Path:
        """A result folder, made once by a process of its own, so that nothing here has threads to lose."""
        if self._result is None:
            self._result = self._folder / "result"
            map_path = EXAMPLES / "urban_intersection.osm"
            command = [
                "run",
                str(map_path),
                "--children",
                "3",
                "--steps",
                "5",
                "--no-plots",
                "-o",
                str(self._result),
            ]
            subprocess.run([sys.executable, "-m", "scex_sumo", *command], check=True, capture_output=True)
        return self._result


def _twice(file: Path, rng: Random) -> str:
    return (
        "; ".join(mutated(file, rng) for _ in range(rng.choice((1, 1, 2))))
        if file.stat().st_size
        else "empty"
    )


def _copied(work: Path, name: str) -> tuple[Path, Path]:
    for ending in ("osm", "csv"):
        shutil.copy(EXAMPLES / f"{name}.{ending}", work)
    return work / f"{name}.osm", work / f"{name}.csv"


def _tracks(fuzzer: Fuzzer, work: Path, rng: Random) -> tuple[str, list[str]]:
    map_path, tracks = _copied(work, rng.choice(MAPS))
    how = _twice(tracks, rng)
    return how, rng.choice(
        (["run", map_path.name, *RUN], ["metrics", tracks.name], ["metrics", tracks.name, "--level", "worst"])
    )


def _map(fuzzer: Fuzzer, work: Path, rng: Random) -> tuple[str, list[str]]:
    map_path, _ = _copied(work, rng.choice(MAPS))
    how = _twice(map_path, rng)
    return how, rng.choice((["run", map_path.name, *RUN], ["convert", map_path.name, "-o", "new.net.xml"]))


def _commonroad(fuzzer: Fuzzer, work: Path, rng: Random) -> tuple[str, list[str]]:
    file = write_scenario(
        work / "two.xml",
        [
            Lanelet(1, left=[(0, 3), (50, 3)], right=[(0, 0), (50, 0)], successors=[2]),
            Lanelet(2, left=[(50, 3), (90, 3)], right=[(50, 0), (90, 0)], predecessors=[1]),
        ],
        vehicles=[
            Vehicle(10 + k, states=[(t, 8.0 * k + 0.1 * t * 10.0, 1.5, 0.0, 10.0) for t in range(60)])
            for k in range(3)
        ],
    )
    how = _twice(file, rng)
    return how, rng.choice((["run", file.name, *RUN], ["convert", file.name, "-o", "new.net.xml"]))


def _folder(fuzzer: Fuzzer, work: Path, rng: Random) -> tuple[str, list[str]]:
    shutil.copytree(fuzzer.result(), work / "out")
    files = sorted(file for file in (work / "out").rglob("*") if file.is_file() and file.suffix in _FILES)
    file = rng.choice(files)
    if rng.random() < 0.1:
        file.unlink()
        how = "removed"
    else:
        how = _twice(file, rng)
    metric = rng.choice(("ttc", "WTTC", "1/TTC"))
    commands = (
        ["view", "out", "--write-only", "--critical", metric],
        ["view", "out", "--write-only", "--grid", "2"],
        ["export", "out", "--child", "1", "-o", "child.csv"],
        ["metrics", "out"],
        ["explain", "out", "--no-plots"],
        ["compare", "out", str(fuzzer.result())],
    )
    return f"{file.relative_to(work / 'out')}: {how}", rng.choice(commands)


_FILES = (".json", ".parquet", ".csv", ".xml")


def _weights(fuzzer: Fuzzer, work: Path, rng: Random) -> tuple[str, list[str]]:
    from tests.fuzz.weights import write_mutated

    map_path, _ = _copied(work, "urban_intersection")
    how = write_mutated(work / "w.pt", rng)
    return how, ["run", map_path.name, *RUN, "--models", "graph_predictor:weights=w.pt"]


def _options(fuzzer: Fuzzer, work: Path, rng: Random) -> tuple[str, list[str]]:
    map_path, _ = _copied(work, "urban_intersection")
    option = rng.choice(_OPTIONS)
    value = rng.choice((*NUMBERS, "all", "ttc=1", "1/TTC=nan", "3=replay", "5", "100000000", "x" * 3000))
    return f"{option} {value[:24]}", ["run", map_path.name, *RUN, f"{option}={value}"]


_OPTIONS: Final = (
    *("--children", "--steps", "--replan", "--time", "--case", "--synthetic", "--origin", "--models"),
    *("--assign", "--until-band", "--threshold", "--metrics", "--seed", "--workers", "--batch", "--design"),
    "--tracks",
)

KINDS: Final[Mapping[str, Callable[[Fuzzer, Path, Random], tuple[str, list[str]]]]] = {
    "tracks": _tracks,
    "maps": _map,
    "commonroad": _commonroad,
    "weights": _weights,
    "folders": _folder,
    "options": _options,
}
