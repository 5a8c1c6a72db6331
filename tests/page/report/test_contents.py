"""The report holds the run: tracks to the centimetre, values, events and the tables that are there."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from base64 import b64encode
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from scex_sumo.converters.net.reading import SURFACE
from scex_sumo.page.report.contents import report_contents
from scex_sumo.page.report.report import write_report
from scex_sumo.page.report.scene import packed_tracks
from scex_sumo.reports.encounter_rows import meetings
from scex_sumo.results.run import Run, open_run
from tests.page.packed import decoded_motion, unpack

DATA = re.compile(r'<script type="text/plain" id="data">([^<]*)</script>')


def test_tracks_come_back_to_the_centimetre_and_milliradian(run: Run) -> None:
    info, arrays = unpack(DATA.search(write_report(run).read_text())[1])  # type: ignore[index]
    assert info["packed"] == list(range(run.futures))
    for future in (0, run.futures - 1):
        poses = poses_of(arrays, future)
        states = run.states(future)
        np.testing.assert_allclose(poses[..., 0], states.x[:, 10:], atol=0.0101)
        np.testing.assert_allclose(poses[..., 1], states.y[:, 10:], atol=0.0101)
        np.testing.assert_allclose(poses[..., 3], states.speed[:, 10:], atol=0.0101)
        turned = np.angle(np.exp(1j * (poses[..., 2] - states.heading[:, 10:])))
        np.testing.assert_allclose(turned, 0, atol=0.00101)


def poses_of(arrays: dict[str, np.ndarray], place: int) -> np.ndarray:
    """Return the poses (V, T, 4) of a packed future."""
    first = np.searchsorted(arrays["owner"], np.arange(len(arrays["start"])))
    rows = arrays["which"][place] + first
    return decoded_motion(arrays["start"], arrays["motion"][:, rows])


def test_of_too_many_different_tracks_a_page_holds_the_first_futures(run: Run) -> None:
    wanted = [(run, future, future) for future in (7, 3, *range(20, 60))]
    whole, part = packed_tracks(wanted), packed_tracks(wanted, budget=2_000)
    assert whole.futures.tolist() == sorted(future for _, future, _ in wanted)
    kept = len(part.futures)
    assert 1 < kept < len(wanted)
    assert part.futures.tolist() == sorted([7, 3, *range(20, 60)][:kept])
    assert part.motion.shape[1] < whole.motion.shape[1] and len(part.which) == kept
    arrays = {"owner": part.owner, "start": part.start, "which": part.which, "motion": part.motion}
    at = part.futures.tolist().index(7)
    np.testing.assert_allclose(poses_of(arrays, at)[..., 0], run.states(7).x[:, 10:], atol=0.0101)


def test_equal_trajectories_are_stored_once(run: Run) -> None:
    _, arrays = report_contents(run)
    owner = arrays["owner"]
    rows = {(v, arrays["motion"][:, u].tobytes()) for u, v in enumerate(owner)}
    assert len(rows) == len(owner) < arrays["which"].size / 2
    assert (np.bincount(owner) == arrays["which"].max(axis=0) + 1).all()


def test_a_metric_whose_column_somebody_took_out_has_no_events(run: Run, tmp_path: Path) -> None:
    part = shutil.copytree(run.folder, tmp_path / "part")
    pq.write_table(run.metrics.drop_columns(["distance"]), part / "metrics.parquet")
    whole, less = (report_contents(one)[0] for one in (run, open_run(part)))
    assert [metric["column"] for metric in less["metrics"]] == run.columns[1:]
    distances = sum(row["metric"] == 0 for row in whole["events"]["rows"])
    assert 0 < distances == len(whole["events"]["rows"]) - len(less["events"]["rows"])


def test_values_models_and_worst_events_are_those_of_the_tables(run: Run) -> None:
    info, arrays = report_contents(run)
    assert [metric["column"] for metric in info["metrics"]] == run.columns
    distance = run.metrics["distance"].to_numpy(zero_copy_only=False)
    np.testing.assert_allclose(arrays["values"][0], distance)
    assert [info["models"][m] for m in arrays["levels"][7]] == run.models_of(7)
    known = {
        (row["future"], row["metric"], row["timestamp_ms"] / 100 - 10, row["track_id"], row["other_id"])
        for row in run.worst.to_pylist()
    }
    events = [event for event in info["events"]["rows"] if event["metric"] >= 0]
    shown = {
        (future, run.columns[e["metric"]], e["step"], *[info["track_ids"][v] for v in e["pair"]])
        for e in events
        for future in e["futures"]
        if e["pair"]
    }
    assert shown == {row for row in known if row[-1] is not None}
    distances = [event["cells"][1] for event in events if event["metric"] == 0]
    assert distances == sorted(distances)


def test_the_road_around_the_vehicles_is_there(run: Run) -> None:
    road = report_contents(run)[0]["road"]
    surfaces = [group for group in road if group["kind"] == SURFACE]
    assert sum(group["path"].count("M") for group in surfaces) > 20
    assert all(2 <= group["width"] <= 6 for group in surfaces)
    assert [group["kind"] for group in road] == sorted(group["kind"] for group in road)


def test_encounters_and_collisions_are_those_of_the_run(run: Run) -> None:
    info, _ = report_contents(run)
    collisions, encounters = run.table("collisions.parquet"), run.table("encounters.parquet").to_pylist()
    assert info["collided"] == sorted(set(collisions["future"].to_pylist()))
    ids = info["track_ids"]
    assert [(ids[a], ids[b]) for a, b in (row["pair"] for row in info["encounters"]["rows"])] == [
        (row["track_id"], row["other_id"]) for row in encounters
    ]
    assert info["encounters"]["rows"][0]["words"] == meetings(run)[0].words()


def test_the_page_refers_to_nothing_outside_and_runs_only_its_own_script(run: Run) -> None:
    text = write_report(run).read_text()
    assert not re.search(r"(?:src|href)=\"(?!data:)", text)
    assert not re.search(r"https?://", text)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)[1]  # type: ignore[index]
    assert policy.startswith("default-src 'none'")
    assert "unsafe" not in policy
    script = text[text.rindex("<script>") + len("<script>") : text.rindex("</script>")]
    assert b64encode(hashlib.sha256(script.encode()).digest()).decode() in policy


def test_notes_that_warn_stand_above_the_answer_and_the_others_below(run: Run, tmp_path: Path) -> None:
    copy = tmp_path / "out"
    shutil.copytree(run.folder, copy)
    info = json.loads((copy / "run.json").read_text())
    info["net_notes"] = ["2 lights without a lane", "warning: 9 of 90 lanelets (10%) not driven"]
    (copy / "run.json").write_text(json.dumps(info))
    text = write_report(open_run(copy)).read_text()
    parts = ("9 of 90 lanelets (10%) not driven", 'id="answer"', "2 lights without a lane")
    places = [text.index(part) for part in parts]
    assert places == sorted(places)
    assert "<h2>Warnings</h2>" in text and "warning: 9" not in text[: text.index('id="data"')]
    assert "<h2>Warnings</h2>" not in write_report(run).read_text()
