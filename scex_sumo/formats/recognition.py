"""Recognition of files by their names and first bytes; a format's reader is imported when it reads a file."""

from __future__ import annotations

from pathlib import Path

from scex_sumo.converters.naming import beginning, plain_or_packed, unpacked_name
from scex_sumo.converters.registries import Declaration

XML = (".xml", ".xml.gz")
FCD_ENDINGS = (".fcd.xml", ".fcd.xml.gz", ".parquet")
LEVELX_TRACKS, LEVELX_META = "_tracks.csv", "_recordingMeta.csv"
AV2_MAP, AV2_BOXES = "log_map_archive_*.json", ("annotations_with_ego.feather", "annotations.feather")
AV2_POSES = "city_SE3_egovehicle.feather"
OPENDD_FILES = ("trajectories_rdb*.sqlite", "*.sqlite/rdb*", "rdb*.sqlite")
PY123D_LOG = "sync.arrow"
SIND_VEHICLES, SIND_WALKERS = "Veh_smoothed_tracks", "Ped_smoothed_tracks"


def _ends(path: Path, *endings: str) -> bool:
    return str(path).lower().endswith(endings)


def is_sumo_net(path: Path) -> bool:
    """Whether a file is a SUMO net."""
    return _ends(path, ".net.xml", ".net.xml.gz")


def is_simulation(path: Path) -> bool:
    """Whether a file is a configuration of SUMO."""
    return _ends(path, ".sumocfg", ".sumocfg.xml", ".sumo.cfg")


def is_fcd(path: Path) -> bool:
    """Whether a file is SUMO's floating car data, by its name, or that of XML by its beginning."""
    return _ends(path, *FCD_ENDINGS) or (_ends(path, *XML) and b"<fcd-export" in beginning(path))


def is_state(path: Path) -> bool:
    """Whether a file is a saved state of a SUMO simulation, by its beginning."""
    return _ends(path, *XML) and not is_sumo_net(path) and b"<snapshot" in beginning(path)


def is_open_street_map(path: Path) -> bool:
    """Whether an ``.osm`` file holds streets and no lanelets."""
    if path.suffix != ".osm" or not path.is_file():
        return False
    content = path.read_bytes()
    return b"highway" in content and b"lanelet" not in content


def is_commonroad(path: Path) -> bool:
    """Whether a file is a CommonRoad scenario: XML that is not one of SUMO's files, by name or beginning."""
    if not _ends(path, *XML) or _ends(path, ".net.xml", ".net.xml.gz", ".fcd.xml", ".fcd.xml.gz"):
        return False
    start = beginning(path)
    return b"<fcd-export" not in start and b"<snapshot" not in start


def is_commonroad_recording(path: Path) -> bool:
    """Whether a path is a CommonRoad scenario, or a folder with the chunks of one recording."""
    if not path.is_dir():
        return is_commonroad(path)
    from scex_sumo.formats.chunks import commonroad_chains

    return len(commonroad_chains(filter(is_commonroad, path.iterdir()))) == 1


def is_levelx(path: Path) -> bool:
    """Whether a file is the ``NN_tracks.csv`` of inD, rounD, exiD or highD."""
    return unpacked_name(path).endswith(LEVELX_TRACKS) and levelx_file(path, "recordingMeta").is_file()


def levelx_file(tracks_path: Path, kind: str) -> Path:
    """File beside ``NN_tracks.csv``, e.g. ``NN_recordingMeta.csv``; it need not exist."""
    beside = tracks_path.with_name(f"{unpacked_name(tracks_path).removesuffix(LEVELX_TRACKS)}_{kind}.csv")
    return plain_or_packed(beside) or beside


def is_scenarionet(path: Path) -> bool:
    """Whether a file is a scenario of ScenarioNet."""
    scenario = path.suffix == ".pkl" and not path.name.startswith("dataset_")
    return scenario and beginning(path)[:1] in (b"\x80", b"", b"\x1f")


def is_py123d_map(path: Path) -> bool:
    """Whether a file is a map or a log of 123D."""
    is_log = path.name == PY123D_LOG
    return path.suffix == ".arrow" and (is_log or not path.is_file() or beginning(path).startswith(b"ARROW1"))


