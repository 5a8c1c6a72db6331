"""Case on disk: seed scene, map, who drives how, criteria, tags, and files for simulators."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from scex_sumo.base.errors import ScexError, reason_of
from scex_sumo.base.files import TemporaryFolder, sha256_of, write_atomic
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.certainty.response.answer import too_late
from scex_sumo.certainty.response.motion.actions import ACTIONS
from scex_sumo.converters.datasets.writer import write_tracks
from scex_sumo.exporters.request import EXPORTERS, Request
from scex_sumo.extrapolation.engine import run_scene
from scex_sumo.extrapolation.options import RunOptions
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.info import describe
from scex_sumo.scene import SeedScene, States
from scex_sumo.studies.moments.pairs import PARAMETERS, recorded
from scex_sumo.studies.rank.stage import Stage, stage_of_motion
from scex_sumo.suites.openlabel import openlabel_tags
from scex_sumo.suites.population import RISK_WORDS
from scex_sumo.suites.rules_json import lights_to_json, rules_to_json
from scex_sumo.suites.simulate import EXPECTED, OTHERS, REPLAN, Script
from scex_sumo.suites.situation import STEPS, Situation
from scex_sumo.suites.suite import CASE, MAPS

FORMATS: Final = ("openscenario", "commonroad", "sumo")
SEED: Final = "seed.csv"
TAGS: Final = "openlabel.json"
PICTURE: Final = "picture.svg"
TYPICAL, CRITICAL = 0, 1
"""Futures of the files for simulators."""


def write_case(
    folder: Path,
    scene: SeedScene,
    situation: Situation,
    row: Mapping[str, Any],
    *,
    maps: Path,
    formats: Sequence[str],
    draws: Mapping[str, Any],
) -> tuple[dict[str, Any], Stage, list[str]]:
    """Write a case; return its entry of ``suite.json``, its picture, and notes on what could not be written.

    Args:
        scene: the seed scene, with its road and rules.
        row: the candidate.
        maps: folder of the maps of the suite.
        draws: seed and number of the futures.
    """
    folder.mkdir(parents=True, exist_ok=True)
    assert scene.road is not None and scene.road.file is not None
    file = Path(scene.road.file)
    shared = {"map": share(maps, file.name, file.read_bytes())}
    if scene.rules is not None:
        rules = json.dumps(rules_to_json(scene.rules), allow_nan=False).encode()
        shared["rules"] = share(maps, f"{file.stem}.rules.json", rules)
    write_tracks(folder / SEED, scene)
    content = case_content(scene, situation, row, draws)
    content["seed_scene"] |= {what: f"../../{MAPS}/{copied.name}" for what, copied in shared.items()}
    stage = stage_of_case(situation)
    write_atomic(folder / PICTURE, _standalone(stage).encode())
    notes = write_exports(folder, scene, situation, formats)
    tags = openlabel_tags(content)
    for name, value in ((CASE, content), (TAGS, tags)):
        write_atomic(folder / name, json.dumps(value, indent=1, allow_nan=False).encode())
    about = {name: content[name] for name in ("name", "kind", "risk", "site", "weight", "stratum")}
    digests = {name: sha256_of(folder / name) for name in (CASE, SEED)}
    people = content["people"]
    about |= {"probability": people["probability"], "severity": people["severity"]}
    digests |= {f"../../{MAPS}/{copied.name}": sha256_of(copied) for copied in shared.values()}
    about |= {"most": people["most"], "files": digests}
    return about, stage, notes


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
    scene: SeedScene, situation: Situation, row: Mapping[str, Any], draws: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the content of ``case.json``."""
    worst = situation.worst()
    action, cases = ACTIONS[int(situation.cases.action[worst])], situation.cases
    ids = situation.scene.track_ids
    described = describe(scene)
    return {
        **{name: row[name] for name in ("name", "kind", "weight", "stratum")},
        "risk": RISK_WORDS[row["risk"]],
        "site": row["location"],
        "recording": row["recording"],
        "recording_case": row["case"],
        "seed_scene": described | {"source": _plain(described["source"])},
        "function": {"track_id": int(row["other_id"]), "role": "its place is taken by the function"},
        "other": {"track_id": int(row["track_id"]), "person": row["person"]},
        "parameters": {name: _finite(row[name]) for name in PARAMETERS},
        "drivers": {
            "near": [int(ids[v]) for v in situation.near],
            "of_the_near": OTHERS,
            "of_the_other": EXPECTED,
            "of_the_rest": "moves as expected",
            "replan_steps": REPLAN,
            "steps": STEPS,
            **draws,
        },
        "action": {
            "name": action.name,
            "value": float(cases.value[worst]),
            "unit": action.unit,
            "words": f"{_name(row)} {situation.words(worst)}",
            "all": [ACTIONS[int(kind)].name for kind in situation.kinds],
        },
        "criteria": {
            "pass": "no collision of the two that people would avoid",
            "report": ["time to collision", "DRAC", "braking", "jerk", "least gap"],
        },
        "people": {
            "probability": situation.human_like,
            "severity": row["severity"],
            "most": situation.most,
            "needed_braking": _finite(row["needed_braking"]),
            "takes": row["takes"],
        },
        "lights": [] if scene.rules is None else lights_to_json(scene.rules),
    }


