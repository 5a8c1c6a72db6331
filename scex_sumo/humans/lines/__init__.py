"""Lines that human-like drivers take: within wide lanes, to other lanes, off the map."""
