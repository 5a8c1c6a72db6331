"""Report on a dataset: quality of its tracks before and after cleaning."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import ScexError
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.converters.datasets.reader import read_recorded
from scex_sumo.converters.tracks.evidence import Evidence, evidence, thinned
from scex_sumo.converters.tracks.rows import FORWARD_MPS, TrackRows
from scex_sumo.evaluation.recordings import LoadedRecording, load_recording
from scex_sumo.formats.cleaning.fit import nearest_lanes
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road

_HEADER = (
    "| recording | vehicles | minutes | path / integral of speed | acceleration 1st..99th percentile, m/s² "
    "| heading off the motion, degrees | distance to lane centre, m |\n|---|---|---|---|---|---|---|"
)


@dataclass(frozen=True, kw_only=True)
class TrackQuality:
    """Agreement of tracks with themselves and with their map.

    Attributes:
        factor: driven path over the integral of the speed.
        braking: 1st percentile of the acceleration, m/s².
        accelerating: 99th percentile of the acceleration, m/s².
        turned: median angle between heading and motion, rad.
        off_lane: median distance to the middle of the lane, m.
    """

    factor: float
    braking: float
    accelerating: float
    turned: float
    off_lane: float


def track_quality(rows: TrackRows, road: Road) -> TrackQuality:
    """Measure tracks, raw or cleaned; nan if nothing moves."""
    step_s = np.diff(rows.timestamp_ms) / 1000.0
    dx, dy = np.diff(rows.x), np.diff(rows.y)
    mean = (rows.speed[1:] + rows.speed[:-1]) / 2.0
    joined = (np.diff(rows.segment) == 0) & (step_s > 0.0)
    fast = joined & (mean > FORWARD_MPS)
    if not fast.any():
        return TrackQuality(
            **dict.fromkeys(("factor", "braking", "accelerating", "turned", "off_lane"), np.nan)
        )
    acceleration = np.diff(rows.speed)[joined] / step_s[joined]
    low, high = np.percentile(acceleration, (1.0, 99.0))
    heading = rows.psi_rad[:-1] + wrap(np.diff(rows.psi_rad)) / 2.0
    return TrackQuality(
        factor=float(np.hypot(dx, dy)[fast].sum() / (mean * step_s)[fast].sum()),
        braking=float(low),
        accelerating=float(high),
        turned=float(np.median(np.abs(wrap(heading - np.arctan2(dy, dx)))[fast])),
        off_lane=_lane_distance(evidence(rows), road),
    )


@checked
def dataset_report(roots: Sequence[str | Path]) -> str:
    """Return a Markdown table of all recordings below folders, before and after cleaning.

    A recording that cannot be read is listed with the reason.

    Raises:
        TrackError: there is no recording.

    Example:
        >>> scex.dataset_report([scex.example_path("roundabout")]).splitlines()[0][:22]
        '| recording | vehicles'
    """
    lines = [_HEADER]
    findings = []
    for recording in find_recordings(roots):
        try:
            loaded = load_recording(recording)
            lines.append(_row(loaded))
        except ScexError as error:
            findings.append(f"- {recording.name}: not read: {error}")
            continue
        said = "; ".join(part for part in (*loaded.findings, loaded.table.rate) if part)
        findings.append(f"- {recording.name}: {said or 'nothing to repair'}")
    return "\n".join([*lines, "", *findings])


def _row(loaded: LoadedRecording) -> str:
    raw = read_recorded(loaded.recording.track_paths)[0].vehicles
    clean = loaded.table.vehicles
    before, after = track_quality(raw, loaded.road), track_quality(clean, loaded.road)
    minutes = np.ptp(clean.timestamp_ms) / 60_000.0
    columns = [
        loaded.recording.name,
        str(clean.tracks),
        f"{minutes:.1f}",
        f"{before.factor:.2f} → {after.factor:.2f}",
        f"{before.braking:.1f}..{before.accelerating:.1f} → {after.braking:.1f}..{after.accelerating:.1f}",
        f"{np.degrees(before.turned):.1f} → {np.degrees(after.turned):.1f}",
        f"{before.off_lane:.2f} → {after.off_lane:.2f}",
    ]
    return f"| {' | '.join(columns)} |"


def _lane_distance(samples: Evidence, road: Road) -> float:
    """Return the median distance of samples to the middle of their lanes, m; nan without any."""
    few = thinned(samples)
    offsets = nearest_lanes(road, few.x, few.y, few.heading)[2] if len(few.x) else np.zeros(0)
    return float(np.median(np.abs(offsets))) if len(offsets) else math.nan
