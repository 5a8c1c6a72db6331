"""Futures as OSI ground truth: omega-prime and bare traces, read back and by OSI's own library."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scex_sumo.converters.datasets.reader import read_recorded
from scex_sumo.converters.maps import read_map
from scex_sumo.exporters.light_cycles import LightCycle
from scex_sumo.exporters.request import EXPORTERS, Request
from scex_sumo.formats.osi import OSI
from scex_sumo.results.run import Run

betterosi = pytest.importorskip("betterosi")


@pytest.fixture(scope="module", params=["omega-prime", "osi"])
def trace(request: pytest.FixtureRequest, run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp(request.param)
    asked = Request(run=run, futures=(2, 0), out=out, ego=int(run.scene.track_ids[1]))
    first: Path = EXPORTERS.load(request.param)(asked)[0]
    return first


def truths(trace: Path) -> list[Any]:
    return list(betterosi.read(str(trace), return_ground_truth=True))


def test_the_states_read_back_are_the_same(run: Run, trace: Path) -> None:
    rows, states = read_recorded([trace])[0].vehicles, run.states(2)
    assert sorted(map(int, rows.labels)) == run.scene.track_ids.tolist()
    for k, label in enumerate(rows.labels):
        v = int(np.flatnonzero(run.scene.track_ids == int(label))[0])
        mine = rows.track == k
        np.testing.assert_allclose(rows.x[mine], states.x[v], atol=1e-6)
        np.testing.assert_allclose(rows.y[mine], states.y[v], atol=1e-6)
        np.testing.assert_allclose(rows.speed[mine], states.speed[v], atol=1e-6)
        np.testing.assert_allclose(np.cos(rows.psi_rad[mine]), np.cos(states.heading[v]), atol=1e-6)
        assert set(rows.length[mine]) == {run.scene.length[v]}
        assert rows.types[k] == run.scene.types[v]


def test_the_map_comes_with_the_trace(run: Run, trace: Path) -> None:
    (recording,) = OSI.recordings([trace])
    road, own = read_map(recording.map_path), Request(run=run, futures=(2,)).road
    length = [sum(np.hypot(*np.diff(x.centreline, axis=0).T).sum() for x in r.vehicle_lanes.values())
              for r in (road, own)]  # fmt: skip
    assert length[0] == pytest.approx(length[1], rel=0.1)


def test_osi_knows_the_frames_their_lanes_and_the_host(run: Run, trace: Path) -> None:
    found = truths(trace)
    assert len(found) == run.states(2).shape[1]
    assert [t.timestamp.seconds * 10 + t.timestamp.nanos // 10**8 for t in found] == list(range(len(found)))
    assert {t.host_vehicle_id.value for t in found} == {int(run.scene.track_ids[1])}
    lanes = Request(run=run, futures=(2,)).road.lanes
    objects = [one for t in found for one in t.moving_object]
    assigned = [i.value for one in objects for i in one.moving_object_classification.assigned_lane_id]
    assert assigned and set(assigned) <= set(lanes)


def test_omega_prime_says_who_drives(run: Run, tmp_path: Path) -> None:
    (file,) = EXPORTERS.load("omega-prime")(Request(run=run, futures=(2,), out=tmp_path / "one.mcap"))
    from betterosi import read_file_metadata

    own = next(entry for entry in read_file_metadata(file) if entry["name"] == "scex-sumo")["data"]
    track = run.scene.track_ids.tolist()[0]
    assert (own["future"], own[f"model of {track}"]) == ("2", run.models_of(2)[0])


def test_the_same_future_gives_the_same_bytes(run: Run, tmp_path: Path) -> None:
    write = EXPORTERS.load("omega-prime")
    one, two = (write(Request(run=run, futures=(2,), out=tmp_path / f"{k}.mcap"))[0] for k in "ab")
    assert one.read_bytes() == two.read_bytes()


@pytest.mark.parametrize(("step", "letter"), [(-1, "r"), (0, "G"), (29, "G"), (30, "y"), (33, "r")])
def test_a_cycle_shows_its_letters_again_and_again(step: int, letter: str) -> None:
    assert LightCycle(phases=((30, "G"), (3, "y"), (27, "r")), offset=0).at(step) == letter
