"""Sample size: how many children a map needs, and its page."""
