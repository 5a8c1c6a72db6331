"""SUMO's car-following models and their parameters: which may be given, because results stay reproducible."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from xml.etree import ElementTree

from scex_sumo.base.errors import UsageError
from scex_sumo.base.sumo.programs import sumo_home

SUMO_MODELS = ("Krauss", "KraussPS", "IDM", "IDMM", "EIDM", "ACC", "CACC", "W99")
"""Models with reproducible results; those of W99 depend on the tile."""

RANDOM_MODELS = frozenset({"W99"})  # its randomness cannot be switched off

# SUMO draws random numbers per lane: a driver with these depends on its tile.
RANDOM_PARAMETERS = (
    *("sigma", "sigmaleader", "sigmagap", "sigmaerror", "speedDev", "lcSigma", "jmSigmaMinor"),
    *("jmIgnoreFoeProb", "jmIgnoreJunctionFoeProb"),
)
WORDS = {"latAlignment": ("left", "right", "center", "arbitrary", "nice", "compact")}
"""Parameters that need not be numbers."""
# A driver state adds random errors; a time between actions depends on the clock.
REFUSED = frozenset(
    {"hasDriverState", "applyDriverState", "actionStepLength", "id", "length", "width", "carFollowModel"}
)

OWN_MODEL = "own"
"""In the place of a model's name: each vehicle's own one, in scenes of a SUMO simulation."""


def check_driver(model: str, parameters: Mapping[str, str]) -> None:
    """Check a SUMO model's name and parameters."""
    if model not in (*SUMO_MODELS, OWN_MODEL):
        raise UsageError(f"unknown SUMO model {model!r}; known: {', '.join((*SUMO_MODELS, OWN_MODEL))}")
    for key, value in parameters.items():
        if key in RANDOM_PARAMETERS and value not in ("0", "0.0"):
            raise UsageError(
                f"sumo:{model}: {key}={value} makes the driver random, and SUMO's random numbers depend on "
                f"where a future is simulated; leave {key} at 0"
            )
        if key in REFUSED or key not in known_parameters():
            raise UsageError(f"sumo:{model}: unknown parameter {key!r}; SUMO's own names are meant, e.g. tau")
        try:
            if value not in WORDS.get(key, ()):
                float(value)
        except ValueError:
            raise UsageError(f"sumo:{model}: {key}={value} is not a number") from None


@cache
def known_parameters() -> frozenset[str]:
    """Return the names of the parameters of SUMO's drivers, from SUMO's own schema."""
    schema = ElementTree.parse(sumo_home() / "data" / "xsd" / "types" / "route.xsd")
    xsd = "{http://www.w3.org/2001/XMLSchema}"
    types = {kind.get("name", ""): kind for kind in schema.iter(f"{xsd}complexType")}
    of_vehicles = [t for name, t in types.items() if re.fullmatch("vTypeBaseType|cf.*Type", name)]
    return frozenset(a.get("name", "") for t in of_vehicles for a in t.iter(f"{xsd}attribute"))
