"""Futures as OSI ground truth: omega-prime and bare traces, read back and by OSI's own library."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo.converters.datasets.recordings import read_recorded
from scex_sumo.exporters.request import EXPORTERS, Request
from scex_sumo.results.run import Run

betterosi = pytest.importorskip("betterosi")


@pytest.fixture(scope="module", params=["omega-prime", "osi"])
def trace(request: pytest.FixtureRequest, run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp(request.param)
    asked = Request(run=run, futures=(2, 0), out=out, ego=int(run.scene.track_ids[1]))
    first: Path = EXPORTERS.load(request.param)(asked)[0]
    return first


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


def test_osi_knows_the_frames_their_lanes_and_the_host(run: Run, trace: Path) -> None:
    found = list(betterosi.read(str(trace), return_ground_truth=True))
    assert len(found) == run.states(2).shape[1]
    assert [t.timestamp.seconds * 10 + t.timestamp.nanos // 10**8 for t in found] == list(range(len(found)))
    assert {t.host_vehicle_id.value for t in found} == {int(run.scene.track_ids[1])}
    lanes = Request(run=run, futures=(2,)).road.lanes
    objects = [one for t in found for one in t.moving_object]
    assigned = [i.value for one in objects for i in one.moving_object_classification.assigned_lane_id]
    assert assigned and set(assigned) <= set(lanes)
