"""Allow-list of SUMO nets: roads and lights only.

SUMO reads a net like an additional file: detectors, outputs and ``include`` in it take effect and write
files.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from scex_sumo.base.errors import MapError, ScexError, listed
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.converters.net.files import unpacked, xml_root

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
)

_MARKUP = re.compile(rb"<!(DOCTYPE|ENTITY)|<\?xml-", re.IGNORECASE)
_ENCODING = re.compile(rb"""<\?xml[^>]*encoding\s*=\s*["']([^"']*)""")
_SCHEMA = re.compile(rb"""schemaLocation\s*=\s*["'](?!https?://sumo[./-])""", re.IGNORECASE)


def allowed_content(path: Path) -> tuple[bytes, tuple[str, ...]]:
    """Return a net or drawing reduced to what is allowed, and what was left out, e.g. ``2 <inductionLoop>``.

    A file that is allowed as a whole keeps its bytes.
    """
    content = unpacked(path)
    root = xml_root(path, content)
    left_out = prune(root)
    if left_out or not _plain(content):
        content = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return content, left_out


def prune(root: Element) -> tuple[str, ...]:
    """Remove everything that is not allowed from a net, in place; returns what it was, with numbers."""
    left_out: Counter[str] = Counter()
    if root.tag not in ("net", "additional"):
        left_out[f"<{root.tag}>"] += 1
        root.clear()
    else:
        _prune(root, left_out)
    return tuple(f"{count} {what}" for what, count in left_out.items())


def _prune(element: Element, left_out: Counter[str]) -> None:
    attributes, children = _ATTRIBUTES[element.tag].split(), _CHILDREN.get(element.tag, "").split()
    for name in [name for name in element.attrib if name not in attributes]:
        if not name.startswith("{"):  # the place of a schema
            left_out[f"{name} of <{element.tag}>"] += 1
        del element.attrib[name]
    for child in list(element):
        if child.tag not in children:
            left_out[f"<{child.tag}>" if isinstance(child.tag, str) else "processing instructions"] += 1
        elif child.tag == "param" and element.tag in ("tlLogic", "junction") and not _light_parameter(child):
            left_out[f"parameters {child.get('key', '')[:24]!r} of <{element.tag}>"] += 1
        else:
            _prune(child, left_out)
            continue
        element.remove(child)


def _light_parameter(param: Element) -> bool:
    return param.get("key", "").partition(":")[0] in _LIGHT_PARAMETERS.split()


def _plain(content: bytes) -> bool:
    encoding = _ENCODING.search(content[:1000])
    if b"\0" in content or (encoding is not None and encoding[1].lower() not in (b"utf-8", b"us-ascii")):
        return False
    return not _MARKUP.search(content) and not _SCHEMA.search(content)


@contextmanager
def allowed_copy(path: Path) -> Iterator[Path]:
    """Give SUMO a temporary copy of what is allowed in a net; errors name the net itself."""
    content, _ = allowed_content(path)
    with TemporaryFolder() as folder:
        copy = Path(folder) / "allowed.net.xml"
        copy.write_bytes(content)
        try:
            yield copy
        except ScexError as error:
            raise type(error)(str(error).replace(str(copy), str(path))) from None


def refuse_outputs(path: Path) -> None:
    """Refuse a file that this project once wrote and that now holds more than roads."""
    if left_out := allowed_content(path)[1]:
        raise MapError(f"{path}: changed since it was written: {listed(left_out)} in it; run again elsewhere")
