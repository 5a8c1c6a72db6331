"""Version of this package, and of installed ones."""

from functools import cache
from importlib.metadata import version

__version__ = "0.1.0"
version_of = cache(version)
