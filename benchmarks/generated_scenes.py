"""How far generated scenes are from recorded ones of the test parts, and those of `--synthetic`.

python benchmarks/generated_scenes.py DATA/mona DATA/taf_bw DATA/ngsim
python benchmarks/generated_scenes.py DATA/mona DATA/taf_bw DATA/ngsim --left-out FOLDER --each 1

A scene has as many vehicles as a recorded one, in the region that the recording sees. SUMO populates the
whole map as densely; its scenes are cut to that region. Distances are Wasserstein's of the values of all
vehicles (conflicts: of all scenes), those of generated ones on average over `--each` draws; the last number
of a cell is that of the two halves of the recorded scenes, by time. `--left-out` trains a model without each
place, which it keeps in the folder, and measures its sites.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from recorded_scenes import NGSIM_TEST, NGSIM_VALIDATION
from scipy.stats import wasserstein_distance

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.errors import ScexError
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.evaluation.recordings import load_recording
from scex_sumo.evaluation.split import Part, Split
from scex_sumo.generators.generate import generated_scene
from scex_sumo.generators.scene_context import Placed, lane_cells, placed_on_lanes, states_of
from scex_sumo.generators.scene_model import KINDS, SHIPPED, SceneModel, load_scenes, save_scenes
from scex_sumo.generators.synthetic import synthetic_scene
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.learned.training.data.dataset import part_scenes
from scex_sumo.learned.training.scenes import seen_part, train_scenes
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene

PARTS: tuple[Part, ...] = ("train", "validation", "test")
EVERY_S = 2.0  # between two scenes
MOMENTS = 800  # of a site, that a model is trained on
VALUES = ("nearest gap", "speed", "density", "deceleration needed", "conflicts")
NEAR_M, AHEAD_S = 40.0, np.arange(0.0, 3.01, 0.25)


@dataclass(frozen=True, kw_only=True, eq=False)
class Site:
    """Recorded scenes of a site, and what the recording sees of the map."""

    name: str
    scenes: tuple[SeedScene, ...]
    seen: dict[str, shapely.Geometry]  # by name of the map

    def cells(self, road: Road) -> BoolArray:
        """Return the cells of the lanes that the recording sees."""
        x, y, _ = lane_cells(road).cell_pose
        return np.asarray(shapely.contains_xy(self.seen[road.name], x, y))

    def share(self, road: Road) -> float:
        table = lane_cells(road)
        return float(table.cell_m[self.cells(road)].sum() / table.cell_m.sum())


def sites_of(roots: Sequence[Path], most: int, taken: Sequence[Part] = ("test",)) -> list[Site]:
    """Return the sites of recordings, with at most so many scenes of parts of them, evenly thinned."""
    recordings = find_recordings(roots)
    short: dict[str, tuple[str, ...]] = {}
    for part, marks in (("test", NGSIM_TEST), ("validation", NGSIM_VALIDATION)):
        short[part] = tuple(r.name for r in recordings if any(mark in r.name for mark in marks))
    split = Split(kept_test=short["test"], kept_validation=short["validation"])
    chosen: dict[str, list[SeedScene]] = {}
    every: dict[str, list[SeedScene]] = {}
    for recording in recordings:
        loaded = load_recording(recording)
        for part in PARTS:
            scenes = part_scenes(loaded, part, split=split, every_s=EVERY_S)
            every.setdefault(loaded.road.name, []).extend(scenes)
            if part in taken:
                chosen.setdefault(recording.site, []).extend(scenes)
    seen = {name: seen_part(scenes) for name, scenes in every.items() if scenes}
    return [
        Site(name=name, scenes=tuple(scenes[k] for k in thinned(len(scenes), most)), seen=seen)
        for name, scenes in chosen.items()
        if scenes
    ]


def thinned(count: int, most: int) -> list[int]:
    """Return at most so many evenly spread numbers below a count."""
    return sorted({round(k) for k in np.linspace(0, count - 1, min(count, most)).tolist()})


def values_of(scene: SeedScene, seen: shapely.Geometry) -> dict[str, FloatArray] | None:
    """Return values of each vehicle on a lane within a region (conflicts: one); None without any."""
    assert scene.road is not None
    table = lane_cells(scene.road)
    placed, vehicle = placed_on_lanes(scene, KINDS, np.random.default_rng(0))
    inside = np.flatnonzero(shapely.contains_xy(seen, scene.now.x[vehicle], scene.now.y[vehicle]))
    if not len(inside):
        return None
    placed, now = placed.take(inside), scene.now[vehicle[inside]]
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
    }


def _steady(placed: Placed) -> Placed:
    return dataclasses.replace(placed, acceleration=np.zeros_like(placed.speed))


Values = list[dict[str, FloatArray]]


def distances(recorded: Values, made: Values) -> dict[str, float]:
    """Return the distances of two sets of scenes by quantity."""
    sides = {n: [np.concatenate([v[n] for v in side]) for side in (recorded, made)] for n in VALUES}
    return {name: float(wasserstein_distance(*both)) for name, both in sides.items()}


def model_without(site: str, roots: Sequence[Path], folder: Path) -> SceneModel:
    """Return the model of a folder that was not fitted to the place of a site; train it if it is missing."""
    import torch

    place = site.rpartition("-")[0] or site
    file = folder / f"{place}.safetensors"
    if not file.is_file():
        torch.set_num_threads(1)
        kept = [r for r in find_recordings(roots) if not r.site.startswith(place)]
        kept = [r for r in kept if not any(mark in r.name for mark in NGSIM_TEST)]
        short = tuple(r.name for r in kept if any(mark in r.name for mark in NGSIM_VALIDATION))
        tensors, meta = train_scenes(kept, split=Split(kept_validation=short), moments=MOMENTS)
        folder.mkdir(parents=True, exist_ok=True)
        save_scenes(file, tensors, meta)
    return load_scenes(file)


def values_of_all(site: Site, scenes: Sequence[SeedScene]) -> Values:
    found = (values_of(scene, site.seen[scene.road.name]) for scene in scenes if scene.road is not None)
    return [values for values in found if values is not None]


def seen_vehicles(site: Site, scene: SeedScene) -> int:
    """Return the number of vehicles on lanes within the seen part."""
    assert scene.road is not None
    values = values_of(scene, site.seen[scene.road.name])
    return 1 if values is None else len(values["speed"])


def wanted(site: Site, scene: SeedScene) -> int:
    """Return the number of vehicles with which the whole map is as dense as the recorded part."""
    assert scene.road is not None
    return max(1, round(seen_vehicles(site, scene) / site.share(scene.road)))


def synthetic(site: Site, most: int) -> tuple[Values, int]:
    """Return scenes of `--synthetic`, and how many have fewer vehicles, because SUMO gets no more in."""
    made, fewer = [], 0
    for number in thinned(len(site.scenes), most):
        scene = site.scenes[number]
        road = scene.road
        assert road is not None
        with tempfile.TemporaryDirectory() as folder:
            net = converted(road, Path(folder) / "net.net.xml", keep=True).path
            for less in (1.0, 0.7, 0.5):
                try:
                    count = max(1, round(less * wanted(site, scene)))
                    one = synthetic_scene(road, net, vehicles=count, seed=number, name="synthetic")
                except ScexError:
                    continue
                made.append(dataclasses.replace(one, road=road))
                fewer += less < 1.0
                break
    return values_of_all(site, made), fewer


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("roots", nargs="+", type=Path)
    parser.add_argument("--scenes", type=Path, default=SHIPPED, help="scene model")
    parser.add_argument("--sites", nargs="*", help="only these, by the beginning of their names")
    parser.add_argument(
        "--left-out", type=Path, metavar="FOLDER", help="measure all parts with models that miss the site"
    )
    parser.add_argument("--synthetic", type=int, default=20, help="scenes of SUMO at each site; 0: none")
    parser.add_argument("--most", type=int, default=20, help="recorded scenes of each site")
    parser.add_argument("--each", type=int, default=4, help="draws of all scenes, over which is averaged")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    ratios: list[dict[str, float]] = []
    print(f"| site | scenes | {' | '.join(VALUES)} |\n|---|---|{'---|' * len(VALUES)}")
    for site in sites_of(given.roots, given.most, PARTS if given.left_out else ("test",)):
        if given.sites and not any(site.name.startswith(name) for name in given.sites):
            continue
        model = (
            model_without(site.name, given.roots, given.left_out)
            if given.left_out
            else load_scenes(given.scenes)
        )
        recorded = values_of_all(site, site.scenes)
        draws = [
            [
                generated_scene(
                    scene.road,
                    model,
                    vehicles=seen_vehicles(site, scene),
                    seed=seed,
                    number=k,
                    cells=site.cells(scene.road),
                )
                for k, scene in enumerate(site.scenes)
                if scene.road is not None
            ]
            for seed in range(given.each)
        ]
        made = {"generated": [values_of_all(site, scenes) for scenes in draws]}
        fewer = 0
        if given.synthetic:
            every, fewer = synthetic(site, given.synthetic)
            made["synthetic"] = [every] if every else []
        found: dict[str, dict[str, float]] = {}
        for name, kinds in made.items():
            each = [distances(recorded, values) for values in kinds]
            if each:
                found[name] = {key: float(np.mean([d[key] for d in each])) for key in each[0]}
        half = len(recorded) // 2
        if half:
            found["halves"] = distances(recorded[:half], recorded[half:])
        cells = [" / ".join(f"{d[c]:.2f}" for d in found.values()) or "–" for c in VALUES]
        note = f" ({fewer} with fewer vehicles)" if fewer else ""
        print(f"| {site.name} | {len(recorded)}{note} | {' | '.join(cells)} |", flush=True)
        if "synthetic" in found:
            pairs = found["generated"], found["synthetic"]
            ratios.append({c: pairs[0][c] / max(pairs[1][c], 1e-3) for c in VALUES})
    if ratios:
        medians = [f"{np.median([r[c] for r in ratios]):.2f}" for c in VALUES]
        print(f"| median ratio | | {' | '.join(medians)} |")


if __name__ == "__main__":
    main()
