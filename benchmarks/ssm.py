"""Our following TTC, DRAC and PET beside those of SUMO's SSM device, on the same motion.

    python benchmarks/ssm.py OUT [--future N ...]

Replays futures of a result folder in SUMO, from the FCD that ``scex-sumo view`` writes, with the SSM device
on every vehicle, and evaluates the same futures along paths.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.evaluation.sources import read_source
from scex_sumo.evaluation.tables import recording_table

FOLLOWER, LEADER = 2, 3  # the SSM device's codes for what the ego is in an encounter
SETTLED_S = 0.25  # before, SUMO's own speed is that of the insertion, not of the motion
PRINTED = 0.005  # the device rounds to 0.01

Values = dict[tuple[str, int, int, int], float]


def replay(folder: Path, future: int, output: Path) -> None:
    """Run SUMO on one future's FCD with the SSM device."""
    tools = Path(sys.executable).parent
    view = [str(tools / "scex-sumo"), "view", str(folder), "--future", str(future), "--write-only"]
    configuration = Path(subprocess.run(view, check=True, capture_output=True, text=True).stdout.strip())
    options = {
        "probability": "1",
        "measures": "TTC DRAC PET",
        "thresholds": "1000 0 1000",
        "trajectories": "true",
        "range": "200",
        "file": str(output.resolve()),
    }
    command = [str(tools / "sumo"), "-c", configuration.name, "--end", "60"]
    command += [text for name, value in options.items() for text in (f"--device.ssm.{name}", value)]
    subprocess.run(command, check=True, cwd=configuration.parent, capture_output=True)


def numbers(conflict: ET.Element, tag: str) -> FloatArray:
    span = conflict.find(tag)
    text = "" if span is None else span.get("values", "")
    return np.array([np.nan if part == "NA" else float(part) for part in text.split()])


def device_values(output: Path) -> Values:
    """(metric, ms, follower, leader) of following encounters, and PET as ("pet", 0, ego, foe)."""
    values: Values = {}
    for conflict in ET.parse(output).getroot().iter("conflict"):
        names = conflict.get("ego", ""), conflict.get("foe", "")
        if not all(name.isdigit() for name in names):
            continue  # pedestrians and cyclists, which our metrics leave out
        ego, foe = int(names[0]), int(names[1])
        times, kinds = numbers(conflict, "timeSpan"), numbers(conflict, "typeSpan")
        for metric, tag in (("ttc", "TTCSpan"), ("drac", "DRACSpan")):
            for time, kind, value in zip(times, kinds, numbers(conflict, tag), strict=False):
                if kind in (FOLLOWER, LEADER) and time > SETTLED_S and np.isfinite(value):
                    pair = (ego, foe) if kind == FOLLOWER else (foe, ego)
                    values[(metric, round(time * 1000), *pair)] = value
        pet = conflict.find("PET")
        if pet is not None and pet.get("value") not in (None, "NA"):
            values[("pet", 0, ego, foe)] = float(pet.get("value", ""))
    return values


def our_values(folder: Path, future: int) -> Values:
    table, _ = read_source(folder)
    case = table.case(table.cases.index(str(future)))
    rows = recording_table(case, level="pair", metrics=("ttc_path", "drac", "pet")).to_pylist()
    values: Values = {}
    for row in rows:
        key = (row["metric"].removesuffix("_path"), row["timestamp_ms"], row["track_id"], row["other_id"])
        if row["metric"] == "pet":
            # The device gives one value per encounter: ours when both are still to come.
            key = ("pet", 0, row["track_id"], row["other_id"])
            values.setdefault(key, row["value"])
        else:
            values[key] = row["value"]
    return values


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--future", type=int, nargs="*", default=[0])
    options = parser.parse_args()
    pairs: dict[str, list[tuple[float, float]]] = {"ttc": [], "drac": [], "pet": []}
    only_device, only_ours, beyond = (dict.fromkeys(pairs, 0) for _ in range(3))
    for future in options.future:
        with tempfile.TemporaryDirectory() as temporary:
            output = Path(temporary) / "ssm.xml"
            replay(options.folder, future, output)
            theirs = device_values(output)
        ours = our_values(options.folder, future)
        led = {key[:3] for key in ours}
        for key, value in theirs.items():
            if key not in ours:
                only_device[key[0]] += 1
                # The device looks past the next vehicle at those ahead of it.
                beyond[key[0]] += key[:3] in led
            elif np.isfinite(ours[key]):
                pairs[key[0]].append((value, ours[key]))
        for key, value in ours.items():
            only_ours[key[0]] += key not in theirs and np.isfinite(value) and value > 0
    print("relative difference beyond the rounding to 0.01; (*) of these, we have a nearer leader")
    print("metric    both   median    95 %  only SSM     (*)  only ours")
    for metric, found in pairs.items():
        both = np.array(found).reshape(-1, 2)
        off = np.maximum(np.abs(both[:, 0] - both[:, 1]) - PRINTED, 0) / np.maximum(both[:, 0], PRINTED)
        median, most = np.quantile(off, [0.5, 0.95]) if len(both) else (np.nan, np.nan)
        print(
            f"{metric:6s}{len(both):8d}{median:9.4f}{most:8.4f}{only_device[metric]:10d}{beyond[metric]:8d}"
            f"{only_ours[metric]:11d}"
        )


if __name__ == "__main__":
    main()
