"""A command of another package is one file: listed in the help and used by its name."""

from __future__ import annotations

from pathlib import Path

from tests.extensions.package import install, scex

CODE = '''
from pathlib import Path

EXAMPLE = "out/k733"


def count_command(folder: Path) -> None:
    """Count the futures of a result."""
    print(f"counted in {folder}")
'''


def test_a_command_of_another_package_is_used_by_its_name(tmp_path: Path) -> None:
    install(tmp_path, group="scex_sumo.commands", name="count", target="stranger:count_command", code=CODE)
    done = scex(tmp_path, "count", "out/mine")
    assert (done.returncode, done.stdout) == (0, "counted in out/mine\n"), done.stderr
    assert "Example:\n  scex-sumo count out/k733\n" in scex(tmp_path, "count", "--help").stdout
    listed = scex(tmp_path, "--help").stdout.partition("Of other packages:\n")[2]
    assert listed == "  count       Count the futures of a result.\n"


def test_a_command_that_cannot_be_imported_leaves_the_others_listed(tmp_path: Path) -> None:
    install(
        tmp_path, group="scex_sumo.commands", name="count", target="stranger:no", code="import nothing_here"
    )
    listed = scex(tmp_path, "--help")
    assert listed.returncode == 0 and "encounters" in listed.stdout
    assert "warning: command count is left out" in listed.stderr and "nothing_here" in listed.stderr
    asked = scex(tmp_path, "count")
    assert (
        asked.returncode == 2
        and asked.stderr.startswith("error: stranger:no")
        and "Traceback" not in asked.stderr
    )
