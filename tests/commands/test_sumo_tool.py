"""SUMO's way to give options: they are those of the command line."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from scex_sumo.commands.shared import COMMANDS
from scex_sumo.sumo_tool import parser_of, words_of


@pytest.mark.parametrize("name", sorted(COMMANDS.paths))
def test_a_template_has_every_option_of_a_command(name: str, tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as ended:
        words_of(name, ["--save-template", str(tmp_path / "template.xml")])
    assert not ended.value.code
    options = {o.tag: o for o in ElementTree.parse(tmp_path / "template.xml").getroot()}
    _, command = parser_of(name)
    wanted = {p.name: p for p in command.params if p.name not in ("config", "help")}
    assert len(options) == len(wanted)
    for param in wanted.values():
        names = [o.removeprefix("--") for o in (*param.opts, *param.secondary_opts)]
        (option,) = [options[n] for n in (*names, param.name.replace("_", "-")) if n in options][:1]
        assert option.get("type") in ("file", "int", "float", "time", "bool", "string") and option.get("help")
        assert (option.get("type") == "file") == (param.type.name == "path")


def test_options_become_those_of_the_command() -> None:
    given = [
        "--map-path",
        "a.osm",
        "--time",
        "0:01:40",
        "--steps",
        "40",
        "--no-report",
        "--assign",
        "1=idm",
        "2=idm",
    ]
    words = [
        "run",
        "--time=100.0",
        "--steps=40",
        "--assign=1=idm",
        "--assign=2=idm",
        "--no-report",
        "--",
        "a.osm",
    ]
    assert words_of("run", given) == words
    assert words_of("rank", ["--roots", "a", "b", "--from", "5"]) == ["rank", "--from=5.0", "--", "a", "b"]
