"""Settings of a run make sense, or say which option does not; what decides on the values is told apart."""

from __future__ import annotations

import dataclasses
import inspect
import pickle
from pathlib import Path
from typing import Any

import pytest

from scex_sumo import example_path, extrapolate, read_seed
from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.base.options import options_of
from scex_sumo.base.processes import idle_cores
from scex_sumo.behaviors.spec import ModelSpec
from scex_sumo.extrapolation.options import RUN_OPTIONS, RunOptions
from scex_sumo.extrapolation.settings import RunSettings, read_thresholds
from scex_sumo.results.region import Region
from scex_sumo.steps.run_command import run_command
from tests.seeds import straight_seed


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"steps": 0}, "--steps: got 0, needs 1 to 6,000"),
        ({"replan": 31}, r"--replan: got 31, needs 1 to 30 \(models plan 30 steps\)"),
        ({"seed": -1}, "--seed: got -1, needs 0 or more"),
        ({"models": []}, "--models: names no model"),
        ({"models": [ModelSpec(name="standard_driver", weight=0.0)]}, "--models: all weights are 0"),
        ({"futures": 0}, r"--futures: got 0, needs 1 to 100,000 \(or 'all'\)"),
        ({"futures": 10**8}, "--futures: got 100,000,000, needs 1 to 100,000"),
        ({"steps": 10**5}, "--steps: got 100,000, needs 1 to 6,000"),
        ({"futures": "some"}, "--futures: got 'some', needs a number or 'all'"),
        ({"thresholds": {"speed": 3.0}}, "--threshold: unknown metric 'speed'; nearest: "),
        ({"thresholds": {"ttc": float("nan")}}, "--threshold ttc=nan: not a finite number"),
    ],
)
def test_a_setting_that_makes_no_sense_is_refused_by_its_option(given: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        RunSettings(**given)


@pytest.mark.parametrize("entry", ["0.5", "=3", "ttc", "ttc=x"])
def test_a_threshold_without_a_metric_or_a_number_is_refused_with_an_example(entry: str) -> None:
    with pytest.raises(
        UsageError, match=f"--threshold {entry}: needs METRIC=VALUE, e.g. --threshold ttc=0.5"
    ):
        read_thresholds([entry])


def test_more_states_than_a_machine_holds_are_refused_with_their_number() -> None:
    settings = RunSettings(futures=100_000, steps=6_000)
    with pytest.raises(UsageError, match="1,800,000,000 states, at most 200,000,000 are run"):
        settings.check_size(100_000, 3)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"futures": 0}, "futures: got 0, needs 1 to 100,000"),
        ({"under_test": {7: "parked"}, "assign": {7: "replay"}}, "under_test 7: assign names this vehicle"),
        ({"thresholds": {"nope": 1.0}}, "thresholds: unknown metric 'nope'"),
        ({"worker": 2}, "unknown option 'worker'; nearest: workers"),
        ({"seed": 1.5}, "^seed: got 1.5, needs int"),
        ({"assign": 3}, r"^assign: got 3, needs Mapping\["),
        ({"reference": "nope"}, "unknown behavior 'nope'"),
        ({"out": Path(__file__)}, r"out .*test_settings.py: is a file"),
    ],
)
def test_errors_name_the_arguments_of_python(options: dict[str, Any], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        extrapolate(straight_seed(), **options)


def test_errors_say_how_python_overwrites(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text("{")
    scene = read_seed(example_path("roundabout"))
    with pytest.raises(ResultError, match="give another folder with out, or overwrite=True to replace it"):
        extrapolate(scene, futures=1, out=tmp_path)


def test_settings_go_to_other_processes_and_into_other_settings() -> None:
    settings = RunSettings(assign={17: "replay"}, under_test={23: "emergency_brake"}, futures=3)
    for same in (pickle.loads(pickle.dumps(settings)), dataclasses.replace(settings)):
        assert same.to_json() == settings.to_json()
        assert (same.assign, same.under_test) == (settings.assign, settings.under_test)


def test_the_command_line_has_the_options_of_python_and_their_defaults() -> None:
    shown = {name: p.default for name, p in inspect.signature(run_command).parameters.items()}
    options = {name: one for kind in RUN_OPTIONS for name, one in options_of(kind).items()}
    assert set(options) <= set(shown)
    assert {"models", "out", "reference", "report"} <= set(options)
    defaults = {field.name: field.default for kind in RUN_OPTIONS for field in dataclasses.fields(kind)}
    given = [name for name, one in options.items() if not (one.takes or one.several)]
    assert all(shown[name] == defaults[name] for name in given)


@pytest.mark.parametrize(
    ("options", "settings", "processes"),
    [
        ({}, {}, 1),
        ({"workers": 2}, {}, 2),
        ({"workers": 9}, {"futures": 4}, 4),
        ({"workers": "auto"}, {}, 3),  # 385 / 128
        ({"workers": "auto"}, {"futures": 2000}, 8),  # cores
        ({"workers": "auto"}, {"futures": 127}, 1),
        ({"workers": "auto"}, {"futures": 128, "steps": 60}, 2),
        ({"workers": "auto"}, {"models": "rules", "assign": {3: straight_seed}}, 1),  # a driver of one's own
        ({"workers": "auto", "gui": True}, {}, 1),
    ],
)
def test_as_many_processes_as_help(
    monkeypatch: pytest.MonkeyPatch, options: dict[str, Any], settings: dict[str, Any], processes: int
) -> None:
    monkeypatch.setattr("scex_sumo.extrapolation.options.idle_cores", lambda: 8)
    assert RunOptions(**options).processes(RunSettings(**settings)) == processes


def test_cores_on_which_something_runs_are_not_idle(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scex_sumo.base.processes.cores", lambda: 4)
    for running, idle in ((1, 4), (2, 3), (9, 1)):
        line = f"0.10 0.20 0.30 {running}/412 991"
        monkeypatch.setattr("pathlib.Path.read_text", lambda path, line=line: line)
        assert idle_cores() == idle


def test_a_vehicle_of_a_simulation_is_named_as_sumo_names_it() -> None:
    scene = dataclasses.replace(straight_seed(2), source={"vehicles": {"0": "main.47", "1": "0"}})
    settings = RunSettings(models="replay", assign={"main.47": "replay"}, under_test={0: None})
    assert settings.numbered(scene).assign == {0: "replay"}
    assert settings.numbered(scene).under_test == {1: None}  # a name before a track id
    with pytest.raises(UsageError, match="--assign 7: not in the seed scene; its vehicles: main"):
        RunSettings(assign={7: "replay"}).numbered(scene)
    with pytest.raises(UsageError, match="--region main4: not in the seed scene; its vehicles"):
        Region(around="main4").vehicles(scene)
    assert Region(around="main.47").vehicles(scene) == (0, 1)


def test_options_can_be_sent_to_a_process() -> None:
    """As by an extra that works with its run's options elsewhere."""
    assert pickle.loads(pickle.dumps(RunOptions(workers=2))).workers == 2