def is_py123d(path: Path) -> bool:
    """Whether a path is a log of 123D: its ``sync.arrow`` or its folder."""
    return path.name == PY123D_LOG or (path.is_dir() and (path / PY123D_LOG).is_file())


def is_osi(path: Path) -> bool:
    """Whether a file is a trace of ASAM OSI: omega-prime or a bare one."""
    return path.suffix in (".mcap", ".osi")


ARGOVERSE_MAP = Declaration(lambda path: path.match(AV2_MAP), "scex_sumo.formats.argoverse:ARGOVERSE_MAP")
COMMONROAD_MAP = Declaration(is_commonroad, "scex_sumo.formats.commonroad.reader:COMMONROAD")
HIGHD_MAP = Declaration(
    lambda path: unpacked_name(path).endswith(LEVELX_META), "scex_sumo.formats.levelx:HIGHD"
)
OPENDD_MAP = Declaration(lambda path: path.match("map_rdb*.sqlite"), "scex_sumo.formats.opendd:OPENDD_MAP")
OPENDRIVE = Declaration(
    lambda path: _ends(path, ".xodr", ".xodr.gz"), "scex_sumo.formats.opendrive.reader:OPENDRIVE"
)
OPEN_STREET_MAP = Declaration(is_open_street_map, "scex_sumo.formats.sumo.imported:OPEN_STREET_MAP")
OSI_MAP = Declaration(is_osi, "scex_sumo.formats.osi:OSI_MAP")
PY123D_MAP = Declaration(is_py123d_map, "scex_sumo.formats.py123d:PY123D_MAP")
SCENARIONET_MAP = Declaration(is_scenarionet, "scex_sumo.formats.scenarionet:SCENARIONET_MAP")
SIMULATION_MAP = Declaration(is_simulation, "scex_sumo.formats.sumo.scenario:SCENARIO_MAP")
SUMO_NET = Declaration(is_sumo_net, "scex_sumo.formats.sumo.net:SUMO_NET")

ARGOVERSE = Declaration(
    lambda path: path.name in (*AV2_BOXES, AV2_POSES) or path.match("scenario_*.parquet"),
    "scex_sumo.formats.argoverse:ARGOVERSE",
)
COMMONROAD = Declaration(is_commonroad_recording, "scex_sumo.formats.commonroad.tracks:COMMONROAD")
FCD = Declaration(is_fcd, "scex_sumo.formats.sumo.fcd:FCD")
LEVELX = Declaration(is_levelx, "scex_sumo.formats.levelx:LEVELX")
OPENDD = Declaration(lambda path: any(map(path.match, OPENDD_FILES)), "scex_sumo.formats.opendd:OPENDD")
OSI = Declaration(is_osi, "scex_sumo.formats.osi:OSI")
PY123D = Declaration(is_py123d, "scex_sumo.formats.py123d:PY123D")
SCENARIONET = Declaration(is_scenarionet, "scex_sumo.formats.scenarionet:SCENARIONET")
SIMULATION = Declaration(is_simulation, "scex_sumo.formats.sumo.scenario:SCENARIO")
SIND = Declaration(
    lambda path: unpacked_name(path) in (f"{SIND_VEHICLES}.csv", f"{SIND_WALKERS}.csv"),
    "scex_sumo.formats.sind:SIND",
)
STATE = Declaration(is_state, "scex_sumo.formats.sumo.fcd:STATE")

OSI_LIGHTS = Declaration(is_osi, "scex_sumo.formats.osi:OSI_LIGHTS")
PY123D_LIGHTS = Declaration(lambda path: path.name == PY123D_LOG, "scex_sumo.formats.py123d:PY123D_LIGHTS")
SCENARIONET_LIGHTS = Declaration(is_scenarionet, "scex_sumo.formats.scenarionet:SCENARIONET_LIGHTS")
SPAT = Declaration(lambda path: path.suffix == ".csv", "scex_sumo.formats.spat:SPAT")
