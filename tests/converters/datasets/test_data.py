"""The real recordings: all of them load, are cleaned, and lie on their maps."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.evaluation.recordings import LoadedRecording, load_recording
from scex_sumo.formats.commonroad.tracks import read_commonroad_tracks


def load(root: Path) -> LoadedRecording:
    return load_recording(find_recordings([root])[0])


def test_every_recording_here_is_found(data: Path) -> None:
    found = find_recordings([data / "mona", data / "ngsim", data / "taf_bw"])
    cut_apart = len(list((data / "ngsim").glob("*.xml.gz")))  # scenarios of a site that do not join
    assert len(found) == 20 + cut_apart
    assert {r.dataset for r in found} == {"commonroad", "taf_bw"}
    assert [len(r.track_paths) for r in found if "MONA" in r.name] == [24, 24, 24]


def test_k733_is_repaired_and_lies_on_its_lanes(data: Path) -> None:
    said = " ".join(load(data / "taf_bw/maps/k733_2020-09-15.osm").findings)
    (slow,) = map(float, re.findall(r"contradict the motion \(([\d.]+) x too small\)", said))
    ((before, after),) = (
        map(float, pair) for pair in re.findall(r"lane centre ([\d.]+) -> ([\d.]+) m", said)
    )
    assert slow == pytest.approx(1.75, abs=0.03)
    assert before > 0.6 and after < 0.35


def test_all_of_k729_is_moved_alike(data: Path) -> None:
    recordings = find_recordings([data / "taf_bw/maps/k729_2022-03-16.osm"])
    said = {f for r in recordings[:4] for f in load_recording(r).findings if "aligned to the map" in f}
    (phrase,) = said
    before, after = map(float, re.findall(r"([\d.]+) -> ([\d.]+) m", phrase)[0])
    assert before > 0.8 and after < 0.4
    assert "estimated from 16 recordings of the site" in phrase


def test_monas_chunks_fit_at_their_seams(data: Path) -> None:
    loaded = load(data / "mona/MONA-Merge")
    assert np.ptp(loaded.table.vehicles.timestamp_ms) == pytest.approx(24 * 16_000.0, abs=400.0)
    chunks = [read_commonroad_tracks(path)[0].vehicles for path in loaded.recording.track_paths]
    for one, other in itertools.pairwise(chunks):
        for label in set(one.labels) & set(other.labels):
            last = np.flatnonzero(one.track == one.labels.index(label))[-1]
            first = np.flatnonzero(other.track == other.labels.index(label))[0]
            step = np.hypot(other.x[first] - one.x[last], other.y[first] - one.y[last])
            mean = (other.speed[first] + one.speed[last]) / 2.0
            # One time step of 0.2 s lies between them; 0.05 m is what speeds are rounded and smoothed by.
            assert step == pytest.approx(0.2 * mean, abs=0.05)
