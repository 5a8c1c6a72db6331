"""Tags of a case as ASAM OpenLABEL 1.0, in the words of its ontology, which are those of BSI PAS 1883.

ISO 34503 has the same attributes. What a recording does not tell, such as weather and light, has no tag.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from scex_sumo.base.version import __version__
from scex_sumo.certainty.response.typology import (
    ACROSS_LATERAL,
    ACROSS_OPPOSITE,
    CROSSING,
    ENTRY,
    INTO_PATH,
    LANE_CHANGE,
    MERGE,
)

ONTOLOGY: Final = "https://openlabel.asam.net/V1-0-0/ontologies/"
OWN: Final = "scex-sumo:pre-crash-kinds"
_JUNCTIONS: Final = {
    ENTRY: "JunctionRoundabout",
    **dict.fromkeys((CROSSING, ACROSS_OPPOSITE, ACROSS_LATERAL, INTO_PATH), "JunctionIntersection"),
}
_KINDS: Final = {LANE_CHANGE: ["MotionCutIn"], MERGE: ["MotionTowards"], CROSSING: ["MotionCross"]}
_TURNS: Final = {kind: ["MotionTurnLeft", "MotionCross"] for kind in (ACROSS_OPPOSITE, ACROSS_LATERAL)}
_ACTIONS: Final = {
    "brakes": "MotionDecelerate",
    "goes on": "MotionDrive",
    "cuts in": "MotionCutIn",
    "drifts": "MotionTowards",
    "steps out": "MotionCross",
}
_WHO: Final = {"pedestrian": "HumanPedestrian", "bicycle": "HumanCyclist", "cyclist": "HumanCyclist"}


def openlabel_tags(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the OpenLABEL document of a case by the content of ``case.json``."""
    kind, person = content["kind"], content["other"]["person"]
    words = [
        "RoadUserVehicle",
        "OddDynamicElements",
        "SceneryDrivableArea",
        _ACTIONS[content["action"]["name"]],
    ]
    words += [_JUNCTIONS[kind]] if kind in _JUNCTIONS else []
    words += _KINDS.get(kind, []) + _TURNS.get(kind, [])
    words += [_WHO.get(person.split()[0], "RoadUserHuman")] if person else []
    tags: dict[str, Any] = {
        str(k): {"ontology_uid": "0", "type": word} for k, word in enumerate(dict.fromkeys(words))
    }
    speed = content["parameters"]["other_speed_mps"]
    valued = {"ontology_uid": "0", "type": "SubjectVehicleSpeed", "tag_data": _numbers("speed_mps", speed)}
    own = {"ontology_uid": "1", "type": kind.replace(" ", "_").replace(",", "")}
    risk = {"ontology_uid": "1", "type": "weight", "tag_data": _numbers("candidates", content["weight"])}
    for one in (valued, own, risk):
        tags[str(len(tags))] = one
    return {
        "openlabel": {
            "metadata": {
                "schema_version": "1.0.0",
                "tagged_file": "case.json",
                "annotator": f"scex-sumo {__version__}",
                "name": content["name"],
            },
            "ontologies": {
                "0": ONTOLOGY,
                "1": OWN,
            },
            "tags": tags,
        }
    }


def _numbers(name: str, value: float) -> dict[str, Any]:
    return {"num": [{"name": name, "type": "value", "val": round(float(value), 4)}]}
