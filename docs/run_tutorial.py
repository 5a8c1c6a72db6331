"""Run the tutorial and keep it with its outputs: ``make docs-tutorial``."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import nbclient
import nbformat

TUTORIAL = Path(__file__).resolve().parent / "tutorial.ipynb"


def executed(notebook: nbformat.NotebookNode, folder: Path) -> nbformat.NotebookNode:
    """Return the notebook with the outputs of a fresh kernel that runs in a folder."""
    os.environ["PYTHONPATH"] = str(TUTORIAL.parents[1])
    resources = {"metadata": {"path": str(folder)}}
    nbclient.NotebookClient(notebook, timeout=120, record_timing=False, resources=resources).execute()
    return notebook


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        done = executed(nbformat.read(TUTORIAL, as_version=4), Path(place))
    done.metadata = {"kernelspec": done.metadata["kernelspec"], "language_info": {"name": "python"}}
    nbformat.write(done, TUTORIAL)
