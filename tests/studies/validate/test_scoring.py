"""Scores of moments: what a forecast of known futures is worth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rich.console import Console

from scex_sumo.base.errors import ResultError
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.metrics.events import MEASURED
from scex_sumo.studies.moments.folder import Failure, MomentRef
from scex_sumo.studies.validate.command import _print_scores
from scex_sumo.studies.validate.moment import (
    CONSTANT_VELOCITY,
    RECORDED,
    Forecast,
    ForecastFolder,
    ValidationSettings,
)
from scex_sumo.studies.validate.page import write_validation_page
from scex_sumo.studies.validate.scoring import (
    EVENTS,
    event_scores,
    gathered,
    pair_scores,
    position_scores,
    probability,
    summary,
    value_scores,
    verdicts,
)
from scex_sumo.studies.validate.validate import Validation
from scex_sumo.studies.validate.vehicles import ENCOUNTERS


def settings(futures: int) -> ValidationSettings:
    return ValidationSettings(run=RunSettings(models="standard_driver", futures=futures))


COLUMNS = settings(1).run.columns


def ref(number: int) -> MomentRef:
    return MomentRef(
        moment=f"m{number}", location="here", recording=f"r{number % 2}", case="", time_s=number, vehicles=2
    )


def forecast(distance: list[float], recorded: float, name: str = "distance") -> Forecast:
    future = [*range(len(distance)), RECORDED, CONSTANT_VELOCITY]
    values = [*distance, recorded, 20.0]
    table = {"future": pa.array(future, pa.int32())}
    for column in COLUMNS:
        table[column] = pa.array(values if column == name else [None] * len(future), pa.float64())
    table["collision"] = pa.array([False] * len(future))
    vehicles = pa.Table.from_pylist(
        [
            {
                "track_id": 1, "moving": True, "second": 3, "error_of_mean_m": 1.0, "mean_error_m": 2.0,
                "least_error_m": 0.5, "constant_velocity_error_m": 3.0, "along_within": True,
                "across_within": True,
            }
        ]
    )  # fmt: skip
    return Forecast(futures=pa.table(table), vehicles=vehicles, encounters=ENCOUNTERS.empty_table())


FOUND = [(ref(0), forecast([4.0, 4.0, 6.0, 8.0], 4.5)), (ref(1), forecast([9.0, 9.5, 10.0, 12.0], 9.8))]


def test_the_probability_of_an_event_is_its_share_of_the_futures() -> None:
    p, o = probability(gathered(FOUND), EVENTS[0])
    assert p.tolist() == [0.5, 0.0]
    assert o.tolist() == [True, False]


def test_an_event_is_scored_against_base_rate_and_constant_velocity() -> None:
    row = event_scores(gathered(FOUND))[0]
    assert row["brier"] == pytest.approx(0.125)
    assert row["skill_base_rate"] == pytest.approx(0.5)
    assert row["skill_constant_velocity"] == pytest.approx(0.75)


def test_a_value_is_scored_by_crps_against_constant_velocity() -> None:
    row = next(row for row in value_scores(gathered(FOUND)) if row["column"] == "distance")
    assert row["count"] == 2
    assert row["coverage"] == 1.0
    assert 0.8 < row["crps_skill"] < 1.0


def test_a_recorded_value_outside_of_all_futures_is_not_covered() -> None:
    found = gathered([(ref(0), forecast([4.0, 4.0, 4.1, 4.2], 3.0))])
    row = next(row for row in value_scores(found) if row["column"] == "distance")
    assert row["coverage"] == 0.0


def test_events_of_pairs_are_scored() -> None:
    cases = [(0.8, True, False), (0.1, False, False)]
    rows = [
        {
            **dict.fromkeys(ENCOUNTERS.names),
            **{f"{event.name}_forecast": p for event in MEASURED},
            **{f"{event.name}_happened": o for event in MEASURED},
            **{f"{event.name}_straight": straight for event in MEASURED},
        }
        for p, o, straight in cases
    ]
    one = replace(forecast([4.0], 4.5), encounters=pa.Table.from_pylist(rows, schema=ENCOUNTERS))
    scored = pair_scores(gathered([(ref(0), one)]))
    assert [row["event"] for row in scored] == [event.words for event in MEASURED]
    for row in scored:
        assert (row["pairs"], row["happened"]) == (2, 0.5)
        assert row["brier"] == pytest.approx(0.025) and row["uncertainty"] == pytest.approx(0.25)
        assert row["skill_constant_velocity"] == pytest.approx(0.95)
    assert pair_scores(gathered(FOUND)) == []


def test_the_page_is_one_file_with_all_tables(tmp_path) -> None:  # type: ignore[no-untyped-def]
    found = gathered(FOUND)
    scored = {"events": event_scores, "pairs": pair_scores, "values": value_scores}
    rows = {name: score(found) for name, score in scored.items()} | {"positions": position_scores(found)}
    info = {
        "models": ["likely"],
        "futures": 4,
        "part": "all",
        "failed": {"m9": "no <vehicle>"},
        "notes": ["warning: 2 seed scenes: too few"],
    }
    write_validation_page(tmp_path, {**info, **summary(found, rows["events"])}, rows)
    page = (tmp_path / "validation.html").read_text()
    assert (
        "distance" in page
        and "Pairs of vehicles" in page
        and "no &lt;vehicle&gt;" in page
        and "<p>2 seed scenes: too few</p>" in page
        and "://" not in page
    )


def test_the_tables_fit_into_80_columns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("scex_sumo.commands.console.output_console", lambda *, width: Console(width=80))
    found = gathered(FOUND)
    rows = {"events": event_scores(found), "positions": position_scores(found)}
    info = {"models": ["likely"], **summary(found, rows["events"])}
    tables = {name: pa.Table.from_pylist(part) for name, part in rows.items()}
    _print_scores(Validation(folder=tmp_path, info=info, tables=tables))
    lines = capsys.readouterr().out.splitlines()
    tabled = lines[lines.index(next(line for line in lines if line.startswith("events"))) :]
    assert max(map(len, tabled)) <= 80
    assert any(line.startswith("after [s] ") for line in tabled)


def test_moments_with_other_columns_are_of_another_validation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ForecastFolder(tmp_path, settings(4).to_json([])) as folder:
        folder.save(*FOUND[0])
    fewer = ENCOUNTERS.remove(len(ENCOUNTERS) - 1)
    monkeypatch.setattr("scex_sumo.studies.validate.moment.ENCOUNTERS", fewer)
    with pytest.raises(ResultError, match="holds another validation; give another folder"):
        ForecastFolder(tmp_path, settings(4).to_json([]))


def test_few_seed_scenes_and_forecasts_worse_than_constant_velocity_are_told() -> None:
    figures = {"seeds": 20, "mean_brier": 0.1, "mean_brier_constant_velocity": 0.1}
    assert verdicts(figures) == []
    assert verdicts({**figures, "seeds": 3}) == [
        "warning: 3 seed scenes: too few to compare; validate on 20 or more"
    ]
    assert verdicts({**figures, "mean_brier": 0.2}) == [
        "warning: worse than constant velocity: mean Brier score 0.200, not 0.100"
    ]


def test_a_folder_gives_back_what_was_added_and_takes_no_other_validation(tmp_path) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "v"
    with ForecastFolder(path, {"a": 1}) as folder:
        folder.save(*FOUND[0])
        assert folder.has(ref(0)) and not folder.has(ref(1))
    with ForecastFolder(path, {"a": 1}) as folder:
        assert folder.read(ref(0)).futures.equals(FOUND[0][1].futures)
    with pytest.raises(ResultError, match="another validation"):
        ForecastFolder(path, {"a": 2})


@pytest.mark.parametrize("name", ["futures", "vehicles"])
def test_a_moment_of_which_a_table_is_broken_runs_again(tmp_path: Path, name: str) -> None:
    with ForecastFolder(tmp_path / "out", {"seed": 1}) as folder:
        for number in (0, 1):
            folder.save(ref(number), forecast([1.0, 2.0], 3.0))
        folder.fail(Failure.of(ref(2), "broken"))
    table = tmp_path / "out/moments/m1" / f"{name}.parquet"
    content = bytearray(table.read_bytes())
    content[len(content) // 5] ^= 0xFF
    table.write_bytes(content)
    (tmp_path / "out/failed/m2.json").write_text("{")
    with ForecastFolder(tmp_path / "out", {"seed": 1}) as folder:
        assert folder.has(ref(0)) and not folder.has(ref(1))
        assert folder.failures() == {}
        folder.save(ref(1), forecast([1.0, 2.0], 3.0))
        assert folder.read(ref(1)).futures.num_rows == 4


@pytest.mark.parametrize("name", ["vehicles", "encounters", "futures"])
@pytest.mark.parametrize("how", ["no column", "text", "rows", "gone"])
def test_a_moment_of_which_a_table_was_edited_runs_again(tmp_path: Path, name: str, how: str) -> None:
    with ForecastFolder(tmp_path / "out", {"seed": 1}) as folder:
        folder.save(ref(0), forecast([1.0, 2.0], 3.0))
    file = tmp_path / "out/moments/m0" / f"{name}.parquet"
    table = pq.read_table(file)
    if how == "no column":
        pq.write_table(table.drop_columns(table.column_names[-1:]), file)
    elif how == "text":
        pq.write_table(table.set_column(0, table.column_names[0], pa.array(["x"] * len(table))), file)
    elif how == "rows" and name == "futures":
        pq.write_table(table.slice(1), file)
    else:
        file.unlink()
    with ForecastFolder(tmp_path / "out", {"seed": 1}) as folder:
        assert not folder.has(ref(0))
