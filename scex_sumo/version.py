"""The version of the package; what depends on it needs nothing else of the package's face."""

__version__ = "0.1.0"
