"""SUMO's car-following models: their names and parameters."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

from scex_sumo.base.errors import UsageError

SUMO_MODELS = ("Krauss", "KraussPS", "IDM", "IDMM", "EIDM", "ACC", "CACC", "W99")
"""Models with reproducible results; those of W99 depend on the tile."""

RANDOM_MODELS = frozenset({"W99"})  # its randomness cannot be switched off

# SUMO draws random numbers per lane: a driver with these depends on its tile.
RANDOM_PARAMETERS = (
    "sigma",
    "sigmaleader",
    "sigmagap",
    "sigmaerror",
    "speedDev",
    "lcSigma",
    "jmSigmaMinor",
    "jmIgnoreFoeProb",
    "jmIgnoreJunctionFoeProb",
)
# A driver state adds random errors; a time between actions depends on the clock.
_REFUSED = frozenset(
    {"hasDriverState", "applyDriverState", "actionStepLength", "id", "length", "width", "carFollowModel"}
)


def check_driver(model: str, parameters: Mapping[str, str]) -> None:
    """Check a SUMO model's name and parameters."""
    if model not in SUMO_MODELS:
        raise UsageError(f"unknown SUMO model {model!r}; known: {', '.join(SUMO_MODELS)}")
    for key, value in parameters.items():
        if key in RANDOM_PARAMETERS and value not in ("0", "0.0"):
            raise UsageError(
                f"sumo:{model}: {key}={value} makes the driver random, and SUMO's random numbers depend on "
                f"where a child is simulated; leave {key} at 0"
            )
        if key in _REFUSED or key not in _known_parameters():
            raise UsageError(f"sumo:{model}: unknown parameter {key!r}; SUMO's own names are meant, e.g. tau")
        try:
            float(value)
        except ValueError:
            raise UsageError(f"sumo:{model}: {key}={value} is not a number") from None


@cache
def _known_parameters() -> frozenset[str]:
    import sumo

    schema = ElementTree.parse(Path(sumo.SUMO_HOME) / "data" / "xsd" / "types" / "route.xsd")
    xsd = "{http://www.w3.org/2001/XMLSchema}"
    types = [t for t in schema.iter(f"{xsd}complexType") if _is_vehicle_type(t.get("name", ""))]
    return frozenset(a.get("name", "") for t in types for a in t.iter(f"{xsd}attribute"))


def _is_vehicle_type(name: str) -> bool:
    return name == "vTypeBaseType" or (name.startswith("cf") and name.endswith("Type"))
