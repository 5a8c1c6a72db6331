"""Live window: what sumo-gui shows beside the vehicles of a run, with ``--gui``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from scex_sumo.base.colors import model_colors
from scex_sumo.world.drawings import LETTER_M, WINDOW_SIZE, draw_legend, frame_of, write_view_settings
from scex_sumo.world.tiles import TileLayout, TileTemplate


class Tiles(NamedTuple):
    """Tiles that a live window shows, with the drawing of the net, and the models that its legend names."""

    template: TileTemplate
    layout: TileLayout
    slots: Sequence[int]
    extras: Path | None
    models: Sequence[str]


def write_window(folder: Path, tiles: Tiles, *, delay_ms: int) -> tuple[list[Path], list[str]]:
    """Write markings, legend and view settings; return additional files and SUMO's options."""
    additional = []
    if tiles.extras is not None:
        additional.append(folder / "tiles.add.xml")
        TileTemplate(tiles.extras).write(additional[-1], tiles.slots, tiles.layout)
    bounds, offsets = tiles.template.bounds, [tiles.layout.offset(slot) for slot in tiles.slots]
    entries = list(zip(tiles.models, model_colors(tiles.models), strict=True))
    frame = frame_of(bounds, offsets, entries).on(bounds)
    additional.append(folder / "legend.add.xml")
    additional[-1].write_text(f"<additional>\n{draw_legend(frame)}</additional>\n", encoding="utf-8")
    letter_m = LETTER_M * frame.exaggeration if len(tiles.slots) == 1 else 0.0
    write_view_settings(folder / "view.xml", frame, letter_m=letter_m, delay_ms=delay_ms)
    return additional, ["--gui-settings-file", str(folder / "view.xml"), "--window-size", WINDOW_SIZE]
