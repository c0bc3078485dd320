"""eyechart finds out whether a vision-language controller's decisions come from its camera."""

from importlib.metadata import version

__version__ = version("eyechart")
