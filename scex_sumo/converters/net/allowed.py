"""Allow-list of SUMO nets: roads and lights only.

SUMO reads a net like an additional file: detectors, outputs and ``include`` in it take effect and write
files.
"""

from __future__ import annotations

from collections import Counter
from typing import Final
from xml.etree.ElementTree import Element

SIMULATED: Final = "simulation"
"""Parameter of a traffic light in a run's net: its programmes and saved states in the simulation, XML."""
_ATTRIBUTES = {
    "net": "version junctionCornerDetail junctionLinkDetail lefthand rectangularLaneCut walkingareas"
    " limitTurnSpeed checkLaneFoesAll checkLaneFoesRoundabout tlsIgnoreInternalJunctionJam spreadType"
    " avoidOverlap junctionHigherSpeed internalJunctionsVehicleWidth junctionsMinimalShape"
    " junctionsEndpointShape",
    "location": "netOffset convBoundary origBoundary projParameter",
    "type": "id priority numLanes speed allow disallow prefer oneway width sidewalkWidth bikeLaneWidth "
    "discard spreadType widthResolution maxWidth minWidth",
    "restriction": "vClass speed",
    "edge": "id function from to name priority length bidi type routingType shape distance spreadType"
    " crossingEdges",
    "lane": "id index allow disallow prefer speed friction length endOffset width acceleration shape "
    "customShape type changeRight changeLeft outlineShape",
    "neigh": "lane",
    "stopOffset": "value vClasses exceptions",
    "tlLogic": "id type programID offset",
    "phase": "duration state minDur maxDur name next earliestEnd latestEnd earlyTarget finalTarget yellow red"
    " vehext targetLanes greenMin greenMax",
    "condition": "id value",
    "assignment": "id check value",
    "function": "id nArgs",
    "junction": "id x y z type incLanes intLanes shape name radius customShape rightOfWay fringe roundabout"
    " keepClear",
    "request": "index response foes cont",
    "connection": "from to fromLane toLane pass keepClear contPos visibility allow disallow speed length"
    " shape uncontrolled via tl linkIndex linkIndex2 changeRight changeLeft indirect type dir state",
    "conflict": "from to fromLane toLane startPos endPos",
    "prohibition": "prohibitor prohibited",
    "roundabout": "nodes edges",
    "param": "key value",
    "additional": "",
    "poly": "id type color fill lineWidth layer shape geo name",
    "poi": "id type color layer x y width height name",
}
_CHILDREN = {
    "net": "location type edge tlLogic junction connection prohibition roundabout param",
    "type": "restriction param",
    "edge": "lane param stopOffset",
    "lane": "neigh param stopOffset",
    "tlLogic": "phase condition assignment function param",
    "function": "assignment",
    "junction": "request param",
    "connection": "param conflict",
    "additional": "poly poi",
    "poly": "param",
    "poi": "param",
}
# SUMO keeps other elements' parameters as text; those of lights also name files that it writes.
_LIGHT_PARAMETERS = (
    "min-gap max-gap detector-gap passing-time inactive-threshold jam-threshold vTypes detector-length"
    " detector-length-left-turn-lane linkMaxDur linkMinDur cycleTime coordinated green-time max-green"
    " show-detectors build-all-detectors hide-conflicts minTimeLoss detectorRange extendMaxDur ignore-errors"
    " total-cycle-length ring1 ring2 barrierPhases barrier2Phases coordinatePhases offset cabinetType"
    f" linkSignalID {SIMULATED}"
).split()


def prune(root: Element) -> tuple[str, ...]:
    """Remove everything that is not allowed from a net, in place; returns what it was, with numbers."""
    left_out: Counter[str] = Counter()
    if root.tag not in ("net", "additional"):
        left_out[f"<{root.tag}>"] += 1
        root.clear()
    else:
        _prune(root, left_out)
    return tuple(f"{count} {kind}" for kind, count in left_out.items())


def _prune(element: Element, left_out: Counter[str]) -> None:
    attributes, children = _ATTRIBUTES[element.tag].split(), _CHILDREN.get(element.tag, "").split()
    for name in [name for name in element.attrib if name not in attributes]:
        if not name.startswith("{"):  # the place of a schema
            left_out[f"{name} of <{element.tag}>"] += 1
        del element.attrib[name]
    for child in list(element):
        if child.tag not in children:
            left_out[f"<{child.tag}>" if isinstance(child.tag, str) else "processing instructions"] += 1
        elif (
            child.tag == "param"
            and element.tag in ("tlLogic", "junction")
            and child.get("key", "").partition(":")[0] not in _LIGHT_PARAMETERS
        ):
            left_out[f"parameters {child.get('key', '')[:24]!r} of <{element.tag}>"] += 1
        else:
            _prune(child, left_out)
            continue
        element.remove(child)
