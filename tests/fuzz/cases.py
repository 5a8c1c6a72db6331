"""Cases of the fuzzer: our own example files, mutated, and the commands that read them."""

from __future__ import annotations

import hashlib
import math
import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from random import Random
from typing import Final

from tests.formats.commonroad.commonroad_maps import Lanelet, Vehicle, write_scenario
from tests.formats.levelx.levelx_files import Mover, write_highd
from tests.formats.openscenario.scenarios import (
    after,
    at,
    begins,
    change_lane,
    event,
    of,
    scenario,
    set_speed,
    story,
    tag,
    time,
)
from tests.formats.sumo.simulations import OUTPUTS
from tests.fuzz import drawn, suites
from tests.fuzz.forked import CACHE, Ended, run_forked
from tests.fuzz.mutations import NUMBERS, bytes_changed, column_changed, mutated
from tests.fuzz.sources import EXAMPLES, KEPT, Sources
from tests.fuzz.weights import EVIL, EXECUTED, write_mutated

MAPS = ("roundabout", "urban_intersection", "motorway_merge")
RUN = ("--futures", "2", "--steps", "5", "--no-plots", "-o", "new")
REFERENCE_EVERY = 8
"""Of so many cases of `run`, one runs the futures of the reference, too."""


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
        self.sources = Sources(folder)

    def case(self, kind: str, number: int) -> Case:
        """Make a case and run it."""
        rng = Random(f"{self._seed} {kind} {number}")
        work = self._folder / f"{kind}{number}"
        work.mkdir()
        how, arguments = KINDS[kind](self.sources, work, rng)
        if arguments[0] == "run" and number % REFERENCE_EVERY and "--reference" not in arguments:
            arguments += ["--reference", "none"]
        ended = run_forked(arguments, work)
        if kind == "kept" and ended.fine:
            same = ended.verdict == "result" and self.sources.is_finished(arguments[0], work)
            ended = ended if same else replace(ended, verdict="not resumed")
        if (work / EXECUTED).exists() or any(work.rglob(f"{WRITTEN}*")):
            ended = replace(ended, verdict="obeyed the file")
        if kind == "outputs" and suites.is_lost(work):
            ended = replace(ended, verdict="lost a file")
        if ended.fine:
            shutil.rmtree(work, ignore_errors=True)
        return Case(kind=kind, number=number, how=how, command=" ".join(arguments), ended=ended)


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


