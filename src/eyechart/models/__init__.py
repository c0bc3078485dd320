"""Models that answer queries: one module an adapter, one door for all."""

from importlib import import_module
from typing import Protocol

from eyechart.calls import Query, Reply
from eyechart.errors import SpecError


class Model(Protocol):
    """The door to a model. ``version`` names what answered, for the scope of a verdict."""

    version: str

    async def answer(self, query: Query) -> Reply:
        """Answer one query. A failure is a Reply with its ``error`` kind; nothing is retried here."""
        ...


ADAPTERS: dict[str, str] = {
    "scripted": "eyechart.models.scripted",
}
"""What a SPEC's first word means; each module has ``open_model(name) -> Model`` and ``names() -> dict``."""


def open_model(spec: str) -> Model:
    """Open the model of a SPEC (``adapter:name``); raises SpecError that lists what is known."""
    adapter, colon, name = spec.partition(":")
    if not colon or adapter not in ADAPTERS:
        known = ", ".join(f"{known}:NAME" for known in ADAPTERS)
        raise SpecError(f"unknown model '{spec}'; a model is given as {known}, see 'eyechart list models'")
    model: Model = import_module(ADAPTERS[adapter]).open_model(name)
    return model
