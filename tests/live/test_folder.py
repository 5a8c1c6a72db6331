"""What is left of a watched simulation: the table, the page."""

from __future__ import annotations

from pathlib import Path

from scex_sumo.live.folder import command_of, worst_moments, write_page
from scex_sumo.live.risk import PairRisk, Risk


def risk(time_s: float, *pairs: tuple[str, str, float], vehicles: int = 4) -> Risk:
    found = [
        PairRisk(hits=a, other=b, kind="crossing", human_like=p, stress=0.5, how="b brakes", x=7.4, y=-3.0)
        for a, b, p in pairs
    ]
    return Risk(time_s=time_s, pairs=tuple(found), vehicles=tuple(map(str, range(vehicles))))


def test_the_page_has_the_worst_moments_with_their_commands(tmp_path: Path) -> None:
    risks = [risk(1.0), risk(2.5, ("a", "b<script>", 2e-4), vehicles=25)]
    page = write_page(tmp_path, Path("mine.sumocfg"), risks, "2 moments").read_text()
    assert "--region=7,-3,40" in page
    assert "<script>:" not in page and "once in 5\u202f000" in page
    words = command_of(Path("mine.sumocfg"), Path("out/watch"), *worst_moments(risks)[0])
    assert words == [
        *("run", "mine.sumocfg", "--time", "2.5", "--region=7,-3,40"),
        *("-o", "out/watch/moments/2.5"),
    ]
    assert "No moment was assessed" in write_page(tmp_path, Path("m.sumocfg"), [], "").read_text()
