"""Writer of Lanelet2 map files."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr as quoted

from scex_sumo.converters.lanelet.file import MapFile, Tags


def write_map_file(map_file: MapFile, path: Path) -> None:
    """Write a map for Lanelet2, elements by ascending id."""
    lines = ["<?xml version='1.0' encoding='UTF-8'?>", "<osm version='0.6' generator='scex-sumo'>"]
    for i, node in sorted(map_file.nodes.items()):
        lines.append(f"<node id='{i}' lat='{node.lat!r}' lon='{node.lon!r}'>")
        lines.append(f"<tag k='ele' v='{node.ele!r}'/></node>")
    for i, way in sorted(map_file.ways.items()):
        lines.append(f"<way id='{i}'>")
        lines += [f"<nd ref='{node}'/>" for node in way.nodes]
        lines += [*_tag_lines(way.tags), "</way>"]
    for i, relation in sorted(map_file.relations.items()):
        lines.append(f"<relation id='{i}'>")
        lines += [f"<member type='{m.kind}' ref='{m.ref}' role={quoted(m.role)}/>" for m in relation.members]
        lines += [*_tag_lines(relation.tags), "</relation>"]
    path.write_text("\n".join([*lines, "</osm>\n"]), encoding="utf-8")


def _tag_lines(tags: Tags) -> list[str]:
    return [f"<tag k={quoted(key)} v={quoted(value)}/>" for key, value in tags.items()]
