"""Case on disk: seed scene, map, who drives what, and files for simulators."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from scex_sumo.base.errors import ScexError, reason_of
from scex_sumo.base.files import TemporaryFolder, sha256_of, write_atomic
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.converters.datasets.writer import write_tracks
from scex_sumo.exporters.request import EXPORTERS, Request
from scex_sumo.extrapolation.engine import run_scene
from scex_sumo.extrapolation.options import RunOptions
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.info import describe
from scex_sumo.results.participants import everybody
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, States, VehicleIndex
from scex_sumo.studies.rank.stage import stage_of_motion
from scex_sumo.suites.drive import PEOPLE, REPLAN, STEPS, Driven
from scex_sumo.suites.suite import CASE, MAPS, lights_to_json, rules_to_json

FORMATS: Final = ("openscenario", "commonroad", "sumo")
SEED: Final = "seed.csv"
_TOLD: Final = ("what", "how", "future", "needed_braking", "time_margin", "gap_m", "conflict_s")
_ABOUT: Final = ("name", "kind", "site", "weight", "chance", "stratum")


def write_case(
    folder: Path,
    driven: Driven,
    candidate: Mapping[str, Any],
    *,
    maps: Path,
    formats: Sequence[str],
    seed: int,
) -> tuple[dict[str, Any], list[str]]:
    """Write the case of a candidate's row, driven by people; return its entry of ``suite.json``, and notes.

    Maps of the suite are shared in one folder; ``seed`` is of the draws.
    """
    folder.mkdir(parents=True, exist_ok=True)
    scene, pair = driven.scene, driven.row_of(candidate["other_id"])
    assert scene.road is not None and scene.road.file is not None
    file = Path(scene.road.file)
    shared = {"map": share(maps, file.name, file.read_bytes())}
    if scene.rules is not None:
        rules = json.dumps(rules_to_json(scene.rules), allow_nan=False).encode()
        shared["rules"] = share(maps, f"{file.stem}.rules.json", rules)
    write_tracks(folder / SEED, scene)
    content = case_content(driven, candidate, pair, seed=seed)
    content["seed_scene"] |= {what: f"../../{MAPS}/{copied.name}" for what, copied in shared.items()}
    write_atomic(folder / CASE, json.dumps(content, indent=1, allow_nan=False).encode())
    digests = {name: sha256_of(folder / name) for name in (CASE, SEED)}
    digests |= {f"../../{MAPS}/{copied.name}": sha256_of(copied) for copied in shared.values()}
    about = {name: content[name] for name in _ABOUT}
    about |= {"probability": candidate["probability"], "files": digests}
    return about, write_exports(folder, driven, pair, formats)


def share(folder: Path, name: str, content: bytes) -> Path:
    """Keep a file that cases share, once; another one of the same name gets a number."""
    folder.mkdir(parents=True, exist_ok=True)
    target, number = folder / name, 1
    while target.exists() and target.read_bytes() != content:
        number += 1
        target = folder / f"{number}-{name}"
    if not target.exists():
        write_atomic(target, content)
    return target


def case_content(
    driven: Driven, candidate: Mapping[str, Any], pair: Mapping[str, Any], *, seed: int
) -> dict[str, Any]:
    """Return the content of ``case.json``; the pair of `Driven.pairs` is what people come to."""
    scene = driven.scene
    described = describe(scene)
    return {
        **{name: candidate[name] for name in _ABOUT},
        "recording": candidate["recording"],
        "recording_case": candidate["case"],
        "seed_scene": described | {"source": _plain(described["source"])},
        "function": {"track_id": int(candidate["track_id"]), "role": "its place is taken by the function"},
        "other": {"track_id": int(candidate["other_id"]), "person": candidate["person"]},
        "drivers": {
            "of_the_others": PEOPLE,
            "replan_steps": REPLAN,
            "steps": STEPS,
            "seed": seed,
            "futures": driven.futures,
        },
        "people": {"probability": candidate["probability"]} | {name: pair[name] for name in _TOLD},
        "lights": [] if scene.rules is None else lights_to_json(scene.rules),
    }


def _plain(source: Mapping[str, Any]) -> dict[str, Any]:
    """Return the source without paths of this machine."""
    return {k: Path(v).name if isinstance(v, str) and "/" in v else v for k, v in source.items()}


def shown(driven: Driven, pair: Mapping[str, Any]) -> dict[str, Any]:
    """Return the playing picture of a future: the function's vehicle and the other one, up to a contact.

    Args:
        pair: a row of `Driven.pairs`.
    """
    whole = everybody(driven.scene)
    pair_indices = [driven.index_of(track) for track in (pair["track_id"], pair["other_id"])]
    other = pair_indices[0] if pair_indices[1] == driven.vehicle else pair_indices[1]
    states = driven.states[pair["future"]]
    stop = 1 + (round(pair["conflict_s"] / STEP_S) if pair["gap_m"] == 0 else STEPS)
    stage = stage_of_motion(whole, (other, driven.vehicle), states[[other, driven.vehicle], :stop])
    return {**vars(stage), "picture": str(stage.picture)}


class Script:
    """Driver that moves vehicles along given states (C, V, T); they stay where these end."""

    def __init__(self, states: States) -> None:
        self.states = states

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        """Return the states of the next steps."""
        steps = history.step + 1 + np.arange(PLAN_STEPS)
        own = self.states[vehicles.future, vehicles.vehicle]
        return Plan(**vars(own[:, np.minimum(steps, own.shape[1] - 1)]))


def write_exports(folder: Path, driven: Driven, pair: Mapping[str, Any], formats: Sequence[str]) -> list[str]:
    """Write files for simulators: futures 0, 1 with people's least and largest P; return notes."""
    if not formats:
        return []
    scene, notes = driven.scene, list[str]()
    shown = [int(np.argmin(driven.contacts.by_future)), int(pair["future"])]
    script = Script(driven.states[shown][:, : scene.vehicles])
    settings = RunSettings(
        models=[script], futures=2, steps=STEPS, replan=REPLAN, world="plain", metrics="gap"
    )
    with TemporaryFolder() as temporary, Workers(1) as workers:
        options = RunOptions(out=Path(temporary) / "run")
        run, _ = run_scene(scene, settings, workers=workers, options=options)
        for name in formats:
            ego = int(scene.track_ids[driven.vehicle])
            try:
                EXPORTERS.load(name)(Request(run=run, futures=(0, 1), out=folder / name, ego=ego))
            except ScexError as error:
                notes.append(f"{folder.name}: no {name}: {reason_of(error)}")
    return notes
