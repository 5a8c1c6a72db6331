"""Charts as SVG, and figures of matplotlib."""
