"""Site of the docs: ``make docs-site`` builds it into ``out/site/html``, with a report of each example seed.

Run: ``python docs/make_site.py [CHILDREN]``; needs ``pip install 'scex-sumo[docs]'``. A link or anchor that
leads nowhere ends it.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import scex_sumo as scex
from scex_sumo.scenarios import EXAMPLES

ROOT = Path(__file__).resolve().parent.parent
DOCS, SITE = ROOT / "docs", ROOT / "out" / "site"
SOURCE = SITE / "source"
BESIDE = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "benchmarks/README.md": "benchmarks.md",
}
"""Pages of the repository outside of docs/, and their names in the site."""

GALLERY = """# Gallery

Reports of the example seeds, as `scex-sumo run` writes them: each is one file without network.

"""


def gather() -> None:
    """Copy the pages with what they show, links made to lead to where it lies in the site."""
    shutil.rmtree(SOURCE, ignore_errors=True)
    shutil.copytree(DOCS, SOURCE, ignore=shutil.ignore_patterns("*.py", "mkdocs.yml", "__pycache__"))
    shutil.copytree(DOCS / "examples", SOURCE / "examples", dirs_exist_ok=True)
    for file, name in BESIDE.items():
        text = (ROOT / file).read_text(encoding="utf-8")
        for other, page in BESIDE.items():
            text = text.replace(f"]({other}", f"]({page}")
        (SOURCE / name).write_text(re.sub(r"\]\((\.\./)?docs/", "](", text), encoding="utf-8")
    notebook = json.loads((DOCS / "tutorial.ipynb").read_text(encoding="utf-8"))
    (SOURCE / "tutorial.md").write_text(page_of(notebook), encoding="utf-8")


def page_of(notebook: dict[str, list[dict[str, object]]]) -> str:
    """The cells of a notebook as Markdown, and where to get it."""
    cells = []
    for cell in notebook["cells"]:
        text = "".join(map(str, cell["source"]))  # type: ignore[call-overload]
        cells.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
    return "\n\n".join([*cells, "The same [as a notebook](tutorial.ipynb).\n"])


def gallery(children: int) -> None:
    """Run the example seeds, and gather their reports and a figure of each."""
    folder, lines = SOURCE / "gallery", [GALLERY]
    folder.mkdir()
    for name in EXAMPLES:
        seed, out = scex.example_path(name).relative_to(ROOT), (SITE / "runs" / name).relative_to(ROOT)
        command = [sys.executable, "-m", "scex_sumo", "run", str(seed), "--children", str(children)]
        subprocess.run(
            [*command, "-o", str(out), "--overwrite"], cwd=ROOT, check=True, stdout=subprocess.DEVNULL
        )
        run = scex.open_run(ROOT / out)
        shutil.copy(run.folder / "report.html", folder / f"{name}.html")
        run.plot(folder / f"{name}.svg")
        title, share = name.replace("_", " ").capitalize(), run.p_collision.value
        lines.append(
            f"## {title}\n\n[Its report](gallery/{name}.html): {run.children} child scenarios, "
            f"two vehicles collide in {share:.0%} of them.\n\n![Densities of {name}](gallery/{name}.svg)\n\n"
        )
    (SOURCE / "gallery.md").write_text("".join(lines), encoding="utf-8")


def build() -> int:
    """Build the site of what is gathered; returns the status of zensical."""
    shutil.copy(DOCS / "mkdocs.yml", SITE)
    command = [sys.executable, "-m", "zensical", "build", "--strict", "--clean", "-f", "mkdocs.yml"]
    return subprocess.run(command, cwd=SITE, check=False).returncode


def main() -> int:
    """Gather, run, build; returns the status."""
    gather()
    gallery(int(sys.argv[1]) if len(sys.argv) > 1 else 385)
    if status := build():
        return status
    print(f"open {SITE / 'html' / 'index.html'}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
