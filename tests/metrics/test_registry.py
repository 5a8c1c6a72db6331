"""Metrics of a user's own: named as a model is, judged and shown as the built-in ones."""

from __future__ import annotations

import json
import pickle
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cloudpickle
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import scex_sumo as scex
from scex_sumo.base.errors import InputError, UsageError
from scex_sumo.evaluation.tables import evaluate_pairs
from scex_sumo.metrics import registry
from scex_sumo.metrics.evaluate import evaluate
from scex_sumo.metrics.pairs.scenes import Entries
from scex_sumo.metrics.registry import (
    COLUMNS,
    METRICS,
    OURS,
    PAPER_METRICS,
    THRESHOLDS,
    Metric,
    column_named,
    columns_of,
    describe_metrics,
    metric_of,
    metrics_named,
    thresholds_of,
)
from scex_sumo.page.figures.figure import plot
from scex_sumo.reports.run_table import summary_table
from scex_sumo.results.run import open_run
from scex_sumo.results.tables.encounters import SCHEMA
from tests import command
from tests.metrics.scenes import one_scene

DOCS = Path(__file__).resolve().parents[2] / "docs" / "metrics.md"


@pytest.fixture(autouse=True)
def registered_metrics(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, Any]]:
    """The registered metrics; those of a test are forgotten after it."""
    monkeypatch.setattr(registry, "_registered", found := {})
    yield found
    sys.modules.pop("closeness", None)


@pytest.fixture
def example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of docs/metrics.md, in the folder that the user is in."""
    (code,) = re.findall(r"```python\n(# closeness\.py.*?)```", DOCS.read_text(), re.DOTALL)
    (tmp_path / "closeness.py").write_text(code)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    return tmp_path / "closeness.py"


def vehicles(*speeds: float) -> Any:
    return one_scene([{"x": 15.0 * i, "y": 0.0, "psi": 0.0, "v": v} for i, v in enumerate(speeds)])


def test_the_paper_has_twelve_columns_four_thresholds_and_two_metrics_that_are_critical_above() -> None:
    assert columns_of([METRICS[name] for name in PAPER_METRICS]) == COLUMNS
    assert len(COLUMNS) == 12 and metrics_named(None) == metrics_named(["paper"])
    expected = {"distance": 5.0, "wttc": 0.26, "tq": 1.2, "ttc": pytest.approx(0.6667, abs=1e-4)}
    assert dict(THRESHOLDS) == expected == thresholds_of(metrics_named(None))
    assert [name for name in PAPER_METRICS if metric_of(name).side == "right"] == ["tq", "ttc"]
    assert [METRICS[n].titled() for n in ("tq", "ttc")] == ["traffic quality", "1/TTC [1/s]"]


def test_the_example_of_the_docs_is_named_by_its_import_path(example: Path) -> None:
    values = evaluate(vehicles(10.0, 4.0, 30.0), None, metrics=["closeness:speed_gap", "distance"])
    assert values.columns == ("speed_gap", "speed_gap_mean", "distance", "distance_mean")
    # 15 m apart: 6 and 26 m/s; the first and the last are 30 m apart and left out.
    assert values.values[0].tolist() == [26.0, 26.0, 15.0, 15.0]
    pairs = evaluate_pairs(vehicles(10.0, 4.0, 30.0), None, metrics=["speed_gap"])["speed_gap"]
    assert pairs.value.tolist() == [6.0, 6.0, 26.0, 26.0]
    assert (metric_of("speed_gap_mean").side, metric_of("speed_gap").titled()) == (
        "right",
        "difference of speeds [m/s]",
    )


def test_a_metric_by_import_path_goes_through_the_command(example: Path) -> None:
    tracks = example.parent / "tracks.csv"
    rows = [
        f"{t},{i},{i * 100},car,{15.0 * t + speed * i / 10},0,{speed},0,0,4.5,1.8"
        for t, speed in ((1, 10.0), (2, 4.0))
        for i in range(1, 4)
    ]
    head = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"
    tracks.write_text("\n".join([head, *rows]) + "\n")
    done = command.scex("metrics", tracks, "--metrics", "closeness:speed_gap")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ['"case_id","speed_gap","speed_gap_mean"', "1,6,6"]


def test_a_metric_of_some_ordered_pairs_says_at_which_place() -> None:
    """Of two vehicles, 10 and 4 m/s: the second place is the pair of the second and the first."""

    def slower(scenes: scex.Scenes) -> scex.Samples:
        speed = scenes.speed.reshape(2, -1)[1]
        return scenes.scattered(np.arange(scenes.count, 2 * scenes.count), speed)

    metric = Metric(name="slower", critical="max", evaluate=slower)
    rows = evaluate_pairs(vehicles(10.0, 4.0), None, metrics=[metric])["slower"]
    assert (rows.vehicle[0], rows.other[0]) == (1, 0) and set(rows.value.tolist()) == {4.0}


def test_nan_of_an_own_metric_is_undefined() -> None:
    """Of two vehicles, 10 and 4 m/s, the slower one's speed is NaN, also as a place of ordered pairs."""

    def speed(scenes: scex.Scenes) -> scex.Samples:
        value = np.where(scenes.speed < 5.0, np.nan, scenes.speed)
        return scex.Samples(value=value, defined=np.ones(value.shape, np.bool_), row=np.arange(2), other=None)

    def of_pairs(scenes: scex.Scenes) -> Entries:
        value = np.repeat([np.nan, 10.0], scenes.count)
        return Entries(where=np.arange(2 * scenes.count), value=value)

    def nothing(scenes: scex.Scenes) -> scex.Samples:
        return scenes.unordered(np.full((1, *scenes.shape), np.nan))

    found = [
        evaluate(
            vehicles(10.0, 4.0),
            None,
            metrics=[Metric(name="own", critical="min", evaluate=metric, finite=finite)],
        )
        for metric in (speed, of_pairs, nothing)
        for finite in (False, True)
    ]
    assert [values.values.tolist() for values in found[:4]] == [[[10.0, 10.0]]] * 4
    assert not any(values.defined.any() for values in found[4:])


