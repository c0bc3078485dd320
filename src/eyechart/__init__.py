"""eyechart finds out whether a vision-language controller's decisions come from its camera."""

__version__ = "0.2.0.dev0"


def __getattr__(name: str) -> object:
    """Return ``look`` or ``compare_prompts`` of `eyechart.api` on first use: import is slow."""
    if name in {"look", "compare_prompts"}:
        from eyechart import api  # noqa: PLC0415 - the version alone is to be had without it

        return {"look": api.look, "compare_prompts": api.compare_prompts}[name]
    raise AttributeError(f"module 'eyechart' has no attribute '{name}'")
