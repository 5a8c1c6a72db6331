"""The tutorial runs from its first cell to its last, and is kept with the outputs that it gives."""

from __future__ import annotations

from pathlib import Path

import pytest

TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorial.ipynb"

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")
pytest.importorskip("pandas")


def shown(notebook: nbformat.NotebookNode) -> list[dict[str, str]]:
    """Return the outputs of all cells; each cell of code has one."""
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert cells and all(len(cell.outputs) == 1 for cell in cells)
    return [cell.outputs[0].data for cell in cells]


@pytest.mark.filterwarnings("ignore")  # of Jupyter's own machinery
def test_the_outputs_that_are_kept_are_those_of_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(TUTORIAL.parents[1]))
    monkeypatch.setenv("JUPYTER_PLATFORM_DIRS", "1")
    notebook = nbformat.read(TUTORIAL, as_version=4)
    kept = [data["text/plain"] for data in shown(notebook)]
    nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(tmp_path)}}).execute()
    made = shown(notebook)
    assert [data["text/plain"] for data in made] == kept, "write it again: make docs-tutorial"
    html = [data["text/html"] for data in made if "text/html" in data]
    assert html[0].startswith("<iframe srcdoc=")  # the report
    assert "wttc" in html[1] and "other_id" in html[2]
    assert any("image/svg+xml" in data for data in made)
    assert TUTORIAL.stat().st_size < 400_000