def test_a_metric_of_the_users_script_reaches_another_process(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import sys, cloudpickle, scex_sumo as scex\n"
        "@scex.metric('speed', critical='max', unit='m/s')\n"
        "def speed(scenes):\n"
        "    first, second = scenes.pairs\n"
        "    return scenes.unordered(scenes.speed[second] + scenes.speed[first])\n"
        "from scex_sumo.metrics.registry import metrics_named\n"
        "sys.stdout.buffer.write(cloudpickle.dumps(metrics_named(['speed'])))\n"
    )
    done = subprocess.run([sys.executable, str(script)], capture_output=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    metrics = pickle.loads(done.stdout)
    assert evaluate(vehicles(10.0, 4.0), None, metrics=metrics).values.tolist() == [[14.0, 14.0]]
    assert cloudpickle.loads(cloudpickle.dumps(metrics))[0].columns == ("speed", "speed_mean")


def result_with(folder: Path, column: str, values: list[float], **info: Any) -> scex.Run:
    """A result folder of one metric; other processes know it by what run.json says."""
    table = pa.table({"future": list(range(len(values))), column: values, f"{column}_mean": values})
    table = table.append_column("collision", pa.array([False] * len(values)))
    pq.write_table(table, folder / "metrics.parquet")
    pq.write_table(SCHEMA.empty_table(), folder / "encounters.parquet")
    whole = {"seed_scene": {"name": "drawn", "vehicles": 2}, "futures": len(values), **info}
    (folder / "run.json").write_text(json.dumps(whole))
    return open_run(folder)


def test_a_result_is_judged_and_drawn_where_the_metric_is_not_registered(
    example: Path, registered_metrics: dict[str, Any], tmp_path: Path
) -> None:
    metrics = metrics_named(["closeness:speed_gap"])
    described = json.loads(json.dumps(describe_metrics(metrics)))
    assert described[0]["function"] == "closeness:speed_gap" and len(described[0]["sha256"]) == 64
    registered_metrics.clear()
    with pytest.raises(UsageError, match="unknown metric 'speed_gap'"):
        metric_of("speed_gap")
    limits = thresholds_of(metrics)
    run = result_with(tmp_path, "speed_gap", [4.0, 12.0, 26.0], metrics=described, thresholds=limits)
    assert run.p_critical("speed_gap").value == pytest.approx(2 / 3)
    assert run.most_critical("speed_gap") == 2
    shown = [str(cell) for cell in summary_table(run).columns[0].cells]
    assert shown == ["collision", "severe injuries [‰]", "difference of speeds [m/s]"]
    (panel,) = plot([run], tmp_path / "densities.svg")
    assert (panel.get_title(loc="left"), panel.get_xlabel()) == ("difference of speeds", "[m/s]")
    with pytest.raises(UsageError, match="known from a result only"):
        evaluate(vehicles(1.0, 2.0), None, metrics=[run.metric("speed_gap")])


def test_a_result_with_an_unknown_metric_names_the_others_that_it_has(
    example: Path, registered_metrics: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    described = describe_metrics(metrics_named(["closeness:speed_gap", "time_margin"]))
    registered_metrics.clear()
    result_with(tmp_path, "speed_gap", [4.0], metrics=described)
    assert command.status("metrics", tmp_path) == 2
    assert "e.g. --metrics time_margin,package.module:function" in capsys.readouterr().err


@pytest.mark.parametrize("name", OURS)
def test_a_result_says_which_formula_a_metric_of_ours_has(name: str) -> None:
    place, function = str(metric_of(name).description()["function"]).split(":")
    assert place.startswith("scex_sumo.metrics.formulas.") and not function.startswith("_")


def test_a_metric_of_one_result_is_none_of_another(tmp_path: Path) -> None:
    """Two results have a metric of one name; large values are critical in one, small ones in the other."""
    runs = []
    for side in ("max", "min"):
        described = [{"name": "haste", "critical": side, "threshold": 12.0, "unit": "m/s"}]
        folder = tmp_path / side
        folder.mkdir()
        limits = {"haste": 12.0}
        runs.append(result_with(folder, "haste", [4.0, 12.0, 26.0], metrics=described, thresholds=limits))
    assert [run.most_critical("haste") for run in runs] == [2, 0]
    assert [run.metric("haste").side for run in runs] == ["right", "left"]
    with pytest.raises(UsageError, match="unknown metric 'haste'"):
        metric_of("haste")


def test_what_is_no_metric_is_refused(example: Path) -> None:
    with pytest.raises(UsageError, match="choose min or max"):
        scex.metric("speed", critical="large")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="threshold nan is not a finite number"):
        scex.metric("speed", critical="min", threshold=float("nan"))
    for name, message in (
        ("closeness:np", "closeness:np is no metric; decorate it"),
        ("closeness:other", "has no other"),
        ("far_away:speed", "no module far_away in"),
        ("speeds", "unknown metric 'speeds'; nearest: "),
    ):
        with pytest.raises(UsageError, match=message):
            metrics_named([name])
    with pytest.raises(UsageError, match="none is named"):
        metrics_named([])


@pytest.mark.parametrize(
    ("text", "column"), [("TTC", "ttc"), ("gap_time", "gap_time"), ("TTC_MEAN", "ttc_mean")]
)
def test_a_column_is_known_in_any_case(text: str, column: str) -> None:
    assert column_named(text) == column


def test_an_unknown_metric_is_a_short_line_with_the_nearest_names() -> None:
    with pytest.raises(
        UsageError, match="unknown metric 'tcc'; nearest: ttc, wttc, pttc; a metric of your own"
    ):
        metrics_named(["tcc"])
    with pytest.raises(
        UsageError, match=r"^unknown metric 'tcc mean'; nearest: ttc_mean, wttc_mean, pttc_mean$"
    ):
        column_named("tcc mean", (*COLUMNS, *COLUMNS))
    with pytest.raises(UsageError) as caught:
        metrics_named(["x" * 5000])
    assert len(str(caught.value)) < 160


def test_an_error_in_an_own_metric_is_one_line_with_file_and_line(
    tmp_path: Path, registered_metrics: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "faulty.py").write_text(
        "import scex_sumo as scex\n\n\n@scex.metric('faulty', critical='min')\ndef faulty(scenes):\n"
        "    return scenes.speed[99]\n"
    )
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"metric faulty: raised IndexError.*\(faulty\.py, line 6\)"):
        evaluate(vehicles(1.0, 2.0), None, metrics=["faulty:faulty"])
