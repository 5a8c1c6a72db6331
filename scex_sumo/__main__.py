"""Start of the command line: ``scex-sumo`` and ``python -m scex_sumo``."""

import faulthandler


def start() -> None:
    """Run the command line; Ctrl-C while it is being loaded is no error."""
    faulthandler.enable()  # a driver that crashes the process leaves its line of Python
    try:
        from scex_sumo.cli import main
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    main()


if __name__ == "__main__":
    start()
