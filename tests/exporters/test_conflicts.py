"""Conflicts and collisions beside what SUMO itself writes about the same motion."""

from __future__ import annotations

import subprocess
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import sumolib

from scex_sumo.base.sumo.programs import environment, program, sumo_home
from scex_sumo.exporters.request import EXPORTERS, Request
from scex_sumo.results.run import Run
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed
from scex_sumo.views.futures import write_future
from tests.runs import extrapolate
from tests.seeds import seed_of, steady


def exported(run: Run, to: str, folder: Path, futures: tuple[int, ...] = (0, 1, 2, 3)) -> list[Path]:
    return list(EXPORTERS.load(to)(Request(run=run, futures=futures, out=folder)))


def device(run: Run, future: int, file: Path) -> ET.Element:
    """Conflicts of SUMO's own device on the replay of a future."""
    config = write_future(run, future)
    options = {"probability": "1", "measures": "TTC DRAC PET", "thresholds": "3 3 2", "file": str(file)}
    options["range"] = "200"
    words = [word for name, value in options.items() for word in (f"--device.ssm.{name}", value)]
    command = [program("sumo"), "-c", config.name, "--end", "4.05", *words]
    subprocess.run(command, check=True, cwd=config.parent, capture_output=True, env=environment())
    return ET.parse(file).getroot()


def number(element: ET.Element, tag: str, name: str = "value") -> float:
    text = element.find(tag).get(name)  # type: ignore[union-attr]
    return np.nan if text in (None, "NA") else float(text)


def test_conflicts_have_the_form_and_the_values_of_sumo_s_device(run: Run, tmp_path: Path) -> None:
    files, off, forms = exported(run, "ssm", tmp_path / "ours"), [], set()
    for future, file in enumerate(files):
        ours, theirs = ET.parse(file).getroot(), device(run, future, tmp_path / f"{future}.xml")
        for conflict in (*theirs, *ours):
            forms.add(repr([(element.tag, list(element.attrib)) for element in conflict.iter()]))
        assert ours.tag == theirs.tag
        own = {(c.get("ego"), c.get("foe")): c for c in ours}
        assert len({frozenset(pair) for pair in own}) == len(own) == len(ours)  # each pair once
        for conflict in theirs:
            mine = own.get((conflict.get("ego"), conflict.get("foe")))
            if mine is not None and kind_of(mine) == kind_of(conflict):
                off.append([number(mine, *of) - number(conflict, *of) for of in COMPARED])
    values = np.abs(off)
    assert len(values) >= 3 and len(forms) == 1
    assert (np.median(values, axis=0) < [0.02, 0.11, 0.5, 0.1]).all(), values


COMPARED = (("minTTC", "value"), ("minTTC", "time"), ("minTTC", "speed"), ("maxDRAC", "value"))


def kind_of(conflict: ET.Element) -> str | None:
    found = conflict.find("minTTC")
    return None if found is None else found.get("type")


def test_collisions_fit_sumo_s_schema_and_the_table(run: Run, tmp_path: Path) -> None:
    etree = pytest.importorskip("lxml.etree")
    schema = etree.XMLSchema(etree.parse(str(sumo_home() / "data" / "xsd" / "collision_file.xsd")))
    count = 0
    for future, file in enumerate(exported(run, "collisions", tmp_path)):
        schema.assertValid(etree.parse(str(file)))
        rows = [row for row in run.collisions.to_pylist() if row["future"] == future]
        written = list(sumolib.xml.parse(str(file), "collision"))
        assert len(written) == len(rows)
        for row, collision in zip(rows, written, strict=True):
            assert {int(collision.collider), int(collision.victim)} == {row["track_id"], row["other_id"]}
            assert float(collision.time) == pytest.approx(1.0 + row["time_s"], abs=0.006)
            assert sumolib.net.readNet(str(run.net.path), withInternal=True).getLane(collision.lane)
        count += len(rows)
    assert count


def test_pet_of_a_right_angle_is_that_of_the_second_vehicle(tmp_path: Path) -> None:
    road = read_seed(example_path("roundabout")).road
    history = steady((-20.0, 0.0, 0.0, 10.0), (0.0, -30.0, np.pi / 2, 10.0))
    scene = seed_of(history, track_ids=np.arange(2), road=road)
    run = extrapolate(scene, models="constant_velocity", futures=1, steps=40, out=tmp_path / "run")
    (file,) = exported(run, "ssm", tmp_path / "pet.ssm.xml", futures=(0,))
    (conflict,) = ET.parse(file).getroot()
    assert (conflict.get("ego"), conflict.get("foe")) == ("1", "0")
    pet = conflict.find("PET")
    assert pet is not None and pet.get("type") == "17"
    # Areas reach half of both widths and half a length from the crossing: 0.9 + 2.25 m.
    assert number(conflict, "PET") == pytest.approx((30 - 3.15) / 10 - (20 + 3.15) / 10, abs=0.01)
    assert number(conflict, "PET", "time") == pytest.approx(1.0 + (30 - 2.25) / 10, abs=0.06)
    assert pet.get("position") == "0.00,0.00" and number(conflict, "PET", "speed") == 10.0
