"""``python -m scex_sumo``."""

from scex_sumo.cli import main

main()
