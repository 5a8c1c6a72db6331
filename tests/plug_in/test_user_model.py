"""Models by import path and by another package's entry point."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.drivers.listing import known_models
from scex_sumo.drivers.registry import build, known_names, parse_models
from scex_sumo.plug_in.predictor import Predictor

DRIVERS = '''
import numpy as np


class Parked:
    """Stays where it is."""

    def __init__(self, *, steps=30):
        self.steps = steps

    def plan(self, history, road, who, rng):
        raise NotImplementedError


class OneByOne:
    def plan_one(self, history, road, future, vehicle, rng):
        raise NotImplementedError


class Refuses:
    def __init__(self):
        raise FileNotFoundError("no weights.bin")

    def plan(self, history, road, who, rng): ...


def onward(history, *, factor=1.0):
    """On and on."""


def misnamed(past):
    """Has no input of a predictor."""


def make(steps=30):
    return Parked(steps=steps)


ready = Parked(steps=77)
number = 7
'''


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A working directory of its own; what is imported from it is forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [p for p in sys.path if p not in ("", str(tmp_path))])
    before = set(sys.modules)
    importlib.invalidate_caches()
    yield tmp_path
    for name in set(sys.modules) - before:
        if str(tmp_path) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]


@pytest.fixture
def drivers(folder: Path) -> Path:
    (folder / "drivers").mkdir()
    (folder / "drivers" / "__init__.py").touch()
    (folder / "drivers" / "own.py").write_text(DRIVERS)
    return folder


@pytest.mark.usefixtures("drivers")
def test_a_class_of_the_current_directory_is_a_model_with_parameters_and_a_weight() -> None:
    (spec,) = parse_models("drivers.own:Parked:steps=40@2")
    assert (spec.name, spec.parameters, spec.weight) == ("drivers.own:Parked", {"steps": "40"}, 2.0)
    assert str(spec) == "drivers.own:Parked:steps=40"
    built = build(spec)
    assert type(built).__name__ == "Parked" and built.steps == 40  # type: ignore[attr-defined]


@pytest.mark.usefixtures("drivers")
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("drivers.own:Missing", r"drivers.own \(.*own.py\) has no Missing; it has OneByOne, Parked, Refuses"),
        ("drivers.none:Parked", r"no module drivers.none in .* or among the installed packages; a model is"),
        ("nothing_there:Parked", "no module nothing_there in"),
        ("drivers.own:number", "drivers.own:number: has type int; needs a class with plan or plan_one"),
        ("drivers.own:Parked:height=2", "unknown parameter 'height'; nearest: steps, guard"),
        ("drivers.own:ready:steps=3", "unknown parameter 'steps'; nearest: guard"),
        ("drivers.own:Parked:steps", "'steps' is not parameter=value"),
        ("drivers.own", "unknown behavior 'drivers.own'"),
        ("drivers.own:misnamed", "past has no default; .* a function that predicts names its inputs"),
    ],
)
def test_what_cannot_be_loaded_is_said_in_one_line(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message) as caught:
        parse_models(text)
    assert "\n" not in str(caught.value)


def test_a_module_that_fails_or_lacks_something_says_what_and_where(folder: Path) -> None:
    (folder / "broken.py").write_text("x = 1\ny = x / 0\n")
    with pytest.raises(
        UsageError, match=r"broken:M: importing broken raised ZeroDivisionError: .*\(broken.py, line 2\)"
    ):
        parse_models("broken:M")
    (folder / "needy.py").write_text("import no_such_package_at_all\n")
    with pytest.raises(UsageError, match="needy imports no_such_package_at_all, which is not installed"):
        parse_models("needy:M")


def test_an_installed_package_adds_its_models_by_entry_points(
    drivers: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = drivers / "acme_drivers-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme-drivers\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[scex_sumo.behaviors]\nacme_parked = drivers.own:Parked\nacme_onward = drivers.own:onward\n"
    )
    monkeypatch.syspath_prepend(drivers)  # as site-packages is
    assert {"acme_parked", "acme_onward"} <= set(known_names())
    built = build(parse_models("acme_parked:steps=50")[0])
    assert built.steps == 50  # type: ignore[attr-defined]
    assert isinstance(build(parse_models("acme_onward:factor=2")[0]), Predictor)
    summaries = {info.name: info.summary for info in known_models()}
    assert (summaries["acme_parked"], summaries["acme_onward"]) == ("Stays where it is.", "On and on.")
