"""Hundreds of futures of one moment of traffic, and how critical it can become.

The public names stand in ``__init__.pyi``; each is imported when it is first used.
"""

import lazy_loader

from scex_sumo.base.version import __version__ as __version__

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ += ["__version__"]
