"""OpenStreetMap maps, read by way of SUMO's netconvert."""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import os
import shutil
import stat
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from scex_sumo.base.errors import MapError
from scex_sumo.base.files import TemporaryFolder, cache_folder, sha256_of, write_atomic
from scex_sumo.base.sumo.programs import run_program
from scex_sumo.base.version import __version__, version_of
from scex_sumo.converters.lanelet.tags import drives_left_at
from scex_sumo.converters.naming import map_name, number
from scex_sumo.converters.registries import MapFormat
from scex_sumo.converters.xml import is_utf8, unpacked, xml_root
from scex_sumo.formats.recognition import is_open_street_map
from scex_sumo.formats.sumo.net import read_sumo_road
from scex_sumo.road import Road

MAX_NETS = 64  # in the cache; the oldest one goes first
# OpenStreetMap: what SUMO's documentation recommends for it, for cars.
_OPTIONS = {
    "geometry.remove": "true",
    "ramps.guess": "true",
    "junctions.join": "true",
    "tls.guess-signals": "true",
    "tls.discard-simple": "true",
    "tls.join": "true",
    "no-turnarounds.except-deadend": "true",
    "keep-edges.by-vclass": "passenger",
}


def _read_imported_road(path: str | Path, **_: object) -> Road:
    """Read an OpenStreetMap file by way of netconvert; its net is kept in the user's cache."""
    path = Path(path)
    content = unpacked(path)
    root = xml_root(path, content, "leave roads out until netconvert can read it")
    if not is_utf8(content):
        content = ElementTree.tostring(root, encoding="utf-8")
    options = _OPTIONS | ({"lefthand": "true"} if _drives_left(root) else {})
    made_with = repr((__version__, version_of("eclipse-sumo"), sorted(options.items())))
    net = kept_net(path, made_with.encode() + content, lambda: _netconvert(path, content, options))
    try:
        road = read_sumo_road(net)
    except MapError as error:
        raise MapError(f"{path}: netconvert cannot convert it to a usable net ({error})") from None
    note = f"{path.name}: read by way of netconvert, as {net}"
    return replace(road, phases=False, notes=(note, *road.notes))


def _drives_left(root: ElementTree.Element) -> bool:
    """Return whether traffic drives on the left where most nodes lie."""
    nodes = [(number(x.get("lat")), number(x.get("lon"))) for x in root.iter("node")]
    latitude, longitude = np.nanmedian(np.array([*nodes, (np.nan, np.nan)]), axis=0) if nodes else (0.0, 0.0)
    return bool(drives_left_at((float(latitude), float(longitude))))


def kept_net(path: Path, made_of: bytes, make: Callable[[], bytes]) -> Path:
    """Return the net that ``make`` makes of a file, kept in the user's cache by what it is made of."""
    place = _private_folder() / hashlib.sha256(made_of).hexdigest()[:32]
    net, digest = place / f"{map_name(path)}.net.xml", place / "sha256"
    whole = False
    with contextlib.suppress(OSError):  # not there
        whole = sha256_of(net).encode() == digest.read_bytes()
    if not whole:
        content = make()
        place.mkdir(mode=0o700, exist_ok=True)
        write_atomic(net, content)
        write_atomic(digest, hashlib.sha256(content).hexdigest().encode())
        for old in sorted(place.parent.iterdir(), key=lambda old: old.stat().st_mtime)[:-MAX_NETS]:
            shutil.rmtree(old, ignore_errors=True)
    return net


def _private_folder() -> Path:
    folder = cache_folder() / "imported"
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        states = [place.lstat() for place in (folder.parent, folder)]
        if all(stat.S_ISDIR(s.st_mode) and s.st_uid == os.getuid() and not s.st_mode & 0o022 for s in states):
            return folder
    return Path(_temporary_folder().name)


@cache
def _temporary_folder() -> TemporaryFolder:
    folder = TemporaryFolder()
    atexit.register(folder.cleanup)
    return folder


def _netconvert(path: Path, content: bytes, options: Mapping[str, str]) -> bytes:
    with TemporaryFolder() as folder:
        Path(folder, "map.xml").write_bytes(content)
        # Names without a folder: SUMO splits paths at commas.
        given = {"osm-files": "map.xml", "output-file": "made.net.xml", "xml-validation": "never"}
        words = (word for k, v in {**given, **options}.items() for word in (f"--{k}", v))
        said = run_program("netconvert", *words, folder=Path(folder), file_bytes=len(content))
        errors, net = [line for line in said if line.startswith("Error")], Path(folder, "made.net.xml")
        if errors or not net.is_file():
            reason = errors[0].removeprefix("Error: ") if errors else "it writes no net"
            raise MapError(f"{path}: netconvert cannot read it: {reason}; leave roads out until it can")
        written = net.read_bytes()
    if not written.rstrip().endswith(b"</net>"):
        raise MapError(f"{path}: netconvert's net is cut short; make room in {tempfile.gettempdir()}")
    return written


OPEN_STREET_MAP = MapFormat(is_mine=is_open_street_map, read=_read_imported_road)
