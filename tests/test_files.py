"""Two processes never write into one folder; one that ends, however, leaves it to the next."""

from __future__ import annotations

import errno
import fcntl
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest

from scex_sumo.errors import ResultError
from scex_sumo.files import TemporaryFolder, lock, quoted, replacing, unlock, write_atomic, writing
from scex_sumo.ranking.folder import RankFolder
from scex_sumo.results.folder import ResultFolder

HOLDING = """
import sys
from pathlib import Path
from scex_sumo.files import lock
lock(Path(sys.argv[1]))
print("held", flush=True)
sys.stdin.read()
"""


def _another(folder: Path) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDING, str(folder)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
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


def test_two_rankings_never_write_one_folder(tmp_path: Path) -> None:
    with _another(tmp_path) as other:
        with pytest.raises(ResultError, match="another process is writing"):
            RankFolder(tmp_path, {"seed": 1})
        assert not any(tmp_path.iterdir())
        other.kill()
    with RankFolder(tmp_path, {"seed": 1}):
        pass
    assert _lets_in(tmp_path)


def test_a_run_that_failed_can_be_repeated_in_the_same_process(tmp_path: Path) -> None:
    failed = ResultFolder(tmp_path, {"seed": 1})
    again = ResultFolder(tmp_path, {"seed": 1})
    again.finish({})
    assert again.identity == failed.identity
    assert (tmp_path / "run.json").is_file()


def test_a_finished_run_lets_others_in(tmp_path: Path) -> None:
    ResultFolder(tmp_path, {"seed": 1}).finish({})
    assert _lets_in(tmp_path)


def test_letting_go_of_what_is_not_locked_does_nothing(tmp_path: Path) -> None:
    unlock(tmp_path)
    lock(tmp_path)
    unlock(tmp_path)
    unlock(tmp_path)
    assert _lets_in(tmp_path)


def test_what_fails_on_the_way_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    write_atomic(path, b"before")
    with pytest.raises(ValueError, match="on the way"), replacing(path) as temporary:
        temporary.write_bytes(b"half")
        raise ValueError("on the way")
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


def test_an_error_while_writing_names_the_file(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match=r"missing/run\.json: cannot write: No such file"):
        write_atomic(tmp_path / "missing" / "run.json", b"{}")


@pytest.mark.parametrize("text", ["", "a & b < c > d", 'in "quotes"', "it's", "both ' and \"", "a\tb\nc\r"])
def test_attributes_are_quoted_as_the_standard_library_does(text: str) -> None:
    assert quoted(text) == quoteattr(text)


def test_temporary_folders_of_ended_processes_are_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with subprocess.Popen(["true"]) as ended:
        ended.wait()
    abandoned = tmp_path / f"scex-{ended.pid}-abc"
    foreign = tmp_path / "scex-notes"
    own = tmp_path / f"scex-{os.getpid()}-abc"
    for folder in (abandoned, foreign, own):
        folder.mkdir()
        (folder / "file").touch()
    with TemporaryFolder() as name:
        assert Path(name).is_dir()
        assert not abandoned.exists()
        assert (foreign / "file").exists() and (own / "file").exists()
    assert not Path(name).exists()


def test_a_temporary_folder_that_is_locked_is_somebodys(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in a container whose processes have other numbers."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    theirs = tmp_path / "scex-999999999-abc"
    theirs.mkdir()
    descriptor = os.open(theirs, os.O_RDONLY)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    TemporaryFolder().cleanup()
    assert theirs.is_dir()
    os.close(descriptor)
    TemporaryFolder().cleanup()
    assert not theirs.exists()


def test_what_cannot_be_written_is_named_though_the_system_names_nothing(tmp_path: Path) -> None:
    with (
        pytest.raises(ResultError, match=r"x\.svg: cannot write: No space left on device"),
        writing(tmp_path / "x.svg"),
    ):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
