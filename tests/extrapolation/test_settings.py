"""Settings of a run make sense, or say which option does not; what decides on the values is told apart."""

from __future__ import annotations

import dataclasses
import inspect
import pickle
from typing import Any

import pytest

from scex_sumo import extrapolate
from scex_sumo.commands.run import run_command
from scex_sumo.errors import UsageError
from scex_sumo.extrapolation.settings import RunSettings
from tests.seeds import straight_seed


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"steps": 0}, "--steps: got 0, needs at least 1"),
        ({"replan": 31}, r"--replan: got 31, needs 1 to 30 \(models plan 30 steps\)"),
        ({"seed": -1}, "--seed: got -1, needs 0 or more"),
        ({"models": []}, "--models: names no model"),
        ({"children": 0}, r"--children: got 0, needs at least 1 \(or 'all'\)"),
        ({"children": "some"}, "--children: got 'some', needs a number or 'all'"),
        ({"design": "best"}, "unknown design 'best'"),
        ({"until_band": 0.05, "children": "all"}, "--until-band: all combinations leave nothing to estimate"),
        ({"thresholds": {"speed": 3.0}}, "--threshold: unknown metric 'speed'; known: distance"),
        ({"thresholds": {"ttc": float("nan")}}, "--threshold ttc=nan: is no threshold"),
    ],
)
def test_a_setting_that_makes_no_sense_is_refused_by_its_option(given: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        RunSettings(**given)


def test_an_unknown_setting_is_refused_with_the_known_ones() -> None:
    with pytest.raises(TypeError, match="has no setting 'childs'; known: models, assign, under_test"):
        extrapolate(straight_seed(), childs=3)


def test_a_number_of_children_may_be_given_as_text() -> None:
    assert RunSettings(children="12").to_json() == RunSettings(children=12).to_json()
    assert RunSettings(children="all").count is None


def test_thresholds_are_no_part_of_what_decides_on_a_childs_values() -> None:
    assert RunSettings(thresholds={"ttc": 0.5}).to_json() == RunSettings().to_json()


def test_settings_go_to_other_processes_and_into_other_settings() -> None:
    settings = RunSettings(assign={17: "replay"}, under_test={23: "emergency_brake"}, children=3)
    for same in (pickle.loads(pickle.dumps(settings)), dataclasses.replace(settings)):
        assert same.to_json() == settings.to_json()
        assert (same.assign, same.under_test) == (settings.assign, settings.under_test)


def test_the_command_line_has_the_same_defaults() -> None:
    shown = {name: p.default for name, p in inspect.signature(run_command).parameters.items()}
    settings = {field.name: field.default for field in dataclasses.fields(RunSettings)}
    same = [name for name, default in shown.items() if default is not None and name in settings]
    kept = ["baseline", "keep_plans", "preset", "reflect", "replan", "seed", "steps", "world"]
    assert sorted(same) == kept
    assert all(shown[name] == settings[name] for name in same)
