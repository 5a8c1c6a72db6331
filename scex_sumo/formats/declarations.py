"""Maps and datasets of this package: how each is recognised; its reader is imported when it reads a file."""

from __future__ import annotations

from typing import Any

from scex_sumo.converters.registries import Declaration
from scex_sumo.formats import recognition as files


def _argoverse() -> Any:
    from scex_sumo.formats import argoverse

    return argoverse


def _commonroad_reader() -> Any:
    from scex_sumo.formats.commonroad import reader

    return reader


def _commonroad_tracks() -> Any:
    from scex_sumo.formats.commonroad import tracks

    return tracks


def _levelx() -> Any:
    from scex_sumo.formats import levelx

    return levelx


def _opendd() -> Any:
    from scex_sumo.formats import opendd

    return opendd


def _opendrive_reader() -> Any:
    from scex_sumo.formats.opendrive import reader

    return reader


def _openscenario() -> Any:
    from scex_sumo.formats.openscenario import reader

    return reader


def _osi() -> Any:
    from scex_sumo.formats import osi

    return osi


def _py123d() -> Any:
    from scex_sumo.formats import py123d

    return py123d


def _scenarionet() -> Any:
    from scex_sumo.formats import scenarionet

    return scenarionet


def _sind() -> Any:
    from scex_sumo.formats import sind

    return sind


def _spat() -> Any:
    from scex_sumo.formats import spat

    return spat


def _sumo_fcd() -> Any:
    from scex_sumo.formats.sumo import fcd

    return fcd


def _sumo_imported() -> Any:
    from scex_sumo.formats.sumo import imported

    return imported


def _sumo_net() -> Any:
    from scex_sumo.formats.sumo import net

    return net


def _sumo_scenario() -> Any:
    from scex_sumo.formats.sumo import scenario

    return scenario


ARGOVERSE_MAP = Declaration(files.is_argoverse_map, lambda: _argoverse().ARGOVERSE_MAP)
COMMONROAD_MAP = Declaration(files.is_commonroad, lambda: _commonroad_reader().COMMONROAD)
HIGHD_MAP = Declaration(files.is_highd_map, lambda: _levelx().HIGHD)
OPENDD_MAP = Declaration(files.is_opendd_map, lambda: _opendd().OPENDD_MAP)
OPENDRIVE = Declaration(files.is_opendrive, lambda: _opendrive_reader().OPENDRIVE)
OPENSCENARIO_MAP = Declaration(files.is_openscenario, lambda: _openscenario().OPENSCENARIO_MAP)
OPEN_STREET_MAP = Declaration(files.is_open_street_map, lambda: _sumo_imported().OPEN_STREET_MAP)
OSI_MAP = Declaration(files.is_osi, lambda: _osi().OSI_MAP)
PY123D_MAP = Declaration(files.is_py123d_map, lambda: _py123d().PY123D_MAP)
SCENARIONET_MAP = Declaration(files.is_scenarionet, lambda: _scenarionet().SCENARIONET_MAP)
SIMULATION_MAP = Declaration(files.is_simulation, lambda: _sumo_scenario().SCENARIO_MAP)
SUMO_NET = Declaration(files.is_sumo_net, lambda: _sumo_net().SUMO_NET)

ARGOVERSE = Declaration(files.is_argoverse, lambda: _argoverse().ARGOVERSE)
COMMONROAD = Declaration(files.is_commonroad_recording, lambda: _commonroad_tracks().COMMONROAD)
ESMINI = Declaration(files.is_esmini_log, lambda: _openscenario().ESMINI)
FCD = Declaration(files.is_fcd, lambda: _sumo_fcd().FCD)
LEVELX = Declaration(files.is_levelx, lambda: _levelx().LEVELX)
OPENDD = Declaration(files.is_opendd, lambda: _opendd().OPENDD)
OPENSCENARIO = Declaration(files.is_openscenario, lambda: _openscenario().OPENSCENARIO)
OSI = Declaration(files.is_osi, lambda: _osi().OSI)
PY123D = Declaration(files.is_py123d, lambda: _py123d().PY123D)
SCENARIONET = Declaration(files.is_scenarionet, lambda: _scenarionet().SCENARIONET)
SIMULATION = Declaration(files.is_simulation, lambda: _sumo_scenario().SCENARIO)
SIND = Declaration(files.is_sind, lambda: _sind().SIND)
SPAT = Declaration(files.is_spat, lambda: _spat().SPAT)
STATE = Declaration(files.is_state, lambda: _sumo_scenario().SAVED)
