"""A result folder explained: made by hand, so that what should be said of it is known."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.extrapolation.assignments import all_assignments
from scex_sumo.metrics.registry import COLUMNS
from scex_sumo.results.run import open_run
from scex_sumo.results.tables.encounters import SCHEMA
from scex_sumo.studies.explain.command import explain_command
from scex_sumo.studies.explain.explain import assignment_of, explain
from tests.base.test_progress import Terminal

MODELS = ("brakes", "cruises", "races")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """All 27 assignments of vehicles 7, 8, 11: close whenever 7 brakes and 11 races, TTC never defined."""
    levels = all_assignments([3, 3, 3])
    distance = np.where((levels[:, 0] == 0) & (levels[:, 2] == 2), 3.0, 20.0) + 0.1 * levels[:, 1]
    columns = {name: np.full(27, 5.0) for name in COLUMNS}
    columns["distance"] = distance
    columns["ttc"] = columns["ttc_mean"] = pa.nulls(27, pa.float64())
    pq.write_table(pa.table({"future": np.arange(27), **columns}), tmp_path / "metrics.parquet")
    models = [MODELS[m] for m in levels.reshape(-1)]
    assignments = {"future": np.repeat(np.arange(27), 3), "track_id": [7, 8, 11] * 27, "model": models}
    pq.write_table(pa.table(assignments), tmp_path / "assignments.parquet")
    worst = {
        "future": np.arange(27),
        "metric": ["distance"] * 27,
        "timestamp_ms": np.full(27, 3200),
        "track_id": np.full(27, 11),
        "other_id": np.full(27, 7),
        "value": distance,
    }
    pq.write_table(pa.table(worst), tmp_path / "worst.parquet")
    info = {
        "seed_scene": {"name": "made", "vehicles": 3, "track_ids": [7, 8, 11]},
        "models": [{"model": m, "weight": 1.0} for m in MODELS],
        "thresholds": {"distance": 5.0, "ttc": 0.667},
        "design": "all",
    }
    met = [{"track_id": one, "other_id": other} for one, other in ((11, 7), (7, 8), (8, 11))]
    pq.write_table(pa.Table.from_pylist(met, schema=SCHEMA), tmp_path / "encounters.parquet")
    (tmp_path / "run.json").write_text(json.dumps(info))
    return tmp_path


def test_what_must_happen_is_said_as_it_is(folder: Path) -> None:
    (found,) = explain(open_run(folder), ["distance"], worst=2)
    levels, names = assignment_of(open_run(folder))
    assert names == list(MODELS)
    assert found.p_critical.estimate.value == 3 / 27
    assert found.worst == [2, 5]  # the first: 7 brakes, 11 races, and 8 brakes, then cruises
    assert levels[2].tolist() == [0, 0, 2]


def test_the_variance_is_the_pairs_and_little_of_the_third_vehicle(folder: Path) -> None:
    # An event of 1/3 times 1/3: variance 8/81 of 17^2; main effects 2/81 each, the pair 4/81.
    share = {(e.vehicle, e.other): e.share for e in explain(open_run(folder), ["distance"])[0].effects}
    assert share[0, -1] == pytest.approx(1 / 4, abs=1e-3)
    assert share[2, -1] == pytest.approx(1 / 4, abs=1e-3)
    assert share[0, 2] == pytest.approx(1 / 2, abs=1e-3)
    # Vehicle 8 adds 0, 0.1 or 0.2: variance 0.02 / 3 of 28.55.
    assert share[1, -1] == pytest.approx(0.02 / 3 / (17**2 * 8 / 81 + 0.02 / 3), abs=1e-9)


def test_progress_is_a_bar_on_a_terminal(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", Terminal())
    explain(open_run(folder), ["distance"], progress=True)
    assert isinstance(sys.stderr, Terminal) and "explain: 100%" in sys.stderr.getvalue()


def test_a_metric_without_threshold_has_its_most_critical_tenth(folder: Path) -> None:
    metrics = pq.read_table(folder / "metrics.parquet").to_pydict()
    metrics["pttc"] = np.arange(27.0)
    pq.write_table(pa.table(metrics), folder / "metrics.parquet")
    (found,) = explain(open_run(folder), ["pttc"])
    assert not found.given
    assert found.threshold == 2.0  # values 0, 1, 2 of 27
    assert found.worst[0] == 0


def test_a_metric_defined_nowhere_explains_nothing(folder: Path) -> None:
    (found,) = explain(open_run(folder), ["ttc"])
    assert (found.defined, found.effects, found.conditions, found.worst) == (0, [], [], [])


def test_the_command_prints_and_writes_it(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    explain_command(folder, metric="distance", worst=1, plots=True)
    said = capsys.readouterr().out
    assert "50.0%" in said
    assert "distance <= 5: 11.1 % of 27 futures" in said
    assert "future 2: 3, 11 with 7 after 2.2 s: 7=brakes 8=brakes 11=races" in said
    effects = pq.read_table(folder / "explain_effects.parquet").to_pylist()
    pair = next(r for r in effects if r["metric"] == "distance" and r["kind"] == "pair" and r["share"] > 0.4)
    assert (pair["track_id"], pair["other_id"]) == (7, 11)
    worst = pq.read_table(folder / "explain_worst.parquet").to_pylist()
    assert worst[0]["assignment"] == "7=brakes 8=brakes 11=races"
    page = (folder / "explain.html").read_text()
    assert "11.1 % of the futures have distance [m] ≤ 5." in page
    assert page.count("<figure>") == 1  # nothing else varies


def test_two_that_collide_are_explained_with_the_futures_in_which_they_do(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hits = {"future": [2, 2], "track_id": [11, 8], "other_id": [7, 7], "time_s": [2.2, 1.0]}
    pq.write_table(pa.table(hits), folder / "collisions.parquet")
    explain_command(folder, encounter="7,11", worst=5, plots=True)
    said = capsys.readouterr().out
    assert "collision of 7 and 11: 3.7 % of 27 futures" in said
    assert [line for line in said.splitlines() if "future 2" in line] == [
        "  future 2: 11 with 7 after 2.2 s: 7=brakes 8=brakes 11=races"
    ]
    page = (folder / "explain.html").read_text()
    assert "collision of 7 and 11" in page


def test_all_metrics_are_printed_where_none_is_named(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    explain_command(folder, metric=None, worst=5, plots=False)
    said = capsys.readouterr().out
    assert "ttc: defined in no future" in said
    assert "wttc <= 5, the worst tenth" in said


def _with(folder: Path, thresholds: dict[str, float], **columns: np.ndarray) -> None:
    metrics = pq.read_table(folder / "metrics.parquet").to_pydict() | columns
    pq.write_table(pa.table(metrics), folder / "metrics.parquet")
    info = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps(info | {"thresholds": thresholds}))


def test_the_variance_is_due_to_those_that_make_it_critical(folder: Path) -> None:
    # Infinite where 7 brakes and 11 races, a collision; else what 8 does decides the little that is left.
    levels = all_assignments([3, 3, 3])
    drac = np.where((levels[:, 0] == 0) & (levels[:, 2] == 2), np.inf, 0.1 * levels[:, 1])
    _with(folder, {"drac": 3.4}, drac=drac)
    (found,) = explain(open_run(folder), ["drac"])
    share = {(e.vehicle, e.other): e.share for e in found.effects}
    assert share[0, 2] == max(share.values())
    assert share[1, -1] < 0.01


def test_what_is_always_critical_has_one_line_and_no_models(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _with(folder, {"distance": 50.0, "wttc": 0.26}, wttc=np.zeros(27))
    explain_command(folder, metric=None, worst=1, plots=False)
    said = capsys.readouterr().out.splitlines()
    assert "critical in every future: distance <= 50, wttc <= 0.26" in said
    assert not any(line.startswith("distance") for line in said)


def test_what_cannot_be_explained_is_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="unknown metric 'speed'; nearest: "):
        explain_command(folder, metric="speed", worst=5, plots=False)
    with pytest.raises(UsageError, match="--worst: got 0"):
        explain_command(folder, metric=None, worst=0, plots=False)
    with pytest.raises(ResultError, match="no such folder"):
        explain_command(tmp_path / "none", metric=None, worst=5, plots=False)
