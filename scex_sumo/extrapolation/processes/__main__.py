"""Start of a worker process, which does the tasks from standard input."""

import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).parents[3])  # the caller may have found the package on a path of its own
    from scex_sumo.extrapolation.processes.process import serve

    serve()
