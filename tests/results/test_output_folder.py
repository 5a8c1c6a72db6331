"""A folder of ours goes on after damage; a folder of others is left alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.base.errors import ResultError
from scex_sumo.results.folder import ResultFolder

MINE = {"seed": 1}


@pytest.mark.parametrize("content", [None, b"", b"\xff\x00", b'{"identity"', b"[]", b"{}", b"[" * 10**5])
def test_an_interrupted_run_goes_on_where_one_file_of_its_identity_is_damaged(
    tmp_path: Path, content: bytes | None
) -> None:
    for name in ("incomplete.json", ".incomplete.json"):
        folder = ResultFolder(tmp_path / name, MINE)
        part = folder.path / ".parts" / "part"
        part.touch()
        if content is None:
            (folder.path / name).unlink()
        else:
            (folder.path / name).write_bytes(content)
        with pytest.raises(ResultError, match="another run"):
            ResultFolder(folder.path, {"seed": 2})
        ResultFolder(folder.path, MINE).finish({})
        assert sorted(file.name for file in folder.path.iterdir()) == ["run.json", "sumo"]


@pytest.mark.parametrize("content", [b"", b"{", b"null"])
def test_a_result_whose_run_json_is_damaged_is_run_again(tmp_path: Path, content: bytes) -> None:
    finished = ResultFolder(tmp_path, MINE)
    tables = [tmp_path / name for name in finished.evidence]
    for file in tables:
        file.touch()
    finished.finish({})
    (tmp_path / "run.json").write_bytes(content)
    ResultFolder(tmp_path, MINE)
    assert not any(file.exists() for file in tables)
