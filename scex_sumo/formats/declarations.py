"""Maps and datasets of this package: how each is recognised; its reader is imported when it reads a file."""

from __future__ import annotations

from typing import Any

from scex_sumo.converters.registries import Declaration
from scex_sumo.formats import recognition as files


def _module(name: str) -> Any:
    """Import and return the module that reads a format."""
    match name:
        case "argoverse":
            from scex_sumo.formats import argoverse

            return argoverse
        case "commonroad_reader":
            from scex_sumo.formats.commonroad import reader

            return reader
        case "commonroad_tracks":
            from scex_sumo.formats.commonroad import tracks

            return tracks
        case "esmini":
            from scex_sumo.formats import esmini

            return esmini
        case "levelx":
            from scex_sumo.formats import levelx

            return levelx
        case "opendd":
            from scex_sumo.formats import opendd

            return opendd
        case "opendrive_reader":
            from scex_sumo.formats.opendrive import reader as opendrive

            return opendrive
        case "openscenario":
            from scex_sumo.formats.openscenario import reader as openscenario

            return openscenario
        case "osi":
            from scex_sumo.formats import osi

            return osi
        case "py123d":
            from scex_sumo.formats import py123d

            return py123d
        case "scenarionet":
            from scex_sumo.formats import scenarionet

            return scenarionet
        case "sind":
            from scex_sumo.formats import sind

            return sind
        case "spat":
            from scex_sumo.formats import spat

            return spat
        case "sumo_fcd":
            from scex_sumo.formats.sumo import fcd

            return fcd
        case "sumo_imported":
            from scex_sumo.formats.sumo import imported

            return imported
        case "sumo_net":
            from scex_sumo.formats.sumo import net

            return net
        case "sumo_scenario":
            from scex_sumo.formats.sumo import scenario

            return scenario
    raise KeyError(name)


ARGOVERSE_MAP = Declaration(files.is_argoverse_map, lambda: _module("argoverse").ARGOVERSE_MAP)
COMMONROAD_MAP = Declaration(files.is_commonroad, lambda: _module("commonroad_reader").COMMONROAD)
HIGHD_MAP = Declaration(files.is_highd_map, lambda: _module("levelx").HIGHD)
OPENDD_MAP = Declaration(files.is_opendd_map, lambda: _module("opendd").OPENDD_MAP)
OPENDRIVE = Declaration(files.is_opendrive, lambda: _module("opendrive_reader").OPENDRIVE)
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
