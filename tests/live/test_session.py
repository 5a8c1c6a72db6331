"""A simulation that runs while it is watched."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from scex_sumo.base.errors import SimulationError
from scex_sumo.live import session


@pytest.mark.parametrize(("gui", "name"), [(False, "sumo"), (True, "sumo-gui")])
def test_a_sumo_of_the_users_own_needs_none_of_the_wheel(
    gui: bool, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(program: str) -> str:
        raise SimulationError(f"{program} is missing")

    def starts(_config: Path, _folder: Path, binary: str, _options: Any) -> list[str]:
        raise SimulationError(f"starts {binary}")

    own = tmp_path / "bin"
    for function, other in {
        "user_sumo": lambda: own / "sumo",
        "program": missing,
        "load_sumo": lambda gui: None,
        "options_of": lambda config: {},
        "private_options": starts,
        "_messages": lambda: nullcontext(list),
    }.items():
        monkeypatch.setattr(session, function, other)
    watched = session.Session(config=tmp_path / "a.sumocfg", out=tmp_path / "out", gui=gui)
    with pytest.raises(SimulationError, match=f"starts {own / name}$"):
        watched.run(lambda watch, receiver: None, lambda risk: None)
