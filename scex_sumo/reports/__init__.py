"""Reports: the answer of a run as a card, and tables for the terminal."""
