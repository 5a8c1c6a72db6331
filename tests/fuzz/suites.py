"""Cases of suites, models of scenes and output paths: what comes from outside, and where results go."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import stat
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Final

from scex_sumo.generators.scene_model import SHIPPED
from tests.fuzz.mutations import bytes_changed, mutated
from tests.fuzz.sources import EXAMPLES, Sources

TEST: Final = ("test", "suite", "--under-test", "emergency_brake", "--futures", "4", "--workers", "1")
LINE: Final = "urban_intersection"


def suite(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    """The list of a suite, a file of a case (often with its digest), or the result to compare with."""
    shutil.copytree(sources.suite(), work, dirs_exist_ok=True)
    listing = work / "suite/suite.json"
    cases = [*work.glob("suite/cases/*/case.json"), *work.glob("suite/cases/*/seed.csv")]
    others = [*work.glob("suite/maps/*"), work / "test/test.json"]
    file = rng.choice([*3 * [listing], *sorted(cases), *others])
    how = mutated(file, rng)
    if file in cases and rng.random() < 0.5:
        content = json.loads(listing.read_text())
        name = file.relative_to(work / "suite").as_posix()
        for files in [content.get("files"), *(case.get("files") for case in content["cases"])]:
            for key in files or ():
                if name.endswith(key):
                    files[key] = hashlib.sha256(file.read_bytes()).hexdigest()
        listing.write_text(json.dumps(content))
        how += ", digest right"
    against = ["--against", "test/test.json"] if file.name == "test.json" or rng.random() < 0.2 else []
    one = ["--cases", rng.choice(sorted(case.parent.name for case in cases))]
    return f"{file.relative_to(work)}: {how}", [*TEST, *one, *against, "-o", "new"]


def scenes(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    """A model of scenes with other bytes, or another header."""
    shutil.copy(EXAMPLES / f"{LINE}.osm", work)
    file = work / "scenes.safetensors"
    shutil.copy(SHIPPED, file)
    if rng.random() < 0.5:
        how = bytes_changed(file, rng)
    else:
        content = file.read_bytes()
        size = 8 + int.from_bytes(content[:8], "little")
        header = work / "header.json"
        header.write_bytes(content[8:size])
        how = mutated(header, rng)
        new = header.read_bytes()
        file.write_bytes(len(new).to_bytes(8, "little") + new + content[size:])
    return how, ["generate", f"{LINE}.osm", "--scenes", file.name, "--count", "1", "-o", "new"]


def outputs(sources: Sources, work: Path, rng: Random) -> tuple[str, list[str]]:
    """An output path that is an input, a link to one, a folder, a device, or no name at all."""
    for ending in ("osm", "csv"):
        shutil.copy(EXAMPLES / f"{LINE}.{ending}", work)
    (work / "folder").mkdir()
    (work / "link.osm").symlink_to(f"{LINE}.osm")
    (work / "inside").symlink_to("folder")
    (work / "dangling").symlink_to("nowhere/else")
    (work / "foreign.txt").write_text("mine")
    os.mkfifo(work / "pipe")
    with suppress(PermissionError):
        os.mknod(work / "null", stat.S_IFCHR | 0o666, os.makedev(1, 3))
    shutil.copytree(sources.result(), work / "out")
    names = (
        *(
            f"{LINE}.osm",
            f"{LINE}.csv",
            f"./folder/../{LINE}.osm",
            "link.osm",
            "foreign.txt",
            "folder",
            "inside",
        ),
        *("dangling", "pipe", "null", "", ".", "folder/..", "a\nb", "x" * 300, "out"),
        *("foreign.txt/x", "out/run.json", "missing/deep/er", "-", "\u202e.csv", "out/metrics.parquet"),
    )
    path, to = rng.choice(names), rng.choice(("interaction", "fcd", "openscenario", "sumo", "gif"))
    commands = (
        ["convert", f"{LINE}.osm", f"-o={path}"],
        ["metrics", f"{LINE}.csv", f"-o={path}"],
        ["export", "out", "--future", "0", "--to", to, f"-o={path}"],
        ["generate", f"{LINE}.osm", "--count", "1", f"-o={path}", *rng.choice(([], ["--overwrite"]))],
        ["run", f"{LINE}.osm", "--futures", "2", "--steps", "5", "--no-plots", f"-o={path}"],
        ["plot", "out", f"-o={path}"],
    )
    command = [word.replace("-o=", "--out=", 1) for word in rng.choice(commands)]
    return f"output {path[:30]!r}", command


def is_lost(work: Path) -> bool:
    """Whether a command changed an input or a file of others."""
    sound = {
        f"{LINE}.osm": (EXAMPLES / f"{LINE}.osm").read_bytes(),
        f"{LINE}.csv": (EXAMPLES / f"{LINE}.csv").read_bytes(),
        "foreign.txt": b"mine",
    }
    return any(not (work / name).is_file() or (work / name).read_bytes() != sound[name] for name in sound)
