"""eyechart finds out whether a vision-language controller's decisions come from its camera."""

__version__ = "0.2.0.dev0"
