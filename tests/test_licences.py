"""Table of licences: it names what pyproject.toml installs."""

from __future__ import annotations

import re
import sys
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[1]


def test_the_table_of_licences_has_every_package_that_users_install() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = {
        name: needs
        for name, needs in project["optional-dependencies"].items()
        if name not in ("all", "dev", "docs")
    }
    needed = [("all", need) for need in project["dependencies"]]
    needed += [(f"`{name}`", need) for name, needs in extras.items() for need in needs]
    table = re.findall(r"^\| ([a-z0-9, -]+) \| (all|`\w+`) \|", (ROOT / "docs/licences.md").read_text(), re.M)
    listed = [(by, package) for packages, by in table for package in packages.split(", ")]
    assert sorted(listed) == sorted((by, re.split("[^a-z0-9-]", need)[0]) for by, need in needed)
