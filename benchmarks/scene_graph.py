"""Time of the semantic scene graph per scene, and size and build time of the road index.

    python benchmarks/scene_graph.py [--vehicles 11] [--futures 1,64] [--repeats 9]

The example maps, and the real ones where SCEX_DATA or ../shared/data is there; each is populated by SUMO.
The futures of a batch are drawn half a metre apart, so that no two scenes are the same. Processor time of
the one thread there is, best of the repetitions: other jobs on the machine do not count.
"""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import is_dataclass, replace
from pathlib import Path

import numpy as np

import scex_sumo as scex
from scex_sumo.base.errors import ScexError
from scex_sumo.generators.relations import RoadIndex, road_index
from scex_sumo.roads.matching import lane_segments
from scex_sumo.scene import SceneHistory, SeedScene

DATA = Path(os.environ.get("SCEX_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))


def maps() -> list[Path]:
    own = [scex.example_path(name) for name in ("roundabout", "urban_intersection", "motorway_merge")]
    real = sorted(DATA.glob("interaction/maps/*.osm")) + sorted(DATA.glob("taf_bw/maps/*.osm"))
    sites = sorted(folder for folder in DATA.glob("mona/*") if folder.is_dir())
    return own + real + [sorted(site.glob("*.xml.gz"))[0] for site in sites]


def batch(scene: SeedScene, futures: int, draw: int) -> SceneHistory:
    rng = np.random.default_rng(draw)
    states = scene.history.repeat(futures)
    shape = (futures, scene.vehicles, 1)
    states = replace(
        states,
        x=states.x + rng.normal(0.0, 0.5, shape),
        y=states.y + rng.normal(0.0, 0.5, shape),
        heading=states.heading + rng.normal(0.0, 0.02, shape),
    )
    return SceneHistory(
        scene=scene,
        states=states,
        futures=np.arange(futures),
        step=0,
        route_draw=np.zeros(shape[:2]),
    )


def _bytes_of(table: object) -> int:
    """Memory of the arrays of an object, and of those of the objects in it."""
    parts = vars(table).values()
    inner = sum(_bytes_of(part) for part in parts if is_dataclass(part))
    return inner + sum(part.nbytes for part in parts if isinstance(part, np.ndarray))


def timed_index(scene: SeedScene) -> tuple[RoadIndex, int, float]:
    """The index of the scene's road, bytes of all tables of the road, and processor time."""
    assert scene.road is not None
    road = replace(scene.road)  # another one, of which nothing is known yet
    begin = time.process_time()
    index, segments = road_index(road), lane_segments(road)
    return index, _bytes_of(index) + _bytes_of(segments), time.process_time() - begin


def seconds(scene: SeedScene, futures: int, repeats: int) -> tuple[float, float]:
    """Per scene: processor time, and the mean number of edges."""
    best, edges = np.inf, 0
    for draw in range(repeats):
        history = batch(scene, futures, draw)
        begin = time.process_time()
        graph = scex.scene_graph(history, scene.road)
        best = min(best, time.process_time() - begin)
        edges += len(graph.edge_kind)
    return best / futures, edges / repeats / futures


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--vehicles", type=int, default=11)
    parser.add_argument("--futures", default="1,64")
    parser.add_argument("--repeats", type=int, default=9)
    options = parser.parse_args()
    counts = [int(count) for count in options.futures.split(",")]
    heads = " ".join(f"{f'ms/scene, {count}':>13}" for count in counts)
    print(f"{'map':32} lanes index kB build ms vehicles {heads} edges/scene")
    for path in maps():
        try:
            scene = scex.synthetic_seed(path, vehicles=options.vehicles)
        except ScexError as error:
            print(error)
            continue
        index, size, built = timed_index(scene)
        results = [seconds(scene, count, options.repeats) for count in counts]
        times = " ".join(f"{1e3 * took:13.3f}" for took, _ in results)
        print(
            f"{path.name.split('.')[0][:31]:32} {len(index.lane_id):5d} {size / 1000:8.0f} "
            f"{1e3 * built:8.1f} {scene.vehicles:8d} {times} {results[-1][1]:11.1f}"
        )


if __name__ == "__main__":
    main()
