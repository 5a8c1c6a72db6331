"""Verdicts of a person: read as the page saves them, refused if they are something else."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.studies.rank.encounters import read_triage

HEAD = "recording,case,track_id,other_id,first_s,last_s,time_s,verdict,note\n"


def test_a_note_may_hold_commas_quotes_and_lines(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(HEAD + 'r,,1,2,1,2,1.5,test,"a, ""b""\nc"\n')
    (row,) = read_triage(tmp_path / "t.csv")
    assert (row["verdict"], row["note"]) == ("test", 'a, "b"\nc')


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,b\n1,2\n", "no recording"),
        (HEAD + "r,,1,2,1,2,1.5,perhaps,\n", "verdict 'perhaps'; known: test, discard, data error"),
        (HEAD + "r,,1,2,1,2,soon,test,\n", "time 'soon'"),
        (HEAD + "r,,1,2\n", "line 2: no time_s"),
    ],
)
def test_another_file_is_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(UsageError, match=words):
        read_triage(tmp_path / "t.csv")
