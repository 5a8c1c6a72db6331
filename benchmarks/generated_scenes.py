"""How far generated scenes are from recorded ones of the test parts, and those of `--synthetic`.

python benchmarks/generated_scenes.py DATA/mona DATA/taf_bw DATA/ngsim
python benchmarks/generated_scenes.py DATA/mona DATA/taf_bw DATA/ngsim --left-out FOLDER --each 1

A scene has as many vehicles as a recorded one, in the region that the recording sees. SUMO populates the
whole map as densely; its scenes are cut to that region. Distances are Wasserstein's of the values of all
vehicles (conflicts: of all scenes), and the maximum mean discrepancy of scenes, those of generated ones on
average over `--each` draws; the last number of a cell is that of the two halves of the recorded scenes, by
time. A classifier tells generated scenes from recorded ones; recorded seconds that follow each other are in
one fold; the last line says how well it tells them without each of its features. `--left-out` trains a model
without each place, which it keeps in the folder, and measures its sites.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
import warnings
from collections.abc import Mapping, Sequence
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
EVERY_S, BLOCK = 2.0, 3  # between two scenes; scenes in one fold
MOMENTS = 800  # of a site, that a model is trained on
MIN_SCENES = 14  # for a classifier
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


def features_of(values: dict[str, FloatArray]) -> dict[str, float]:
    """Return a dozen features of a scene for the classifier."""
    gap, speed = values["nearest gap"], values["speed"]
    return {
        "gap": gap.mean(),
        "least gap": gap.min(),
        "speed": speed.mean(),
        "spread of speeds": speed.std(),
        "standing": (speed < 0.5).mean(),
        "density": values["density"].mean(),
        "spread of densities": values["density"].std(),
        "deceleration needed": values["deceleration needed"].max(),
        "conflicts": values["conflicts"][0],
        "acceleration": np.abs(values["acceleration"]).mean(),
        "offset": np.abs(values["offset"]).mean(),
        "ahead": values["ahead"].mean(),
    }


Values = list[dict[str, FloatArray]]


def distances(recorded: Values, made: Values) -> dict[str, float]:
    """Return the distances of two sets of scenes, by quantity and of whole scenes."""
    found = {
        name: float(
            wasserstein_distance(*(np.concatenate([v[name] for v in side]) for side in (recorded, made)))
        )
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


def area_under_curve(sides: Sequence[tuple[Values, Values]], without: str = "") -> float:
    """Return how well boosted trees tell recorded from made scenes, cross-validated by blocks of time.

    Args:
        without: a feature that they do not see.
    """
    from sklearn.ensemble import GradientBoostingClassifier
    from sklearn.metrics import roc_auc_score
    from sklearn.model_selection import GroupKFold, cross_val_predict

    rows, label, group = [], [], []
    for number, (recorded, made) in enumerate(sides):
        for kind, values in enumerate((recorded, made)):
            rows += [[x for name, x in features_of(v).items() if name != without] for v in values]
            label += [kind] * len(values)
            group += [100 * number + k // BLOCK for k in range(len(values))]
    trees = GradientBoostingClassifier(n_estimators=100, max_depth=3, subsample=0.7, random_state=0)
    folds = GroupKFold(5)
    found = cross_val_predict(trees, np.array(rows), label, groups=group, cv=folds, method="predict_proba")
    return float(roc_auc_score(label, found[:, 1]))


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


def draw(file: Path, sides: Mapping[str, Sequence[SeedScene]], seen: Mapping[str, shapely.Geometry]) -> None:
    """Draw twenty scenes of one kind beside twenty of another; colours are speeds.

    Args:
        sides: scenes by the title of their half.
        seen: what is drawn of each map, by its name.
    """
    import matplotlib.pyplot as plt
    from matplotlib.collections import LineCollection, PolyCollection

    figure, axes = plt.subplots(4, 11, figsize=(16, 4.4), width_ratios=[1] * 5 + [0.1] + [1] * 5)
    figure.subplots_adjust(left=0.0, right=0.93, bottom=0.0, top=0.94, wspace=0.02, hspace=0.02)
    for first, (title, scenes) in zip((0, 6), sides.items(), strict=True):
        axes[0, first + 2].set_title(title)
        for k, scene in enumerate(scenes[j] for j in thinned(len(scenes), 20)):
            axis, region = axes[k // 5, first + k % 5], seen[scene.road.name]  # type: ignore[union-attr]
            lanes = [lane.centreline for lane in scene.road.vehicle_lanes.values()]  # type: ignore[union-attr]
            axis.add_collection(LineCollection(lanes, colors="0.85", linewidths=0.6))
            now = scene.now
            inside = shapely.contains_xy(region, now.x, now.y)
            forward = np.stack([np.cos(now.heading), np.sin(now.heading)], 1) * scene.length[:, None] / 2
            left = np.stack([-np.sin(now.heading), np.cos(now.heading)], 1) * scene.width[:, None] / 2
            centre = np.stack([now.x, now.y], 1)
            corners = np.stack(
                [centre + a * forward + b * left for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))], 1
            )
            boxes = PolyCollection(corners[inside], array=now.speed[inside], cmap="viridis")
            boxes.set_clim(0.0, 20.0)
            boxes.set(edgecolor="face", linewidth=2.0)  # larger than life, to be seen
            axis.add_collection(boxes)
            x0, y0, x1, y1 = region.bounds
            axis.set(xlim=(x0, x1), ylim=(y0, y1), aspect="equal")
    for axis in axes.flat:
        axis.set_axis_off()
    figure.colorbar(boxes, cax=figure.add_axes((0.95, 0.15, 0.01, 0.7)), label="speed [m/s]")
    figure.savefig(file, dpi=75)


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
    parser.add_argument("--picture", type=Path, help="draw twenty scenes of each kind")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    sides: dict[tuple[str, int], list[tuple[Values, Values]]] = {}
    ratios: list[dict[str, float]] = []
    columns = (*VALUES, "MMD", "AUC")
    print(f"| site | scenes | {' | '.join(columns)} |\n|---|---|{'---|' * len(columns)}")
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
        if given.picture is not None and len(draws[0]) >= 20:
            draw(given.picture, {"recorded": site.scenes, "generated": draws[0]}, site.seen)
            given.picture = None
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
            for number, values in enumerate(kinds):
                sides.setdefault((name, number), []).append((recorded, values))
        half = len(recorded) // 2
        if half:
            found["halves"] = distances(recorded[:half], recorded[half:])
        for name in found.keys() & made.keys() if len(recorded) >= MIN_SCENES else ():
            curves = [area_under_curve([(recorded, values)]) for values in made[name]]
            found[name]["AUC"] = float(np.mean(curves))
        cells = [" / ".join(f"{d[c]:.2f}" for d in found.values() if c in d) or "–" for c in columns]
        note = f" ({fewer} with fewer vehicles)" if fewer else ""
        print(f"| {site.name} | {len(recorded)}{note} | {' | '.join(cells)} |", flush=True)
        if "synthetic" in found:
            pairs = found["generated"], found["synthetic"]
            ratios.append({c: pairs[0][c] / max(pairs[1][c], 1e-3) for c in columns if c in pairs[0]})
    if ratios:
        medians = [f"{np.median([r[c] for r in ratios if c in r] or [np.nan]):.2f}" for c in columns]
        print(f"| median ratio | | {' | '.join(medians)} |")
    for name in dict.fromkeys(name for name, _ in sides):
        draws_of = [pairs for (of, _), pairs in sides.items() if of == name]
        if sum(len(recorded) for recorded, _ in draws_of[0]) >= MIN_SCENES:
            curve = np.mean([area_under_curve(pairs) for pairs in draws_of])
            print(f"AUC of {name} against recorded: {curve:.2f}")
            if name == "generated":
                less = {f: area_under_curve(draws_of[0], f) for f in features_of(draws_of[0][0][0][0])}
                words = ", ".join(f"{f} {value:.2f}" for f, value in sorted(less.items(), key=lambda x: x[1]))
                print(f"first draws: {area_under_curve(draws_of[0]):.2f}; without {words}")


if __name__ == "__main__":
    main()
