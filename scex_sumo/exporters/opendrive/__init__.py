"""OpenDRIVE: a road as reference lines, lanes with widths, links and junctions."""
