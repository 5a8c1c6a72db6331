"""Recordings in a CSV of their own: seconds, feet, miles an hour, degrees clockwise from north."""

import csv

import numpy as np

import scex_sumo as scex

FOOT_M, MPH_MPS, STEP_S = 0.3048, 0.44704, 0.1
COLUMNS = [
    "Vehicle",
    "Class",
    "Seconds",
    "East_ft",
    "North_ft",
    "Heading_deg",
    "Speed_mph",
    "Length_ft",
    "Width_ft",
]
KINDS = {"PC": "car", "HGV": "truck", "MC": "motorcycle"}


def is_mine(path):
    if path.suffix != ".csv" or not path.is_file():
        return False
    with path.open(encoding="utf-8", errors="replace") as file:
        return file.readline().strip().split(",") == COLUMNS


def recordings(files):
    """Of each file, with the map beside it."""
    for path in files:
        for map_path in sorted(path.parent.glob("*.street.json"))[:1]:
            yield scex.Recording(
                name=path.stem, site=map_path.stem, dataset="street", map_path=map_path, track_paths=(path,)
            )


def read(paths, **options):
    (path,) = paths
    with path.open(encoding="utf-8", newline="") as file:
        samples = list(csv.DictReader(file))
    samples.sort(key=lambda row: (row["Vehicle"], float(row["Seconds"])))
    known = [row for row in samples if row["Class"] in KINDS]
    column = {name: np.array([float(row[name]) for row in known]) for name in COLUMNS[2:]}
    labels, first, track = np.unique(
        [row["Vehicle"] for row in known], return_index=True, return_inverse=True
    )
    heading = np.pi / 2 - np.deg2rad(column["Heading_deg"])  # 0 along x, counter-clockwise
    speed = column["Speed_mph"] * MPH_MPS
    rows = scex.track_rows(
        track,
        [str(label) for label in labels],  # of vehicles: whole numbers
        [KINDS[known[at]["Class"]] for at in first],
        timestamp_ms=1000.0 * column["Seconds"],
        x=column["East_ft"] * FOOT_M,
        y=column["North_ft"] * FOOT_M,
        vx=speed * np.cos(heading),
        vy=speed * np.sin(heading),
        psi_rad=np.arctan2(np.sin(heading), np.cos(heading)),
        length=column["Length_ft"] * FOOT_M,
        width=column["Width_ft"] * FOOT_M,
    )
    nobody = rows.take(np.zeros(len(rows), dtype=bool))
    left_out = len(samples) - len(known)
    notes = (f"{left_out} samples of unknown classes left out",) if left_out else ()
    return scex.TrackTable(path=path, cases=("",), vehicles=rows, others=nobody, step_s=STEP_S), notes
