"""ASAM's quality checkers, asked about exported files where they are installed. For tests, and by hand.

They need an environment of their own: ``python -m venv qc`` and ``qc/bin/pip install asam-qc-opendrive
asam-qc-openscenarioxml``. By hand: ``SCEX_QC=qc/bin python -m tests.exporters.quality_checkers FILE...``
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree as ET

_CHECKERS = {".xodr": ("qc_opendrive", "xodrBundle"), ".xosc": ("qc_openscenario", "xoscBundle")}
# Skipped by itself for OpenDRIVE 1.7: its rule is of version 1.8.
_LATER = "check_asam_xodr_junctions_connection_one_link_to_incoming"


def checker(suffix: str) -> str | None:
    """The program that checks files of a kind, from ``SCEX_QC`` or the path; None where there is none."""
    name = _CHECKERS[suffix][0]
    return shutil.which(name, path=os.environ.get("SCEX_QC")) or shutil.which(name)


def findings(file: Path) -> list[str]:
    """What a checker has to say against a file; one that ends without a finished report is a finding, too.

    The checkers' exit status says nothing: it is 0 even where the file is missing.
    """
    program, bundle = checker(file.suffix), _CHECKERS[file.suffix][1]
    assert program is not None
    with tempfile.TemporaryDirectory() as folder:
        config, report = Path(folder) / "config.xml", Path(folder) / "report.xqar"
        config.write_text(
            f'<Config><Param name="InputFile" value="{file.resolve()}"/>'
            f'<CheckerBundle application="{bundle}"><Param name="resultFile" value="{report}"/>'
            "</CheckerBundle></Config>"
        )
        done = subprocess.run(
            [program, "-c", str(config)], cwd=folder, capture_output=True, text=True, check=False
        )
        if not report.is_file():
            return [f"{file.name}: no report: {done.stderr[-300:]}"]
        root = ET.parse(report).getroot()
    return _of_report(file, root)


def _of_report(file: Path, root: ET.Element) -> list[str]:
    said = [
        f"{file.name}: {one.get('checkerId')}: {issue.get('description')} {_place(issue)}"
        for one in root.iter("Checker")
        for issue in one.iter("Issue")
    ]
    status = {one.get("checkerId"): one.get("status") for one in root.iter("Checker")}
    said += [f"{file.name}: {i}: {word}" for i, word in status.items() if word != "completed" and i != _LATER]
    return said if status else [f"{file.name}: no checker ran"]


def _place(issue: ET.Element) -> str:
    where = issue.find(".//XMLLocation")
    return "" if where is None else str(where.get("xpath"))


if __name__ == "__main__":
    against = [line for name in sys.argv[1:] for line in findings(Path(name))]
    print("\n".join(against) or f"{len(sys.argv) - 1} files: nothing to say against them")
    sys.exit(bool(against))
