"""Decision: P of a contact of each pair from human-like futures, and the verdict on a moment."""
