"""``scex-sumo generate``: seed scenes on a map as recorded ones look, as cases in INTERACTION's format."""

from __future__ import annotations

import json
import shlex
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from typer import Option

from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.base.files import check_output, output, write_output
from scex_sumo.commands.console import progress_bar, warn
from scex_sumo.commands.options import MapPath, Origin, Overwrite, Seed

if TYPE_CHECKING:
    from scex_sumo.base.progress import Progress
    from scex_sumo.scene import SeedScene

MAX_COUNT = 10_000
EACH = 5  # candidates for each scene of --critical
MEANING = (
    "Weights of cases with a property add up to its estimated share among scenes without --critical. "
    "critical_encounters: of a future, on average."
)
EXAMPLE = "scex_sumo/scenarios/data/roundabout.osm --count 2 -o out/scenes"


def generate_command(
    map_path: MapPath,
    vehicles: Annotated[
        int | None, Option(metavar="N", help="Vehicles of a scene; default: drawn as recorded.")
    ] = None,
    count: Annotated[int, Option(help="Number of scenes.")] = 20,
    scenes: Annotated[
        Path | None, Option(metavar="FILE", help="Scene model of 'train scenes'; default: the shipped one.")
    ] = None,
    origin: Origin = None,
    people: Annotated[
        int, Option(metavar="N", help="Pedestrians and cyclists beside the vehicles of each scene.")
    ] = 0,
    critical: Annotated[
        bool,
        Option(
            "--critical",
            help="Draw more scenes whose futures have critical encounters. The weight of a case is the share "
            "of the scenes without this option that it stands for.",
        ),
    ] = False,
    seed: Seed = 0,
    overwrite: Overwrite = False,
    out: Annotated[
        Path | None, Option("-o", "--out", metavar="DIR", help="Folder for map and cases.")
    ] = None,
) -> None:
    """Generate moments of traffic on a map, as recorded ones look."""
    from scex_sumo.converters.datasets.writer import write_tracks
    from scex_sumo.converters.lanelet.origin import META_DATA, parse_origin, recorded_origin
    from scex_sumo.converters.maps import LANELET2, read_map
    from scex_sumo.converters.naming import map_name
    from scex_sumo.converters.registries import map_format
    from scex_sumo.generators.generate import generated_scene
    from scex_sumo.generators.people import add_people
    from scex_sumo.generators.scene_model import SHIPPED, load_scenes
    from scex_sumo.roads.mirror import drawn_on

    if not 1 <= count <= MAX_COUNT:
        raise UsageError(f"--count: got {count:,}, needs 1 to {MAX_COUNT:,}")
    number = min(EACH * count, MAX_COUNT) if critical else count
    model = load_scenes(scenes or SHIPPED)
    road = read_map(map_path, origin=parse_origin(origin) if origin is not None else None, own_corner=True)
    warn(road.notes)
    folder = out if out is not None else Path("out") / f"{road.name}_generated"
    cases = folder / f"{map_name(map_path)}.csv"
    if folder.is_file():
        raise UsageError(f"-o {folder}: is a file; name a folder")
    target, weights = folder / map_path.name, cases.with_suffix(".weights.json")
    if cases.exists() and not overwrite:
        raise ResultError(f"{cases}: exists; --overwrite replaces it")
    copied = not target.exists() or not target.samefile(map_path)
    local = map_format(map_path).read is not LANELET2.read or road.origin == (0.0, 0.0)
    origins = [] if local or recorded_origin(target) == road.origin else [folder / META_DATA]
    for file in (cases, weights, *origins, *([target] if copied else [])):
        check_output(file, scenes)
    drawn, one = [], partial(generated_scene, model=model, vehicles=vehicles, seed=seed)
    with progress_bar(f"generating {road.name}") as tick:
        for k in range(number):
            if tick is not None:
                tick(k, number)
            scene = drawn_on(road, partial(one, number=k))
            drawn.append(add_people(scene, people, seed=seed + k))
    warn(sorted({note for scene in drawn for note in scene.notes}))
    about: dict[str, Any] = {}
    if critical:
        with progress_bar(f"running {road.name}") as tick:
            drawn, about = _drawn(drawn, count, seed, tick)
    if copied:
        write_output(target, map_path.read_bytes())
    for file in origins:
        lat, lon = road.origin
        write_output(file, f"originLat,originLon\n{lat!r},{lon!r}\n".encode())
    weights.unlink(missing_ok=True)
    with output(cases) as temporary:
        write_tracks(temporary, *drawn)
    print(f"cases:  {cases} ({count} scenes)")
    if about:
        write_output(weights, (json.dumps(about, indent=1) + "\n").encode())
        means = (f"{value:.2f} {name}" for name, value in about["critical_encounters"].items())
        print(f"weight: {weights} (critical encounters of a future: {', '.join(means)})")
    print(f"run:    scex-sumo run {shlex.quote(str(target))} --tracks {shlex.quote(str(cases))} --case 1")


def _drawn(
    candidates: list[SeedScene], count: int, seed: int, tick: Progress | None
) -> tuple[list[SeedScene], dict[str, Any]]:
    """Return scenes drawn by their critical encounters, and the content of the file of weights."""
    from scex_sumo.generators.critical_scenes import FUTURES, MODELS, encounter_scores, sample_by_score

    scores = encounter_scores(candidates, seed=seed, progress=tick)
    if not scores.any():
        warn(["warning: no candidate has a critical encounter, so all weights are equal; raise --count"])
    drawn, weight = sample_by_score(scores, count, np.random.default_rng(seed))
    means = {"candidates": scores.mean(), "cases": scores[drawn].mean(), "weighted": weight @ scores[drawn]}
    return [candidates[k] for k in drawn], {
        "meaning": MEANING,
        "candidates": len(candidates),
        "models": MODELS,
        "futures": FUTURES,
        "critical_encounters": {name: round(float(value), 4) for name, value in means.items()},
        "cases": {
            f"{case}.0": {"weight": round(float(w), 6), "critical_encounters": float(scores[k])}
            for case, (k, w) in enumerate(zip(drawn, weight, strict=True), 1)
        },
    }