def _name(row: Mapping[str, Any]) -> str:
    return str(row["person"] or row["track_id"])


def _finite(value: Any) -> float | None:
    return None if value is None or not np.isfinite(value) else float(value)


def _plain(source: Mapping[str, Any]) -> dict[str, Any]:
    """Return the source without paths of this machine."""
    return {k: Path(v).name if isinstance(v, str) and "/" in v else v for k, v in source.items()}


def critical_motion(situation: Situation) -> States:
    """Return states (2, T) of the two: the most probable critical action, and people who respond too late."""
    case = situation.cases.take(np.array([situation.worst()]))
    motion = too_late(case, situation.critical[[situation.worst()]], situation.people)
    x, y, heading = situation.expected.lines.at(np.array([situation.responder]), motion.s)
    acts = case.outlines
    speed = np.stack([np.hypot(*case.velocity[0].T), motion.speed[0]])
    touches = case.blocked.touches(motion.s)[0]
    stop = 1 + int(np.argmax(touches)) if touches.any() else STEPS + 1
    return States(
        x=np.concatenate([acts.x, x])[:, :stop],
        y=np.concatenate([acts.y, y])[:, :stop],
        heading=np.concatenate([acts.heading, heading])[:, :stop],
        speed=speed[:, :stop],
    )


def stage_of_case(situation: Situation) -> Stage:
    """Return the playing picture of a case: what was recorded, and the most probable critical action."""
    whole = situation.expected.scene
    states, known = recorded(whole)
    both = situation.initiator, situation.responder
    return stage_of_motion(whole, both, critical_motion(situation), states[:, :41], known[:, :41])


def _standalone(stage: Stage) -> str:
    """Return the picture at the contact, with styles of its own."""
    svg, *outlines = str(stage.picture).split("<rect")
    for outline, track in zip(outlines, stage.outlines, strict=True):
        place = track[min(stage.contact, len(track) - 1)]
        at = f"translate({place[0]} {place[1]}) rotate({place[2]})" if place else "scale(0)"
        svg += f'<rect transform="{at}"{outline}'
    style = (
        "<style>.lane,path{fill:none;stroke:#999}rect{fill:#bbb}"
        ".acts{fill:#c33}.responds{fill:#36c}.ghost{fill:none;stroke:#666;stroke-width:.2}</style>"
    )
    head, tag, rest = svg.partition("<svg")
    body = rest if "xmlns=" in rest else f' xmlns="http://www.w3.org/2000/svg"{rest}'
    first, end, inner = body.partition(">")
    return f"{head}{tag}{first}{end}{style}{inner}"


def write_exports(folder: Path, scene: SeedScene, situation: Situation, formats: Sequence[str]) -> list[str]:
    """Write files for simulators: future 0 without the action, 1 with it; return notes on failures."""
    if not formats:
        return []
    rows = np.array([-1, situation.worst()])
    script = situation.scripted(rows, PLAN_STEPS + REPLAN)
    settings = RunSettings(models=[Script(script)], futures=2, steps=STEPS, replan=REPLAN, world="plain")
    options = RunOptions(compared=False)
    notes = []
    with TemporaryFolder() as temporary, Workers(1) as workers:
        options = replace(options, out=Path(temporary) / "run")
        run = run_scene(scene, settings, workers=workers, options=options)
        for name in formats:
            request = Request(
                run=run,
                futures=(TYPICAL, CRITICAL),
                out=folder / name,
                ego=int(situation.scene.track_ids[situation.responder]),
            )
            try:
                EXPORTERS.load(name)(request)
            except ScexError as error:
                notes.append(f"{folder.name}: no {name}: {reason_of(error)}")
    return notes
