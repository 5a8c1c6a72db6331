"""Site of the docs: ``make docs-site`` builds it into ``out/site/html``, with a report of each example seed.

The references of the command line and of Python are generated from the code.

Run: ``python docs/make_site.py [FUTURES]``; needs ``pip install '.[docs]' in the clone``.
A dead link or anchor is an error.
"""

from __future__ import annotations

import inspect
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
from typer.main import get_command

import scex_sumo as scex
from scex_sumo.cli import command_line
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

Reports of the example seeds, as `scex-sumo run` writes them. Each is one file without network access.

"""
REPORT = '<iframe src="gallery/{name}.html" title="report" style="width:100%;height:900px;border:0"></iframe>'


def gather() -> None:
    """Copy the pages with their pictures, adapt the links, and generate the references."""
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
    (SOURCE / "command_line.md").write_text(command_reference(), encoding="utf-8")
    (SOURCE / "python.md").write_text(python_reference(), encoding="utf-8")


def command_reference() -> str:
    """Return the help of every command as one page."""
    group = get_command(command_line())
    parts = ["# Command line\n\nGenerated from the code; `scex-sumo COMMAND --help` prints the same.\n"]
    with click.Context(group, info_name="scex-sumo") as above:
        for name in group.list_commands(above):
            command = group.get_command(above, name)
            with click.Context(command, info_name=name, parent=above, max_content_width=100) as context:
                parts.append(f"## {name}\n\n```text\n{command.get_help(context)}\n```\n")
    return "\n".join(parts)


def python_reference() -> str:
    """Return signature and docstring of every public name as one page."""
    parts = ["# Python\n\nGenerated from the docstrings of `scex_sumo`.\n"]
    for name in scex.__all__:
        thing = getattr(scex, name)
        if not callable(thing):
            continue
        try:
            signature = f"{name}{inspect.signature(thing)}"
        except ValueError:
            signature = name
        parts.append(f"## {name}\n\n```text\n{signature}\n\n{inspect.getdoc(thing)}\n```\n")
    return "\n".join(parts)


def page_of(notebook: dict[str, list[dict[str, Any]]]) -> str:
    """Return the cells of a notebook and their outputs as Markdown, with a link to it."""
    cells = []
    for cell in notebook["cells"]:
        text = "".join(cell["source"])
        cells.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
        for output in cell.get("outputs", ()):
            data = {kind: "".join(lines) for kind, lines in output["data"].items()}
            drawn = data.get("text/html") or data.get("image/svg+xml")
            # Markdown ends a block of HTML at an empty line.
            block = f"<div>{drawn}</div>".replace("\n\n", "\n") if drawn else ""
            cells.append(block or f"```text\n{data['text/plain']}\n```")
    return "\n\n".join([*cells, "The same [as a notebook](tutorial.ipynb).\n"])


def gallery(futures: int) -> None:
    """Run the example seeds and gather their reports and figures."""
    folder, lines = SOURCE / "gallery", [GALLERY]
    folder.mkdir()
    for name in EXAMPLES:
        seed, out = scex.example_path(name).relative_to(ROOT), (SITE / "runs" / name).relative_to(ROOT)
        command = [sys.executable, "-m", "scex_sumo", "run", str(seed), "--futures", str(futures)]
        subprocess.run(
            [*command, "-o", str(out), "--overwrite"], cwd=ROOT, check=True, stdout=subprocess.DEVNULL
        )
        run = scex.open_run(ROOT / out)
        shutil.copy(run.folder / "report.html", folder / f"{name}.html")
        scex.plot(run, folder / f"{name}.svg")
        title, share = name.replace("_", " ").capitalize(), run.collision.value
        lines.append(
            f"## {title}\n\n{run.futures} futures, with a collision in {share:.0%} of them.\n\n"
            f"{REPORT.format(name=name)}\n\n![Densities of {name}](gallery/{name}.svg)\n\n"
        )
    (SOURCE / "gallery.md").write_text("".join(lines), encoding="utf-8")


def build() -> int:
    """Build the site from the gathered pages; return the status of zensical."""
    shutil.copy(DOCS / "mkdocs.yml", SITE)
    command = [sys.executable, "-m", "zensical", "build", "--strict", "--clean", "-f", "mkdocs.yml"]
    return subprocess.run(command, cwd=SITE, check=False).returncode


def main() -> int:
    """Gather, run, build; return the status."""
    gather()
    gallery(int(sys.argv[1]) if len(sys.argv) > 1 else 385)
    if status := build():
        return status
    print(f"open {SITE / 'html' / 'index.html'}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
