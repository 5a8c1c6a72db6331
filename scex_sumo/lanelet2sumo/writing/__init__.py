"""Text of a SUMO net and of its drawing."""
