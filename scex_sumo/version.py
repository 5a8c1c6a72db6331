"""The version of the package, and of others; what depends on it needs nothing else of the package's face."""

import re
from functools import cache

__version__ = "0.1.0"


@cache
def version_of(package: str) -> str:
    """Version of an installed package; to parse all that its metadata say takes five times as long."""
    from importlib.metadata import distribution

    found = distribution(package)
    line = re.search(r"^Version: *(\S+)", found.read_text("METADATA") or "", re.MULTILINE)
    return line[1] if line else found.version
