from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

import pytest

from scex_sumo.base.errors import MapError
from scex_sumo.base.files import cache_folder
from scex_sumo.converters.maps import read_map
from scex_sumo.formats.sumo import imported

STREETS = """<osm version="0.6">
 <node id="1" lat="49.0" lon="8.4"/><node id="2" lat="49.0" lon="8.402"/>
 <node id="3" lat="49.001" lon="8.402"/>
 <way id="9"><nd ref="1"/><nd ref="2"/><nd ref="3"/><tag k="highway" v="residential"/></way>
</osm>"""


def nets_kept() -> list[Path]:
    return sorted((cache_folder() / "imported").rglob("*.net.xml"))


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.mark.usefixtures("own_cache")
@pytest.mark.parametrize("trap", ["link", "open to all"])
def test_a_cache_that_somebody_else_could_write_into_is_not_used(
    trap: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    temporary, elsewhere = tmp_path / "tmp", tmp_path / "elsewhere"
    for folder in (temporary, elsewhere, cache_folder()):
        folder.mkdir(parents=True)
    if trap == "link":
        (cache_folder() / "imported").symlink_to(elsewhere)
    else:
        (cache_folder() / "imported").mkdir()
        (cache_folder() / "imported").chmod(0o777)
    (temporary / f"scex-sumo-nets-{os.getuid()}").symlink_to(elsewhere)
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    file = tmp_path / "town.osm"
    file.write_text(STREETS)
    road = read_map(file)
    assert not nets_kept() and not [*elsewhere.iterdir()]
    assert road.net is not None
    private = road.net.parent.parent
    assert private.parent == temporary and stat.S_IMODE(private.stat().st_mode) == 0o700
    imported._temporary_folder().cleanup()
    imported._temporary_folder.cache_clear()


@pytest.mark.usefixtures("own_cache")
def test_a_net_cut_by_a_full_disk_is_an_error_and_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cut = tmp_path / "netconvert"
    cut.write_text("#!/bin/sh\nprintf '<net><edge' > made.net.xml\n")  # as netconvert does, with status 0
    cut.chmod(0o755)
    monkeypatch.setattr("scex_sumo.base.sumo.programs.program", lambda name: str(cut))
    file = tmp_path / "town.osm"
    file.write_text(STREETS)
    with pytest.raises(MapError, match=r"town\.osm: netconvert's net is cut short; make room in "):
        read_map(file)
    assert not nets_kept()


@pytest.mark.parametrize("word", ["DOCTYPE osm SYSTEM '/etc/passwd'", "DOCTYPE osm [<!ENTITY a 'b'>]"])
def test_maps_that_declare_a_document_type_are_refused(word: str, tmp_path: Path) -> None:
    file = tmp_path / "town.osm"
    file.write_text(f"<!{word}>{STREETS}")
    with pytest.raises(MapError, match="has a DOCTYPE"):
        read_map(file)
