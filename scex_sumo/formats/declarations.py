"""Maps and datasets of this package: how each is recognised; its reader is imported when it reads a file."""

from __future__ import annotations

from typing import Any

from scex_sumo.converters.registries import Declaration
from scex_sumo.formats import recognition as files


def _module(name: str) -> Any:
    """Import and return the module that reads a format."""
    module: Any
    match name:
        case "argoverse":
            from scex_sumo.formats import argoverse as module
        case "commonroad_reader":
            from scex_sumo.formats.commonroad import reader as module
        case "commonroad_tracks":
            from scex_sumo.formats.commonroad import tracks as module
        case "esmini":
            from scex_sumo.formats import esmini as module
        case "levelx":
            from scex_sumo.formats import levelx as module
        case "opendd":
            from scex_sumo.formats import opendd as module
        case "opendrive":
            from scex_sumo.formats.opendrive import lanes as module
        case "openscenario":
            from scex_sumo.formats.openscenario import reader as module
        case "osi":
            from scex_sumo.formats import osi as module
        case "py123d":
            from scex_sumo.formats import py123d as module
        case "scenarionet":
            from scex_sumo.formats import scenarionet as module
        case "sind":
            from scex_sumo.formats import sind as module
        case "spat":
            from scex_sumo.formats import spat as module
        case "sumo_fcd":
            from scex_sumo.formats.sumo import fcd as module
        case "sumo_imported":
            from scex_sumo.formats.sumo import imported as module
        case "sumo_net":
            from scex_sumo.formats.sumo import net as module
        case "sumo_scenario":
            from scex_sumo.formats.sumo import scenario as module
    return module


ARGOVERSE_MAP = Declaration(files.is_argoverse_map, lambda: _module("argoverse").ARGOVERSE_MAP)
COMMONROAD_MAP = Declaration(files.is_commonroad, lambda: _module("commonroad_reader").COMMONROAD)
HIGHD_MAP = Declaration(files.is_highd_map, lambda: _module("levelx").HIGHD)
OPENDD_MAP = Declaration(files.is_opendd_map, lambda: _module("opendd").OPENDD_MAP)
OPENDRIVE = Declaration(files.is_opendrive, lambda: _module("opendrive").OPENDRIVE)
OPENSCENARIO_MAP = Declaration(files.is_openscenario, lambda: _module("openscenario").OPENSCENARIO_MAP)
OPEN_STREET_MAP = Declaration(files.is_open_street_map, lambda: _module("sumo_imported").OPEN_STREET_MAP)
OSI_MAP = Declaration(files.is_osi, lambda: _module("osi").OSI_MAP)
PY123D_MAP = Declaration(files.is_py123d_map, lambda: _module("py123d").PY123D_MAP)
SCENARIONET_MAP = Declaration(files.is_scenarionet, lambda: _module("scenarionet").SCENARIONET_MAP)
SIMULATION_MAP = Declaration(files.is_simulation, lambda: _module("sumo_scenario").SCENARIO_MAP)
SUMO_NET = Declaration(files.is_sumo_net, lambda: _module("sumo_net").SUMO_NET)

ARGOVERSE = Declaration(files.is_argoverse, lambda: _module("argoverse").ARGOVERSE)
COMMONROAD = Declaration(files.is_commonroad_recording, lambda: _module("commonroad_tracks").COMMONROAD)
ESMINI = Declaration(files.is_esmini_log, lambda: _module("esmini").ESMINI)
FCD = Declaration(files.is_fcd, lambda: _module("sumo_fcd").FCD)
LEVELX = Declaration(files.is_levelx, lambda: _module("levelx").LEVELX)
OPENDD = Declaration(files.is_opendd, lambda: _module("opendd").OPENDD)
OPENSCENARIO = Declaration(files.is_openscenario, lambda: _module("openscenario").OPENSCENARIO)
OSI = Declaration(files.is_osi, lambda: _module("osi").OSI)
PY123D = Declaration(files.is_py123d, lambda: _module("py123d").PY123D)
SCENARIONET = Declaration(files.is_scenarionet, lambda: _module("scenarionet").SCENARIONET)
SIMULATION = Declaration(files.is_simulation, lambda: _module("sumo_scenario").SCENARIO)
SIND = Declaration(files.is_sind, lambda: _module("sind").SIND)
SPAT = Declaration(files.is_spat, lambda: _module("spat").SPAT)
STATE = Declaration(files.is_state, lambda: _module("sumo_scenario").SAVED)
