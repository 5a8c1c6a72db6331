"""Maps that SUMO's netconvert reads: OpenDRIVE and OpenStreetMap become nets first."""

from __future__ import annotations

import hashlib
import os
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

from scex_sumo.converters.formats import OPENDRIVE, map_name
from scex_sumo.converters.sumo.net import read_sumo_road, unpacked
from scex_sumo.errors import MapError
from scex_sumo.programs import environment, program
from scex_sumo.road import Road
from scex_sumo.version import __version__

# OpenDRIVE: coordinates stay the file's; curves are followed closely; the file's own junction lanes are kept.
_OPENDRIVE = {
    "opendrive.curve-resolution": "0.5",
    "opendrive.internal-shapes": "true",
    "opendrive.import-all-lanes": "true",
    "offset.disable-normalization": "true",
    "no-turnarounds": "true",
    "no-internal-links": "false",
}
# OpenStreetMap: what SUMO's documentation recommends for it, for cars.
_OPEN_STREET_MAP = {
    "geometry.remove": "true",
    "ramps.guess": "true",
    "junctions.join": "true",
    "tls.guess-signals": "true",
    "tls.discard-simple": "true",
    "tls.join": "true",
    "no-turnarounds.except-deadend": "true",
    "keep-edges.by-vclass": "passenger",
}


def is_open_street_map(path: Path) -> bool:
    """Whether an ``.osm`` file holds streets and no lanelets."""
    if path.suffix != ".osm" or not path.is_file():
        return False
    content = path.read_bytes()
    return b"highway" in content and b"lanelet" not in content


def read_imported_road(path: str | Path) -> Road:
    """Read a map by way of netconvert; the net is kept in the system's folder for temporary files.

    OpenDRIVE's coordinates stay; those of OpenStreetMap become metres east and north of the net's corner.

    Args:
        path: ``.xodr``, ``.xodr.gz`` or an OpenStreetMap ``.osm``.

    Raises:
        MapError: netconvert cannot read it, or there is no lane for cars in it.
    """
    path = Path(path)
    drive = str(path).lower().endswith(OPENDRIVE)
    content = unpacked(path)
    options = _OPENDRIVE if drive else _OPEN_STREET_MAP
    key = hashlib.sha256(repr((__version__, sorted(options.items()))).encode() + content).hexdigest()[:16]
    folder = Path(tempfile.gettempdir()) / f"scex-sumo-nets-{os.getuid()}" / key
    net = folder / f"{map_name(path)}.net.xml"
    if not net.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        source = folder / ("map.xodr" if drive else "map.osm.xml")
        source.write_bytes(content)
        _netconvert(path, "opendrive-files" if drive else "osm-files", source, net, options)
    try:
        road = read_sumo_road(net)
    except MapError as error:
        raise MapError(f"{path}: netconvert makes no usable net of it ({error})") from None
    return replace(road, notes=(f"{path.name}: read by way of netconvert, as {net}",))


def _netconvert(path: Path, kind: str, source: Path, net: Path, options: dict[str, str]) -> None:
    unfinished = net.with_name(f".{os.getpid()}.net.xml")
    given = {kind: str(source), "output-file": str(unfinished), "xml-validation": "never", **options}
    command = [program("netconvert"), *(word for k, v in given.items() for word in (f"--{k}", v))]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment())
    if done.returncode or not unfinished.is_file():
        said = [line for line in done.stderr.splitlines() if line.startswith("Error")]
        raise MapError(f"{path}: netconvert cannot read it: {said[0] if said else done.returncode}")
    unfinished.replace(net)
