"""Closed loop: models plan, the world steps, and what is read back is measured."""
