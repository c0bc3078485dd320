"""eyechart finds out whether a vision-language controller's decisions come from its camera."""

__version__ = "0.2.0.dev0"


def __getattr__(name: str) -> object:
    """Return ``eyechart.look``, which is `eyechart.api.look`, once somebody asks for it: it is slow to import."""
    if name == "look":
        from eyechart.api import look  # noqa: PLC0415 - the version alone is to be had without it

        return look
    raise AttributeError(f"module 'eyechart' has no attribute '{name}'")
