"""Two processes never write into one folder; one that ends, however, leaves it to the next."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from scex_sumo.base.errors import ResultError
from scex_sumo.base.files import TemporaryFolder, replacing, write_atomic, writing
from scex_sumo.results.folder import ResultFolder

HOLDING = """
import sys
from pathlib import Path
from scex_sumo.base.files import lock
lock(Path(sys.argv[1]))
print("held", flush=True)
sys.stdin.read()
"""


def _another(folder: Path) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDING, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None and process.stdout.readline() == "held\n"
    return process


def _lets_in(folder: Path) -> bool:
    """Whether another process can hold the folder now."""
    command = [sys.executable, "-c", HOLDING, str(folder)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    return done.stdout == "held\n"


def test_a_folder_that_another_process_writes_is_refused_until_that_dies(tmp_path: Path) -> None:
    with _another(tmp_path) as other:
        with pytest.raises(ResultError, match="another process is writing"):
            ResultFolder(tmp_path, {"seed": 1})
        assert not any(tmp_path.iterdir())
        other.kill()
    folder = ResultFolder(tmp_path, {"seed": 1})
    assert not _lets_in(tmp_path)
    folder.finish({})


def test_what_fails_on_the_way_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    write_atomic(path, b"before")
    with pytest.raises(ValueError, match="on the way"), replacing(path) as temporary:
        temporary.write_bytes(b"half")
        raise ValueError("on the way")
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


def marked(folder: Path, process: int) -> Path:
    """A folder as a process of that number leaves it when it is killed."""
    folder.mkdir()
    (folder / ".scex-sumo-temporary").write_text(f"scex-sumo process {process}\n")
    (folder / "file").touch()
    return folder


@pytest.fixture
def ended() -> int:
    with subprocess.Popen(["true"]) as process:
        process.wait()
    return process.pid


def test_temporary_folders_of_ended_processes_are_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ended: int
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    abandoned = marked(tmp_path / "scex-sumo-abc", ended)
    own = marked(tmp_path / "scex-sumo-own", os.getpid())
    with TemporaryFolder() as name:
        assert Path(name).stat().st_mode & 0o777 == 0o700
        assert not abandoned.exists()
        assert (own / "file").exists()
    assert not Path(name).exists()


def test_a_folder_of_another_user_survives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ended: int
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    theirs = marked(tmp_path / "scex-sumo-abc", ended)
    monkeypatch.setattr(os, "getuid", lambda: os.geteuid() + 1)
    TemporaryFolder().cleanup()
    assert theirs.is_dir()


def test_what_cannot_be_written_is_named_though_the_system_names_nothing(tmp_path: Path) -> None:
    with (
        pytest.raises(ResultError, match=r"x\.svg: cannot write: No space left on device"),
        writing(tmp_path / "x.svg"),
    ):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_two_processes_may_write_one_file_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "samples.npz"
    with replacing(file) as mine:
        mine.write_bytes(b"mine")
        monkeypatch.setattr(os, "getpid", lambda: 1)
        with replacing(file) as other:
            other.write_bytes(b"other")
        assert file.read_bytes() == b"other"
    assert file.read_bytes() == b"mine"
    assert list(tmp_path.iterdir()) == [file]
