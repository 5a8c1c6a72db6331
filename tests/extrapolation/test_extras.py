"""Extras of a run are loaded when they are on or have files to be read; what is off leaves no file behind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pytest

import scex_sumo as scex
from scex_sumo.extrapolation.settings import RunSettings
from tests.runs import extrapolate


@dataclass(frozen=True, kw_only=True)
class Note(scex.Extra):
    files: ClassVar[tuple[str, ...]] = ("note.txt", "notes")
    wanted: bool = True

    def is_on(self, settings: RunSettings) -> bool:
        return self.wanted

    def loaded(self) -> Note:
        return WrittenNote(**vars(self)) if self.wanted else pytest.fail("it is off")


class WrittenNote(Note):
    def after(self, work: scex.Work) -> Sequence[scex.Row]:
        (work.job.folder / "note.txt").write_text("here")
        (work.job.folder / "notes").mkdir(exist_ok=True)
        return ()


def test_an_extra_that_is_off_is_not_loaded_and_its_files_leave(tmp_path: Path) -> None:
    scene = scex.read_seed(scex.example_path("roundabout"))
    for wanted in (True, False):
        run = extrapolate(scene, futures=1, steps=1, world="plain", out=tmp_path, extra=[Note(wanted=wanted)])
        there = [(run.folder / name).exists() for name in Note.files]
        assert there == [wanted, wanted]
