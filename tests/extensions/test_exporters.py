"""An exporter of another package is one file: used by its name, offered and completed like our own."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo import example_path, read_seed
from tests.extensions.package import install, scex
from tests.runs import extrapolate

CODE = '''
def write_places(request):
    """Write where each vehicle ends, one line each."""
    (future,) = request.futures
    end = request.run.states(future)[:, -1]
    path = request.folder / f"{request.file_stem(future)}.txt"
    path.write_text("".join(f"{t} {x:.2f}\\n" for t, x in zip(request.scene.track_ids, end.x)))
    return [path]
'''


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two futures of the example roundabout."""
    out = tmp_path_factory.mktemp("run") / "out"
    return extrapolate(read_seed(example_path("roundabout")), futures=2, out=out).folder


def test_an_exporter_of_another_package_is_used_by_its_name(result: Path, tmp_path: Path) -> None:
    install(tmp_path, group="scex_sumo.exporters", name="places", target="stranger:write_places", code=CODE)
    done = scex(tmp_path, "export", result, "--future", 0, "--to", "places", "-o", tmp_path / "mine")
    assert done.returncode == 0, done.stderr
    file = Path(done.stdout.strip())
    assert file.parent == tmp_path / "mine" and file.name.endswith("_future0000.txt")
    assert len(file.read_text().splitlines()) == 14


def test_an_exporter_that_cannot_be_imported_is_one_line(result: Path, tmp_path: Path) -> None:
    install(tmp_path, group="scex_sumo.exporters", name="places", target="stranger:no", code="import nowhere")
    done = scex(tmp_path, "export", result, "--future", 0, "--to", "places")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "nowhere" in done.stderr


def test_an_error_of_an_exporter_is_one_line_with_its_line(result: Path, tmp_path: Path) -> None:
    for changed, says in (
        (
            CODE.replace("    end = ", "    end = {}['end']\n    end = "),
            "raised KeyError: 'end' (stranger.py, line 5)",
        ),
        (CODE.replace("{x:.2f}", "{__import__('time').time_ns()}"), "wrote something else when called again"),
        (CODE.replace("return [path]", "return 3"), "raised TypeError: 'int' object is not iterable"),
    ):
        folder = tmp_path / str(len(changed))
        folder.mkdir()
        install(
            folder, group="scex_sumo.exporters", name="places", target="stranger:write_places", code=changed
        )
        done = scex(folder, "export", result, "--future", 0, "--to", "places", "-o", folder / "mine")
        assert done.returncode == 1 and f"export format places: it {says}" in done.stderr, done.stderr
        assert "Traceback" not in done.stderr
