"""How far generated scenes are from recorded ones of the test parts, and those of `--synthetic`.

python benchmarks/generated_scenes.py DATA/mona DATA/taf_bw DATA/ngsim [--scenes FILE] [--sites NAME ...]

Every scene is made for the whole map with the density of a recorded one. It is compared within the region that the recording
sees. Distances are Wasserstein's of the values of all vehicles (conflicts: of all scenes), and the maximum mean discrepancy of
scenes. A classifier tells generated scenes from recorded ones; recorded seconds that follow each other are in one fold.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from recorded_scenes import NGSIM_TEST, NGSIM_VALIDATION
from scipy.stats import wasserstein_distance

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import ScexError
from scex_sumo.converters.datasets.recordings import find_recordings, load_recording
from scex_sumo.converters.datasets.split import Split
from scex_sumo.converters.net.convert import converted
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.road import Road
from scex_sumo.scenarios.generate import generated_scene
from scex_sumo.scenarios.scene_context import Placed, lane_table, on_lanes, states_of
from scex_sumo.scenarios.scene_model import KINDS, SHIPPED, load_scenes
from scex_sumo.scenarios.synthetic import synthetic_scene
from scex_sumo.scene import SeedScene
from scex_sumo.training.data.dataset import part_scenes
from scex_sumo.training.scenes import seen_part

EVERY_S, BLOCK = 2.0, 5  # between two scenes; scenes in one fold
VALUES = ("nearest gap", "speed", "density", "deceleration needed", "conflicts")
NEAR_M, AHEAD_S = 40.0, np.arange(0.0, 3.01, 0.25)


@dataclass(frozen=True, kw_only=True, eq=False)
class Site:
    """Recorded scenes of the test part of a site, and what the recording sees of the map."""

    name: str
    scenes: tuple[SeedScene, ...]
    seen: dict[str, shapely.Geometry]  # by name of the map

    def share(self, road: Road) -> float:
        table = lane_table(road)
        x, y, _ = table.poses(table.cell_lane, table.cell_s[:, None])
        inside = shapely.contains_xy(self.seen[road.name], x[:, 0], y[:, 0])
        return float(table.cell_m[inside].sum() / table.total_m)


def sites_of(roots: Sequence[Path]) -> list[Site]:
    """Return the sites of recordings, with the scenes of their test parts."""
    recordings = find_recordings(roots)
    short: dict[str, tuple[str, ...]] = {}
    for part, marks in (("test", NGSIM_TEST), ("validation", NGSIM_VALIDATION)):
        short[part] = tuple(r.name for r in recordings if any(mark in r.name for mark in marks))
    split = Split(kept_test=short["test"], kept_validation=short["validation"])
    test: dict[str, list[SeedScene]] = {}
    every: dict[str, list[SeedScene]] = {}
    for recording in recordings:
        loaded = load_recording(recording)
        for part in ("train", "validation", "test"):
            scenes = part_scenes(loaded, part, split=split, every_s=EVERY_S)
            every.setdefault(loaded.road.name, []).extend(scenes)
            if part == "test":
                test.setdefault(recording.site, []).extend(scenes)
    seen = {name: seen_part(scenes) for name, scenes in every.items() if scenes}
    return [Site(name=name, scenes=tuple(scenes), seen=seen) for name, scenes in test.items() if scenes]


def values_of(scene: SeedScene, seen: shapely.Geometry) -> dict[str, FloatArray] | None:
    """Return values of each vehicle on a lane within a region (conflicts: one); None without any."""
    assert scene.road is not None
    table = lane_table(scene.road)
    placed, vehicle = on_lanes(scene, KINDS, np.random.default_rng(0))
    inside = np.flatnonzero(shapely.contains_xy(seen, scene.now.x[vehicle], scene.now.y[vehicle]))
    if not len(inside):
        return None
    placed, now = placed[inside], scene.now[vehicle[inside]]
    count = len(inside)
    pair = np.triu_indices(count, 1)
    near = np.full((count, count), 100.0)
    apart = np.hypot(now.x[:, None] - now.x, now.y[:, None] - now.y)
    boxes = [Rectangles.of(now[k], placed.length[k], placed.width[k]) for k in pair]
    near[pair] = near.T[pair] = np.minimum(rectangle_distance(boxes[0], boxes[1]), 100.0)
    onward = states_of(table, _steady(placed), AHEAD_S)
    boxes = [Rectangles.of(onward[k], placed.length[k, None], placed.width[k, None]) for k in pair]
    touch = (rectangle_distance(boxes[0], boxes[1]) <= 0).any(axis=1)
    way = table.relations.ahead[placed.lane[:, None], placed.lane] + placed.s - placed.s[:, None]
    way = np.where(way > 0, way, np.inf) - (placed.length[:, None] + placed.length) / 2
    closing = np.maximum(placed.speed[:, None] - placed.speed, 0.0)
    needed = (closing**2 / (2 * np.maximum(way, 0.1))).max(axis=1, initial=0.0)
    return {
        "nearest gap": near.min(axis=1, initial=100.0),
        "speed": placed.speed,
        "density": (apart < NEAR_M).sum(axis=1) - 1.0,
        "deceleration needed": np.minimum(needed, 10.0),
        "conflicts": np.array([touch.sum() / count]),
        "acceleration": np.nan_to_num(placed.acceleration),
        "offset": placed.offset,
        "turn": placed.turn,
        "length": placed.length,
        "ahead": np.minimum(way.min(axis=1), 100.0),
    }


def _steady(placed: Placed) -> Placed:
    return dataclasses.replace(placed, acceleration=np.zeros_like(placed.speed))


def row_of(values: dict[str, FloatArray]) -> list[float]:
    """Return a dozen features of a scene for the classifier."""
    gap, speed = values["nearest gap"], values["speed"]
    return [
        gap.mean(),
        gap.min(),
        speed.mean(),
        speed.std(),
        (speed < 0.5).mean(),
        values["density"].mean(),
        values["density"].std(),
        values["deceleration needed"].max(),
        values["conflicts"][0],
        np.abs(values["acceleration"]).mean(),
        np.abs(values["offset"]).mean(),
        values["ahead"].mean(),
    ]


Values = list[dict[str, FloatArray]]


def distances(recorded: Values, made: Values) -> dict[str, float]:
    """Return the distances of two sets of scenes, by quantity and of whole scenes."""
    found = {
        name: float(wasserstein_distance(*(np.concatenate([v[name] for v in side]) for side in (recorded, made))))
        for name in VALUES
    }
    one, two = (np.array([[v[name].mean() for name in VALUES] for v in side]) for side in (recorded, made))
    return {**found, "MMD": mmd(one, two)}


def mmd(one: FloatArray, two: FloatArray) -> float:
    """Return the maximum mean discrepancy of scaled rows, with a Gaussian kernel of the median distance."""
    scale = one.std(axis=0) + 1e-3
    both = np.vstack([one, two]) / scale
    apart = ((both[:, None] - both) ** 2).sum(axis=2)
    kernel = np.exp(-apart / max(float(np.median(apart[apart > 0])), 1e-9))
    n = len(one)
    square = kernel[:n, :n].mean() + kernel[n:, n:].mean() - 2 * kernel[:n, n:].mean()
    return float(np.sqrt(max(square, 0.0)))


def area_under_curve(sides: Sequence[tuple[Values, Values]]) -> float:
    """Return how well boosted trees tell recorded (first) from made scenes, cross-validated by blocks of time."""
    from sklearn.ensemble import GradientBoostingClassifier
    from sklearn.metrics import roc_auc_score
    from sklearn.model_selection import GroupKFold, cross_val_predict

    rows, label, group = [], [], []
    for number, (recorded, made) in enumerate(sides):
        for kind, values in enumerate((recorded, made)):
            rows += [row_of(v) for v in values]
            label += [kind] * len(values)
            group += [100 * number + k // BLOCK for k in range(len(values))]
    trees = GradientBoostingClassifier(n_estimators=100, max_depth=3, subsample=0.7, random_state=0)
    folds = GroupKFold(5)
    found = cross_val_predict(trees, np.array(rows), label, groups=group, cv=folds, method="predict_proba")
    return float(roc_auc_score(label, found[:, 1]))
