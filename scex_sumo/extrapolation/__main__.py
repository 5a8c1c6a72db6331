"""Start of a worker process: ``python -m scex_sumo.extrapolation`` does the tasks from standard input."""

import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).parents[2])  # the caller may have found the package on a path of its own
    from scex_sumo.extrapolation.process import serve

    serve()
