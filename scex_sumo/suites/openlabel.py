"""Tags of a case as ASAM OpenLABEL 1.0, in the words of its ontology, which are those of BSI PAS 1883.

ISO 34503 has the same attributes. What a recording does not tell, such as weather and light, has no tag.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from scex_sumo.base.version import __version__
from scex_sumo.decision import typology

ONTOLOGY: Final = "https://openlabel.asam.net/V1-0-0/ontologies/"
OWN: Final = "scex-sumo:pre-crash-kinds"
_CROSSES: Final = ("JunctionIntersection", "MotionCross")
_KINDS: Final[Mapping[str, tuple[str, ...]]] = {
    typology.LEAD_STOPPED: ("MotionStop",),
    typology.LEAD_DECELERATING: ("MotionDecelerate",),
    typology.LEAD_SLOWER: ("MotionDrive",),
    typology.LEAD_MOVING: ("MotionDrive",),
    typology.LANE_CHANGE: ("MotionCutIn",),
    typology.MERGE: ("MotionTowards",),
    typology.ENTRY: ("JunctionRoundabout", "MotionTowards"),
    typology.CROSSING: _CROSSES,
    typology.ACROSS_OPPOSITE: (*_CROSSES, "MotionTurnLeft"),
    typology.ACROSS_LATERAL: (*_CROSSES, "MotionTurnLeft"),
    typology.INTO_PATH: ("JunctionIntersection", "MotionTurn"),
    typology.HEAD_ON: ("MotionTowards",),
}
_PEOPLE: Final = {"pedestrian": "HumanPedestrian", "cyclist": "HumanCyclist"}


def openlabel_tags(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the OpenLABEL document of a case by the content of ``case.json``."""
    kind = content["kind"]
    words = ["RoadUserVehicle", "OddDynamicElements", "SceneryDrivableArea", *_KINDS.get(kind, ())]
    if kind in typology.WALKING:
        person, moves = kind.split()
        words += [_PEOPLE[person], "MotionCross" if moves == "crossing" else "MotionDrive"]
    tags: list[dict[str, Any]] = [{"ontology_uid": "0", "type": word} for word in words]
    speed, weight = content["speeds_mps"][0], content["weight"]
    tags += [
        {"ontology_uid": "0", "type": "SubjectVehicleSpeed", "tag_data": _number("speed_mps", speed)},
        {"ontology_uid": "1", "type": kind.replace(" ", "_").replace(",", "")},
        {"ontology_uid": "1", "type": "weight", "tag_data": _number("encounters", weight)},
    ]
    return {
        "openlabel": {
            "metadata": {
                "schema_version": "1.0.0",
                "tagged_file": "case.json",
                "annotator": f"scex-sumo {__version__}",
                "name": content["name"],
            },
            "ontologies": {"0": ONTOLOGY, "1": OWN},
            "tags": {str(k): tag for k, tag in enumerate(tags)},
        }
    }


def _number(name: str, value: float) -> dict[str, Any]:
    return {"num": [{"name": name, "type": "value", "val": round(float(value), 4)}]}
