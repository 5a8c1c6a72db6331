"""Recognition of files by their names and first bytes."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from pathlib import Path

from scex_sumo.converters.naming import beginning, map_name, plain_or_packed, unpacked_name

XML = (".xml", ".xml.gz")
FCD_ENDINGS = (".fcd.xml", ".fcd.xml.gz", ".parquet")
LEVELX_TRACKS, LEVELX_META = "_tracks.csv", "_recordingMeta.csv"
AV2_MAP, AV2_BOXES = "log_map_archive_*.json", ("annotations_with_ego.feather", "annotations.feather")
AV2_POSES = "city_SE3_egovehicle.feather"
PY123D_LOG = "sync.arrow"
_CHUNK = re.compile(r"(?P<scene>.+)_(?P<first>\d+)_T-(?P<last>\d+)")  # of a CommonRoad recording
SIND_VEHICLES, SIND_WALKERS = "Veh_smoothed_tracks", "Ped_smoothed_tracks"


def ends_with(path: Path, *endings: str) -> bool:
    """Whether a name has one of some endings, in any case."""
    return str(path).lower().endswith(endings)


def _named(*patterns: str) -> Callable[[Path], bool]:
    """Return whether a name, with its folder, has one of some patterns."""
    return lambda path: any(map(path.match, patterns))


def _ending(*endings: str) -> Callable[[Path], bool]:
    return lambda path: ends_with(path, *endings)


is_sumo_net = _ending(".net.xml", ".net.xml.gz")
is_simulation = _ending(".sumocfg", ".sumocfg.xml", ".sumo.cfg")
is_opendrive = _ending(".xodr", ".xodr.gz")
is_osi = _named("*.mcap", "*.osi")
is_argoverse_map = _named(AV2_MAP)
is_argoverse = _named(*AV2_BOXES, AV2_POSES, "scenario_*.parquet")
is_highd_map = _named(f"*{LEVELX_META}", f"*{LEVELX_META}.gz")
is_opendd_map = _named("map_rdb*.sqlite")
is_opendd = _named("trajectories_rdb*.sqlite", "*.sqlite/rdb*", "rdb*.sqlite")
is_sind = _named(*(f"{name}.csv{packed}" for name in (SIND_VEHICLES, SIND_WALKERS) for packed in ("", ".gz")))


def is_fcd(path: Path) -> bool:
    """Whether a file is SUMO's floating car data, by its name, or that of XML by its beginning."""
    return ends_with(path, *FCD_ENDINGS) or (ends_with(path, *XML) and b"<fcd-export" in beginning(path))


def is_state(path: Path) -> bool:
    """Whether a file is a saved state of a SUMO simulation, by its beginning."""
    return ends_with(path, *XML) and not is_sumo_net(path) and b"<snapshot" in beginning(path)


def is_open_street_map(path: Path) -> bool:
    """Whether an ``.osm`` file holds streets and no lanelets."""
    if path.suffix != ".osm" or not path.is_file():
        return False
    content = path.read_bytes()
    return b"highway" in content and b"lanelet" not in content


def is_commonroad(path: Path) -> bool:
    """Whether a file is a CommonRoad scenario: XML that is not one of SUMO's files, by name or beginning."""
    if not ends_with(path, *XML) or ends_with(path, ".net.xml", ".net.xml.gz", ".fcd.xml", ".fcd.xml.gz"):
        return False
    start = beginning(path)
    return b"<fcd-export" not in start and b"<snapshot" not in start


def is_commonroad_recording(path: Path) -> bool:
    """Whether a path is a CommonRoad scenario, or a folder with the chunks of one recording."""
    if not path.is_dir():
        return is_commonroad(path)
    return len(commonroad_chains(filter(is_commonroad, path.iterdir()))) == 1


def commonroad_chains(paths: Iterable[Path]) -> list[tuple[Path, ...]]:
    """CommonRoad files by recording: single files, then consecutive chunks ``SCENE_FIRST_T-LAST``."""
    spans = {path: chunk_span(path) for path in sorted(paths)}
    joined: list[tuple[Path, ...]] = [(path,) for path, span in spans.items() if span is None]
    expected = None
    chunks = sorted((path.parent, span, path) for path, span in spans.items() if span is not None)
    for folder, (scene, first, last), path in chunks:
        before = joined.pop() if expected == (folder, scene, first) else ()
        joined.append((*before, path))
        expected = folder, scene, last + 1
    return joined


def chunk_span(path: Path) -> tuple[str, int, int] | None:
    """Scene, first and last step of a chunk of a CommonRoad recording, by its name; else None."""
    parts = _CHUNK.fullmatch(map_name(path))
    if parts is None or int(parts["last"]) <= int(parts["first"]):
        return None
    return parts["scene"], int(parts["first"]), int(parts["last"])


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


def is_spat(path: Path) -> bool:
    """Whether a file holds recorded signal phases, by its name, else by its header."""
    csv = path.suffix == ".csv"
    return csv and (path.name.startswith("signal_phases") or b"signal_group_id" in beginning(path))


def is_openscenario(path: Path) -> bool:
    """Whether a file is a scenario of OpenSCENARIO XML, and none of its catalogs."""
    return path.suffix.lower() == ".xosc" and not (path.is_file() and b"<Catalog " in beginning(path))


def is_esmini_log(path: Path) -> bool:
    """Whether a file is a CSV log of esmini, by its header."""
    return path.suffix == ".csv" and b"Entitity_Name [-]" in beginning(path)
