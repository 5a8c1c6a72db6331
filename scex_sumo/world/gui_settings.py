"""View settings of sumo-gui."""

from __future__ import annotations

from pathlib import Path

from scex_sumo.world.gui_drawings import Frame

WINDOW_SIZE = "1400,900"
_SIZE_PER_M = 10.0  # sumo-gui's text size for letters of 1 m
GRASS = "214,219,209"
ASPHALT = "74,78,84"
_JUNCTION = "80,84,90"
_ENTRY = '                <entry color="{}"{}/>'
_ROADS = (
    *("road", "sidewalk", "bike lane", "green verge", "waterway", "railway", "rails on road"),
    *("no passenger", "no road or rail", "crossing", "walkingarea"),
)
_JUNCTIONS = ("", ' name="waterway"', ' name="railway"', ' name="airway"')

_SETTINGS = """<viewsettings>
    <scheme name="scex-sumo">
        <opengl dither="0" fps="0" drawBoundaries="0"/>
        <background backgroundColor="{grass}" showGrid="0"/>
        <edges laneEdgeMode="0" laneShowBorders="0" showLinkDecals="0" showLinkRules="{lights}" showRails="0"
               hideConnectors="0" showDirection="0" showSublanes="0" showLaneDirection="0" minSize="0">
            <colorScheme name="uniform">
{roads}
            </colorScheme>
        </edges>
        <vehicles vehicleMode="0" vehicleQuality="2" vehicle_minSize="1"
                  vehicle_exaggeration="{exaggeration:.2f}" vehicle_constantSize="0" showBlinker="0"
                  drawMinGap="0" drawBrakeGap="0"
                  vehicleName_show="{names}" vehicleName_onlySelected="{chosen}"
                  vehicleName_size="{name_size}" vehicleName_color="20,22,26"
                  vehicleName_bgColor="255,255,255,200" vehicleName_constantSize="0"/>
        <persons personMode="0" personQuality="2" person_minSize="1" person_exaggeration="1"/>
        <junctions junctionMode="0" drawLinkTLIndex_show="0" drawLinkJunctionIndex_show="0" drawShape="1"
                   junctionName_show="0">
            <colorScheme name="uniform">
{junctions}
            </colorScheme>
        </junctions>
        <additionals addMode="0" addName_show="0"/>
        <pois poiMode="0" poi_minSize="0" poi_exaggeration="1" poiName_show="1"
              poiName_size="{text_size}" poiName_color="20,22,26" poiName_bgColor="{grass},170"
              poiName_constantSize="0"/>
        <polys polyMode="0" poly_minSize="0" polyName_show="0"/>
        <legend showSizeLegend="1" showColorLegend="0"/>
    </scheme>
    <delay value="{delay}"/>
{viewport}{snapshots}</viewsettings>
"""


def write_view_settings(
    path: Path,
    frame: Frame,
    *,
    letter_m: float = 0.0,
    chosen: bool = False,
    delay_ms: int = 100,
    snapshots: tuple[tuple[float, str], ...] = (),
    pause_s: float | None = None,
    lights: bool = False,
) -> None:
    """Write sumo-gui's view settings.

    Args:
        letter_m: height of vehicle ids; 0: no ids.
        chosen: ids of selected vehicles only.
        snapshots: times in s and file names.
        lights: show traffic lights, as bars at the ends of lanes.
    """
    pictures = "".join(f'    <snapshot file="{name}" time="{time:.2f}"/>\n' for time, name in snapshots)
    if pause_s is not None:
        pictures += f'    <breakpoint time="{pause_s:.2f}"/>\n'
    text = _SETTINGS.format(
        grass=GRASS,
        roads="\n".join(_ENTRY.format(ASPHALT, f' name="{kind}"') for kind in _ROADS),
        junctions="\n".join(_ENTRY.format(_JUNCTION, kind) for kind in _JUNCTIONS),
        names=int(letter_m > 0),
        chosen=int(chosen),
        lights=int(lights),
        name_size=f"{_SIZE_PER_M * letter_m:.2f}",
        text_size=f"{_SIZE_PER_M * frame.line_m:.2f}",
        delay=delay_ms,
        viewport='    <viewport zoom="{:.2f}" x="{:.2f}" y="{:.2f}" angle="0"/>\n'.format(*frame.viewport),
        exaggeration=frame.exaggeration,
        snapshots=pictures,
    )
    path.write_text(text, encoding="utf-8")
