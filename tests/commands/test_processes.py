"""Number of processes of studies: a number, or ``auto``."""

import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.commands import options
from scex_sumo.commands.options import processes


def test_auto_is_one_process_for_each_core(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(options, "cores", lambda: 6)
    assert [processes(text) for text in ("auto", "3")] == [6, 3]


def test_other_words_are_refused() -> None:
    with pytest.raises(UsageError, match="--workers many: needs a number or auto"):
        processes("many")
