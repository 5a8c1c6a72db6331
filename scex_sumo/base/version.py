"""Version of this package, and of installed ones."""

from importlib.metadata import version as version_of

__all__ = ["__version__", "version_of"]

__version__ = "0.1.0"
