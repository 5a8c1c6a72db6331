"""Maps and datasets of this package: how each is recognised; its reader is imported when it reads a file."""

from __future__ import annotations

from typing import Any

from scex_sumo.converters.registries import Declaration
from scex_sumo.formats.recognition import (
    is_argoverse,
    is_argoverse_map,
    is_commonroad,
    is_commonroad_recording,
    is_esmini_log,
    is_fcd,
    is_highd_map,
    is_levelx,
    is_open_street_map,
    is_opendd,
    is_opendd_map,
    is_opendrive,
    is_openscenario,
    is_osi,
    is_py123d,
    is_py123d_map,
    is_scenarionet,
    is_simulation,
    is_sind,
    is_spat,
    is_state,
    is_sumo_net,
)


def _argoverse_map() -> Any:
    from scex_sumo.formats.argoverse import ARGOVERSE_MAP

    return ARGOVERSE_MAP


def _argoverse() -> Any:
    from scex_sumo.formats.argoverse import ARGOVERSE

    return ARGOVERSE


def _commonroad_map() -> Any:
    from scex_sumo.formats.commonroad.reader import COMMONROAD

    return COMMONROAD


def _commonroad() -> Any:
    from scex_sumo.formats.commonroad.tracks import COMMONROAD

    return COMMONROAD


def _fcd() -> Any:
    from scex_sumo.formats.sumo.fcd import FCD

    return FCD


def _highd() -> Any:
    from scex_sumo.formats.levelx import HIGHD

    return HIGHD


def _levelx() -> Any:
    from scex_sumo.formats.levelx import LEVELX

    return LEVELX


def _opendd_map() -> Any:
    from scex_sumo.formats.opendd import OPENDD_MAP

    return OPENDD_MAP


def _opendd() -> Any:
    from scex_sumo.formats.opendd import OPENDD

    return OPENDD


def _opendrive() -> Any:
    from scex_sumo.formats.opendrive.reader import OPENDRIVE

    return OPENDRIVE


def _openscenario_map() -> Any:
    from scex_sumo.formats.openscenario.reader import OPENSCENARIO_MAP

    return OPENSCENARIO_MAP


def _openscenario() -> Any:
    from scex_sumo.formats.openscenario.reader import OPENSCENARIO

    return OPENSCENARIO


def _esmini() -> Any:
    from scex_sumo.formats.openscenario.reader import ESMINI

    return ESMINI


def _open_street_map() -> Any:
    from scex_sumo.formats.sumo.imported import OPEN_STREET_MAP

    return OPEN_STREET_MAP


def _osi_map() -> Any:
    from scex_sumo.formats.osi import OSI_MAP

    return OSI_MAP


def _osi() -> Any:
    from scex_sumo.formats.osi import OSI

    return OSI


def _py123d_map() -> Any:
    from scex_sumo.formats.py123d import PY123D_MAP

    return PY123D_MAP


def _py123d() -> Any:
    from scex_sumo.formats.py123d import PY123D

    return PY123D


def _scenarionet_map() -> Any:
    from scex_sumo.formats.scenarionet import SCENARIONET_MAP

    return SCENARIONET_MAP


def _scenarionet() -> Any:
    from scex_sumo.formats.scenarionet import SCENARIONET

    return SCENARIONET


def _simulation_map() -> Any:
    from scex_sumo.formats.sumo.scenario import SCENARIO_MAP

    return SCENARIO_MAP


def _simulation() -> Any:
    from scex_sumo.formats.sumo.scenario import SCENARIO

    return SCENARIO


def _sind() -> Any:
    from scex_sumo.formats.sind import SIND

    return SIND


def _spat() -> Any:
    from scex_sumo.formats.spat import SPAT

    return SPAT


def _state() -> Any:
    from scex_sumo.formats.sumo.scenario import SAVED

    return SAVED


def _sumo_net() -> Any:
    from scex_sumo.formats.sumo.net import SUMO_NET

    return SUMO_NET


ARGOVERSE_MAP = Declaration(is_argoverse_map, _argoverse_map)
COMMONROAD_MAP = Declaration(is_commonroad, _commonroad_map)
HIGHD_MAP = Declaration(is_highd_map, _highd)
OPENDD_MAP = Declaration(is_opendd_map, _opendd_map)
OPENDRIVE = Declaration(is_opendrive, _opendrive)
OPENSCENARIO_MAP = Declaration(is_openscenario, _openscenario_map)
OPEN_STREET_MAP = Declaration(is_open_street_map, _open_street_map)
OSI_MAP = Declaration(is_osi, _osi_map)
PY123D_MAP = Declaration(is_py123d_map, _py123d_map)
SCENARIONET_MAP = Declaration(is_scenarionet, _scenarionet_map)
SIMULATION_MAP = Declaration(is_simulation, _simulation_map)
SUMO_NET = Declaration(is_sumo_net, _sumo_net)

ARGOVERSE = Declaration(is_argoverse, _argoverse)
COMMONROAD = Declaration(is_commonroad_recording, _commonroad)
ESMINI = Declaration(is_esmini_log, _esmini)
FCD = Declaration(is_fcd, _fcd)
LEVELX = Declaration(is_levelx, _levelx)
OPENDD = Declaration(is_opendd, _opendd)
OPENSCENARIO = Declaration(is_openscenario, _openscenario)
OSI = Declaration(is_osi, _osi)
PY123D = Declaration(is_py123d, _py123d)
SCENARIONET = Declaration(is_scenarionet, _scenarionet)
SIMULATION = Declaration(is_simulation, _simulation)
SIND = Declaration(is_sind, _sind)
SPAT = Declaration(is_spat, _spat)
STATE = Declaration(is_state, _state)
