"""Start of the command line: ``scex-sumo`` and ``python -m scex_sumo``."""

import atexit
import faulthandler
import os
import sys


def start() -> None:
    """Run the command line; Ctrl-C while it is being loaded is no error.

    The process ends without taking apart what it has loaded: that costs .1 s, and Arrow, interrupted while it
    imports pandas, aborts there. With code of others it ends as Python does, with their threads and files.
    """
    if sys.stderr is not None:  # closed by some schedulers
        faulthandler.enable()  # a driver that crashes the process leaves its line of Python
    try:
        from scex_sumo.base.importing import of_others
        from scex_sumo.cli import INTERRUPTED, main
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    try:
        main()
        status = 0
    except SystemExit as end:
        if not isinstance(end.code, int):
            raise
        status = end.code
    if of_others and status != INTERRUPTED:
        raise SystemExit(status)
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        if not stream.closed:
            stream.flush()
    os._exit(status)


if __name__ == "__main__":
    start()