def _tracks(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    map_path, tracks = _copied(work, rng.choice(MAPS))
    how = _twice(tracks, rng)
    return how, rng.choice(
        (["run", map_path.name, *RUN], ["metrics", tracks.name], ["metrics", tracks.name, "--level", "pair"])
    )


def _map(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    map_path, _ = _copied(work, rng.choice(MAPS))
    how = _twice(map_path, rng)
    return how, rng.choice((["run", map_path.name, *RUN], ["convert", map_path.name, "-o", "new.net.xml"]))


def _commonroad(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
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


def _folder(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    shutil.copytree(sources.result(), work / "out")
    files = sorted(file for file in (work / "out").rglob("*") if file.is_file() and file.suffix in _FILES)
    file = rng.choice(files)
    if rng.random() < 0.1:
        file.unlink()
        how = "removed"
    else:
        how = _twice(file, rng)
    commands = (
        ["view", "out", "--write-only", "--future", "1"],
        ["view", "out", "--write-only", "--grid", "2"],
        ["export", "out", "--future", "1", "-o", "future.csv"],
        ["metrics", "out"],
        ["plot", "out", str(sources.result())],
    )
    return f"{file.relative_to(work / 'out')}: {how}", rng.choice(commands)


_FILES = (".json", ".parquet", ".csv", ".xml")


def _kept(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    """Something that an interrupted command kept is damaged; the same command must end as if nothing was."""
    command = rng.choice((*18 * ("run",), "rank", "validate"))
    shutil.copytree(sources.interrupted(command), work, dirs_exist_ok=True)
    place = {"run": ".parts/*", "rank": "[fps]*s/**/*", "validate": "moments/*/*"}[command]
    files = sorted(file for file in (work / "out").glob(place) if file.is_file())
    file = rng.choice(files)
    how = bytes_changed(file, rng, ("zero", "cut", "drop", "double", "garbage", "empty", "flip"))
    return f"{file.name}: {how}", list(KEPT[command])


def _edited(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    """A kept table or listing of `rank` or `validate`, edited by column, type, null or value."""
    command = rng.choice(("rank", "validate"))
    shutil.copytree(sources.interrupted(command), work, dirs_exist_ok=True)
    files = [file for file in (work / "out").rglob("*.*") if file.suffix in (".parquet", ".json")]
    file = rng.choice(sorted(files))
    return f"{file.relative_to(work / 'out')}: {_twice(file, rng)}", list(KEPT[command])


def _columns(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    """A column of a kept table changed, and a command that reads this table."""
    command = rng.choice((*_READ, "report", "rank", "validate"))
    if command in KEPT:
        arguments = list(KEPT[command])
        shutil.copytree(sources.interrupted(command), work, dirs_exist_ok=True)
    else:
        arguments = [command, "out", *([str(sources.result())] if command == "plot" else [])]
        shutil.copytree(sources.result(), work / "out")
    names = _READ.get(command, ("*",))
    file = rng.choice(sorted(f for name in names for f in (work / "out").rglob(f"{name}.parquet")))
    return f"{file.relative_to(work / 'out')}: {column_changed(file, rng)}", arguments


_READ: Final = {"plot": ("metrics",), "encounters": ("encounters",)}
"""Tables of a result folder that a command reads; others read all tables."""


def _highway(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    """A recording of highD's form, whose meta data are the map."""
    movers = [
        Mover(number=n, x=60.0 * n, y=-23.0 - 4.0 * (n % 2), speed=25.0, first=10 * n) for n in range(1, 5)
    ]
    movers += [Mover(number=9, x=300.0, y=-11.0, heading=math.pi, speed=30.0, kind="truck", length=12.0)]
    write_highd(work, movers)
    file = work / f"01_{rng.choice(('tracks', 'tracks', 'tracksMeta', 'recordingMeta'))}.csv"
    how = _twice(file, rng)
    return f"{file.name}: {how}", rng.choice(
        (["run", "01_recordingMeta.csv", "--time", "2", *RUN], ["metrics", "01_tracks.csv"])
    )


def _simulation(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    """A SUMO net, floating car data or a saved state."""
    shutil.copytree(sources.simulation(), work, dirs_exist_ok=True)
    file = work / rng.choice(("g.net.xml", "g.fcd.xml", "s.xml"))
    how = _twice(file, rng)
    wanted = {
        "g.net.xml": rng.choice((["--synthetic", "4"], ["--fcd", "g.fcd.xml"])),
        "g.fcd.xml": ["--fcd", "g.fcd.xml"],
        "s.xml": ["--tracks", "s.xml"],
    }
    return f"{file.name}: {how}", ["run", "g.net.xml", *wanted[file.name], *RUN]


WRITTEN = "written"
"""Beginning of the files that detectors of a net would write."""
_DETECTORS = (
    '<inductionLoop id="d{n}" lane="{lane}" pos="{x}" period="1" file="written{n}.xml"/>',
    '<laneAreaDetector id="d{n}" lane="{lane}" pos="{x}" length="20" period="1" file="written{n}.xml"/>',
    '<entryExitDetector id="d{n}" period="1" file="written{n}.xml"><detEntry lane="{lane}" pos="{x}"/>'
    '<detExit lane="{lane}" pos="{x}"/></entryExitDetector>',
    '<edgeData id="d{n}" file="written{n}.xml" begin="0" end="5"/>',
    '<include href="/etc/passwd"/>',
)


def _scenario(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    """A configuration of SUMO with files that would write others."""
    shutil.copytree(sources.scenario(), work, dirs_exist_ok=True)
    outputs = re.sub(r'\b(file|dest|output)="|(?<=file" value=")', lambda m: f"{m[0]}{WRITTEN}-", OUTPUTS)
    (work / "x.add.xml").write_text(outputs)
    (work / "more.add.xml").write_text("<additional/>")
    file = work / rng.choice(("mine.sumocfg", "mine.sumocfg", "g.net.xml", "r.rou.xml", "x.add.xml"))
    how = _twice(file, rng)
    commands = (
        ["run", "mine.sumocfg", "--time", "10", *RUN],
        ["rank", "mine.sumocfg", "--every", "4", "--from", "4", "--to", "10", "--futures", "4", *FEW],
        ["inspect", "mine.sumocfg"],
        ["convert", "mine.sumocfg", "-o", "new.net.xml"],
    )
    return f"{file.name}: {how}", rng.choice(commands)


FEW = ("--top", "1", "-o", "new")


def _drawn(
    write: Callable[[Path, Random], tuple[str, list[str]]],
) -> Callable[[Sources, Path, Random], tuple[str, list[str]]]:
    def case(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
        how, arguments = write(work, rng)
        return how, arguments + (list(RUN) if arguments[0] == "run" else [])

    return case


def _answers(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    """Outcomes of pairs, of either set of futures."""
    shutil.copytree(sources.answers(), work / "out")
    names = ("pair_outcomes.parquet", "collisions.parquet", "encounters.parquet")
    files = sorted({file for name in names for file in (work / "out").rglob(name)})
    file = rng.choice(files)
    how = "removed" if rng.random() < 0.05 else _twice(file, rng)
    if how == "removed":
        file.unlink()
    encounters = ["encounters", "out"]
    commands = (
        [*encounters, "--json"],
        [*encounters, "--pair", "10,12"],
        ["report", "out"],
        ["view", "out", "--write-only", "--encounter", "10,12"],
        ["run", "urban_intersection.osm", *sources.ANSWERS, "-o", "out"],
    )
    command = rng.choice(commands)
    if command[0] == "run":
        _copied(work, "urban_intersection")
    return f"{file.relative_to(work / 'out')}: {how}", command


def _detectors(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    """A net with detectors that write files, often mutated, too."""
    net = work / "g.net.xml"
    text = (sources.simulation() / net.name).read_text(encoding="utf-8")
    lanes = ("A0A1_0", "B1C1_1", "none_0")
    added = "".join(
        rng.choice(_DETECTORS).format(n=n, lane=rng.choice(lanes), x=rng.choice(NUMBERS))
        for n in range(rng.choice((1, 3, 20)))
    )
    net.write_text(text.replace("</net>", f"{added}</net>"), encoding="utf-8")
    how = "detectors; " + (_twice(net, rng) if rng.random() < 0.5 else "")
    commands = (["run", net.name, "--synthetic", "4", *RUN], ["convert", net.name, "-o", "new.net.xml"])
    return how, rng.choice(commands)


def _cache(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    """A damaged cache, or one that holds a pickle that is whole by its digest.

    Other entries that are whole are the user's own: the folder is private (`tests/base/test_owner_cache.py`).
    """
    map_path, _ = _copied(work, "urban_intersection")
    shutil.copytree(sources.cache(), work / CACHE)
    files = sorted(file for file in (work / CACHE).rglob("*") if file.is_file())
    file = rng.choice(files)
    how = rng.choice(("content", "content", "content", "pickle", "swapped", "folder", "link"))
    if how == "swapped":
        file.write_bytes(rng.choice(files).read_bytes())
    elif how in ("folder", "link"):
        file.unlink()
        file.mkdir() if how == "folder" else file.symlink_to("/etc/passwd")
    else:
        content = work / rng.choice(("content", "content.csv"))
        content.write_bytes(EVIL if how == "pickle" else file.read_bytes()[32:])
        how = how if how == "pickle" else _twice(content, rng)
        kept = hashlib.sha256(EVIL).digest() if how == "pickle" else file.read_bytes()[:32]
        file.write_bytes(kept + content.read_bytes())
    return f"{file.relative_to(work)}: {how}", ["run", map_path.name, *RUN]


def _weights(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    map_path, _ = _copied(work, "urban_intersection")
    how = write_mutated(work / "w.safetensors", rng)
    return how, ["run", map_path.name, *RUN, "--models", "graph_predictor:weights=w.safetensors"]


def _exports(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    """A future that we exported, mutated, and read again."""
    map_path, _ = _copied(work, "urban_intersection")
    shutil.copytree(sources.exports(), work, dirs_exist_ok=True)
    file = rng.choice([*sorted(work.glob("future.*")), *sorted(work.glob("[cs][rn]/*.[xp]*"))])
    how = _twice(file, rng)
    name = str(file.relative_to(work))
    own = [name] if "/" in name else [map_path.name, "--tracks", name]
    return f"{name}: {how}", rng.choice((["run", *own, *RUN], ["inspect", *own], ["metrics", name]))


def _openscenario(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    """A future as a scenario of OpenSCENARIO, or one of actions and triggers, or their road."""
    if rng.random() < 0.5:
        shutil.copytree(sources.exports() / "xo", work, dirs_exist_ok=True)
    else:
        near = of("Ego", tag("ReachPositionCondition", at(-1, 80), tolerance=1))
        turn = change_lane('<RelativeTargetLane entityRef="Ego" value="1"/>', "sinusoidal", 3.0)
        go = event("go", set_speed(5, "linear", "rate", 2), after(near))
        stories = story("Ego", go) + story("Other", event("turn", turn, after(time(1))))
        scenario(work, begins("Ego", at(-1, 50), 20) + begins("Other", at(-2, 200), 10), stories, stop_s=4)
    (case,), (road,) = work.glob("*.xosc"), work.glob("*.xodr")
    file = rng.choice((case, case, road))
    how = _twice(file, rng)
    own = [case.name, "--time", "1"]
    return f"{file.name}: {how}", rng.choice((["run", *own, *RUN], ["inspect", *own], ["metrics", case.name]))


def _trace(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    """A future as a trace of OSI, with other values or bytes."""
    for file in sources.exports().iterdir():
        if file.suffix in (".mcap", ".osi", ".xodr"):
            shutil.copy(file, work)
    file = work / rng.choice(("future.mcap", "trace.osi"))
    how = drawn.trace(file, rng) if rng.random() < 0.7 else _twice(file, rng)
    commands = (["run", file.name, *RUN], ["inspect", file.name], ["metrics", file.name])
    return f"{file.name}: {how}", rng.choice(commands)


def _options(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    map_path, _ = _copied(work, "urban_intersection")
    option = rng.choice(_OPTIONS)
    value = rng.choice((*NUMBERS, "all", "ttc=1", "1/TTC=nan", "3=replay", "5", "100000000", "x" * 3000))
    return f"{option} {value[:24]}", ["run", map_path.name, *RUN, f"{option}={value}"]


_OPTIONS: Final = (
    *("--futures", "--steps", "--replan", "--time", "--case", "--synthetic", "--origin", "--models"),
    *("--assign", "--threshold", "--metrics", "--seed", "--workers", "--region"),
    "--tracks",
)

KINDS: Final[Mapping[str, Callable[[Sources, Path, Random], tuple[str, list[str]]]]] = {
    "tracks": _tracks,
    "maps": _map,
    "commonroad": _commonroad,
    "weights": _weights,
    "folders": _folder,
    "options": _options,
    "kept": _kept,
    "edited": _edited,
    "columns": _columns,
    "highways": _highway,
    "simulations": _simulation,
    "detectors": _detectors,
    "caches": _cache,
    "scenarios": _scenario,
    "answers": _answers,
    "scenarionet": _drawn(drawn.scenarionet),
    "argoverse": _drawn(drawn.argoverse),
    "py123d": _drawn(drawn.py123d),
    "opendd": _drawn(drawn.opendd),
    "exports": _exports,
    "openscenario": _openscenario,
    "traces": _trace,
    "suites": suites.suite,
    "scenes": suites.scenes,
    "outputs": suites.outputs,
}
OFTEN: Final = (*2 * ("tracks", "maps", "commonroad", "weights", "folders", "options"), *KINDS)
"""Kinds in the order of a run: those whose cases are quick come more often."""
