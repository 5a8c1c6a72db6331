"""A simulator of another package is one file, used by ``--world`` and its name."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq

import scex_sumo
from tests.command import ALONE
from tests.extensions.package import install, scex

CODE = '''
from pathlib import Path

from scex_sumo.world.plain import PlainSimulator


class Logged(PlainSimulator):
    """A plain world that writes where the first vehicle is."""

    def begin(self, batch):
        return Recorder(super().begin(batch))


class Recorder:
    def __init__(self, world):
        self._world = world

    def move(self, states, mask):
        self._world.move(states, mask)

    def move_obstacles(self, states, present):
        self._world.move_obstacles(states, present)

    def step(self):
        self._world.step()

    def read(self):
        states = self._world.read()
        with Path("positions.txt").open("a") as file:
            file.write(f"{states.x[0, 0]} {states.y[0, 0]}\\n")
        return states
'''
ROUNDABOUT = scex_sumo.example_path("roundabout")
OPTIONS = ("--futures", 3, "--steps", 5, "--no-report", *ALONE)


def test_a_world_of_another_package_is_used_by_its_name(tmp_path: Path) -> None:
    install(tmp_path, group="scex_sumo.worlds", name="logged", target="stranger:Logged", code=CODE)
    for world in ("logged", "plain"):
        done = scex(tmp_path, "run", ROUNDABOUT, *OPTIONS, "--world", world, "-o", world, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    tracks, plain = (pq.read_table(tmp_path / name / "tracks.parquet") for name in ("logged", "plain"))
    assert tracks.equals(plain)
    first = tracks.slice(10, 5)  # of the first vehicle after its second of history
    written = [
        tuple(map(float, line.split())) for line in (tmp_path / "positions.txt").read_text().split("\n")[:5]
    ]
    assert written == list(zip(first["x"].to_pylist(), first["y"].to_pylist(), strict=True))
    info = scex_sumo.open_run(tmp_path / "logged").info
    assert info["world"] == "logged"


def test_a_world_by_its_import_path_runs_its_reference_in_the_plain_one(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(CODE)
    options = ("--futures", 2, "--steps", 2, "--no-report", "--world", "mine:Logged", "-o", "out")
    done = scex(tmp_path, "run", ROUNDABOUT, *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert scex_sumo.open_run(tmp_path / "out" / "reference").info["world"] == "plain"
