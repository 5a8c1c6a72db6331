"""One parser reads every XML of others: no declared types, no endless nesting, no odd encodings."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

import scex_sumo as scex
from scex_sumo.converters.xml import MAX_DEPTH, xml_root
from tests.converters.plain_net import NET

ROOTS = {
    "lanes.osm": "<osm><!-- lanelet -->{}</osm>",
    "streets.osm": '<osm><way id="1"><tag k="highway" v="residential"/></way>{}</osm>',
    "n.net.xml": "<net>{}</net>",
    "m.xodr": "<OpenDRIVE>{}</OpenDRIVE>",
    "c.xml": '<commonRoad commonRoadVersion="2020a">{}</commonRoad>',
    "f.fcd.xml": "<fcd-export>{}</fcd-export>",
    "s.xml": "<snapshot>{}</snapshot>",
    "n.sumocfg": "<configuration>{}</configuration>",
}
EXTERNAL = '<!DOCTYPE x [<!ENTITY a SYSTEM "/etc/passwd">]>'


def refusal(file: Path, content: bytes) -> str:
    """The one line that reading it as a map, or as tracks, ends with."""
    file.write_bytes(content)
    with pytest.raises(scex.ScexError) as error:
        if file.name in ("f.fcd.xml", "s.xml"):
            net = file.with_name("m.net.xml")
            net.write_text(NET)
            scex.read_seed(net, tracks=file, time=1.0)
        else:
            scex.read_map(file)
    assert "\n" not in str(error.value) and file.name in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-16-le", "utf-7", "latin-1"])
@pytest.mark.parametrize("name", sorted(ROOTS))
def test_no_file_declares_a_document_type_in_any_encoding(name: str, encoding: str, tmp_path: Path) -> None:
    text = f'<?xml version="1.0" encoding="{encoding}"?>{EXTERNAL}' + ROOTS[name].format("&a;")
    words = refusal(tmp_path / name, text.encode(encoding))
    if encoding in ("utf-8", "latin-1") or (encoding == "utf-16" and name != "s.xml"):
        assert "has a DOCTYPE, which could read other files" in words


@pytest.mark.parametrize("name", sorted(ROOTS))
def test_elements_within_each_other_are_counted_before_anything_recurses(name: str, tmp_path: Path) -> None:
    began = time.monotonic()
    nested = ROOTS[name].format("<a>" * 200_000 + "</a>" * 200_000)
    assert f"more than {MAX_DEPTH} elements within each other" in refusal(tmp_path / name, nested.encode())
    assert time.monotonic() - began < 20.0


def test_a_depth_that_is_allowed_is_read(tmp_path: Path) -> None:
    text = "<a>" * MAX_DEPTH + "</a>" * MAX_DEPTH
    assert len(list(xml_root(tmp_path / "a.xml", text.encode()).iter())) == MAX_DEPTH
