"""A file that the user names replaces what this program wrote there, and nothing else."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from scex_sumo.base.errors import ResultError
from scex_sumo.base.files import replacing
from scex_sumo.base.outputs import check_output, write_output


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "a.csv"


def test_what_this_program_wrote_is_replaced_until_somebody_changes_it(file: Path) -> None:
    for content in (b"one", b"two"):
        write_output(file, content)
        assert file.read_bytes() == content
    file.write_bytes(b"mine")
    with pytest.raises(ResultError, match=r"a\.csv: exists, and not as scex-sumo wrote it; give another"):
        write_output(file, b"three")
    assert file.read_bytes() == b"mine"


def test_a_copy_of_what_this_program_wrote_is_the_users(file: Path) -> None:
    write_output(file, b"one")
    copy = file.with_name("b.csv")
    copy.write_bytes(file.read_bytes())
    with pytest.raises(ResultError, match="not as scex-sumo wrote it"):
        write_output(copy, b"two")


@pytest.mark.parametrize("link", ["symlink_to", "hardlink_to"])
def test_an_input_is_never_replaced_though_this_program_wrote_it(file: Path, link: str) -> None:
    write_output(file, b"tracks")
    linked = file.with_name("out.csv")
    getattr(linked, link)(file)
    for name in (file, linked):
        with pytest.raises(ResultError, match="is an input of this command"):
            write_output(name, b"metrics", file)
    assert file.read_bytes() == b"tracks"


def test_a_link_stays_and_what_it_leads_to_is_written(file: Path) -> None:
    link = file.with_name("latest.csv")
    link.symlink_to(file)
    write_output(link, b"one")
    write_output(link, b"two")
    assert link.is_symlink() and file.read_bytes() == b"two"


def test_only_regular_files_are_replaced(tmp_path: Path) -> None:
    pipe, circle = tmp_path / "pipe", tmp_path / "circle"
    os.mkfifo(pipe)
    circle.symlink_to(circle)
    ends = os.pipe()  # as /dev/stdout in front of another program
    for path in (Path("/dev/full"), pipe, Path(f"/dev/fd/{ends[1]}")):
        for write in (lambda path: write_output(path, b""), lambda path: replacing(path).__enter__()):
            with pytest.raises(ResultError, match="is no regular file"):
                write(path)
    for end in ends:
        os.close(end)
    with pytest.raises(ResultError, match="is a folder; give the name of a file"):
        check_output(tmp_path)
    with pytest.raises(ResultError, match="circle: cannot write"):
        check_output(circle)
    assert pipe.is_fifo() and Path("/dev/full").is_char_device()


def test_without_a_cache_nothing_that_exists_is_replaced(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null/nowhere")
    write_output(file, b"one")
    with pytest.raises(ResultError, match="not as scex-sumo wrote it"):
        write_output(file, b"two")
