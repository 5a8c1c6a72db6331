"""Live: what could happen next in a SUMO simulation while it runs. A wing around the core."""
