"""Motion of an initiator and of those who respond: expected, played, and where it is blocked."""
