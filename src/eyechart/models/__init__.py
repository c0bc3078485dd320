"""Models that answer queries: one module an adapter, one door for all."""

import asyncio
import os
import time
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from importlib import import_module
from importlib.resources import files
from operator import attrgetter
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import urlsplit

from eyechart import __version__
from eyechart.calls import Query, Reply, bounded, invalid_field
from eyechart.errors import SpecError, did_you_mean
from eyechart.models.batches import raised
from eyechart.modes import RequestMode, each_without_secrets, read_mode


class Model(Protocol):
    """The door to a model.

    ``version`` identifies it: a verdict holds for one version, and a run is not resumed with
    another. ``facts`` are known without a call (digest, quantisation, template, revision). The fact
    `HISTORY` is the number of instants before a frame that it needs.
    """

    version: str
    facts: Mapping[str, str]

    async def answer(self, query: Query) -> Reply:
        """Answer one query. A failure is a Reply with its ``error`` kind; nothing is retried."""

    async def close(self) -> None:
        """Release sessions and weights, in the event loop of the calls.

        A closed model opens again at its next call. Closing twice is no error.
        """


@dataclass(frozen=True)
class OpenedModel:
    """An open model with the request mode of its calls, for models that no SPEC can name."""

    mode: RequestMode
    model: Model


ADAPTERS: dict[str, str] = {
    "scripted": "eyechart.models.scripted",
    "openai": "eyechart.models.openai_compatible",
    "ollama": "eyechart.models.ollama",
    "python": "eyechart.models.python_callable",
    "hf": "eyechart.models.huggingface",
}
"""The module of each adapter, by the first word of a SPEC.

Each module has ``open_model(name, mode) -> Model``, which makes no inference and loads no weights.
Its ``names() -> dict`` gives the names after the colon, each with a description.
"""


PAPER = Path(__file__).with_name("paper.toml")
"""The request modes of the paper's hosted and structured models; none was ever tried."""

HERE = "this machine"
LOCAL = ("hf", "ollama")
"""Adapters that load a model on one machine: this one, or that of the mode's ``base_url``."""

WEIGHTS_GB, MEMORY_GB = "weights_gb", "memory_gb"
"""Facts of a model, in 10^9 bytes: the size of its weights, and the memory that they load into."""

STATING = ("openai", "ollama", "hf")
"""Adapters of models whose answers are words; as policies they state a motion's numbers."""

HISTORY = "history"
"""The fact of a model that sees instants before a frame: how many, without the frame itself."""

POLICIES: dict[str, str] = {
    "python": "eyechart.models.policy_callable",
    "trained": "eyechart.models.trained",
    "lerobot": "eyechart.models.lerobot",
    **{name: ADAPTERS[name] for name in STATING},
}
"""The module of each adapter of policies; a policy is a model that answers with a motion."""


def open_model(spec: str, mode: RequestMode | None = None, *, answering: str = "model") -> Model:
    """Open the model of a SPEC (``adapter:name``) in a request mode, or in the default mode.

    ``answering`` is ``model``, or ``policy`` if it answers with a motion. Raises SpecError.
    """
    adapter, colon, name = spec.partition(":")
    adapters, listed = (POLICIES, "policies") if answering == "policy" else (ADAPTERS, "models")
    if not colon or not name or adapter not in adapters:
        known = ", ".join(f"{one}:{'MODULE:FUNCTION' if one == 'python' else 'NAME'}" for one in adapters)
        near = f" a name comes after '{adapter}:';" if adapter in adapters else did_you_mean(adapter, adapters)
        raise SpecError(
            f"unknown {answering} '{spec}';{near} a {answering} is given as {known}, see 'eyechart list {listed}'"
        )
    if mode is not None and mode.spec != spec:
        raise SpecError(f"the mode of '{mode.spec}' is not one of '{spec}'")
    model: Model = import_module(adapters[adapter]).open_model(name, mode or RequestMode(spec))
    return model


def open_policy(policy: str | RequestMode | OpenedModel, timeout_s: float | None = None) -> OpenedModel:
    """Open the policy of a SPEC with a time limit in seconds, or of a mode; return an open one.

    Raises SpecError for an unknown one, or a mode that a policy without words cannot be asked in.
    """
    if isinstance(policy, OpenedModel):
        return policy
    mode = policy if isinstance(policy, RequestMode) else policy_mode(policy, timeout_s)
    usual = policy_mode(mode.spec, mode.timeout_s)
    if not states(mode.spec) and mode != usual:
        names = [one.name for one in fields(mode) if getattr(mode, one.name) != getattr(usual, one.name)]
        own = "; --lerobot-python, or EYECHART_LEROBOT_PYTHON, names its Python" * mode.spec.startswith("lerobot:")
        raise SpecError(f"{', '.join(names)} would not change '{mode.spec}', which is called here: leave it out{own}")
    return OpenedModel(mode, open_model(mode.spec, mode, answering="policy"))


def states(spec: str) -> bool:
    """Return whether the policy of a SPEC states its motions in words, and needs a prompt."""
    return spec.partition(":")[0] in STATING


def history_of(facts: Mapping[str, str]) -> int:
    """Return how many instants before a frame a model with these facts needs; 0 without the fact."""
    return int(facts.get(HISTORY, "0"))


def policy_mode(spec: str, timeout_s: float | None = None) -> RequestMode:
    """Return the request mode of a policy, with the default time limit where none is given."""
    return RequestMode(spec) if timeout_s is None else RequestMode(spec, timeout_s=timeout_s)


def organisms_folder(need: str, also: str = "") -> Path:
    """Return the folder of the package ``eyechart_organisms``, with the organisms' weights.

    Raises SpecError where the package is missing or has another version. The error says what to
    install for ``need``; ``also`` names another extra that it needs.
    """
    extras, local = (f"organisms,{also}", f"'.[{also}]' ./organisms") if also else ("organisms", "./organisms")
    try:
        import eyechart_organisms  # noqa: PLC0415 - it is a distribution of its own
    except ModuleNotFoundError as error:
        raise SpecError(
            f"{need} needs eyechart-organisms: pip install 'eyechart[{extras}]' (in a checkout: pip install {local})"
        ) from error
    if eyechart_organisms.__version__ != __version__:
        raise SpecError(
            f"{need} needs eyechart-organisms {__version__}, and {eyechart_organisms.__version__} is installed: "
            f"pip install 'eyechart[{extras}]=={__version__}'"
        )
    return Path(str(files(eyechart_organisms)))


def machine_of(mode: RequestMode) -> str:
    """Return the name of the machine that holds a model's weights; "" if that does not matter."""
    if mode.spec.partition(":")[0] not in LOCAL:
        return ""
    if not mode.base_url:
        return HERE
    from eyechart.models.http import is_loopback  # noqa: PLC0415 - it needs a client of HTTP

    return HERE if is_loopback(mode.base_url) else str(urlsplit(mode.base_url).hostname)


def memory_here_gb() -> float | None:
    """Return this machine's main memory in 10^9 bytes; None if the system does not report it."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    except (AttributeError, ValueError, OSError):  # not on Windows
        return None


def sequential_groups(modes: Iterable[RequestMode], *, sequential: bool | None = None) -> tuple[tuple[str, ...], ...]:
    """Return the models in groups that run in parallel; in a group each closes before the next.

    By default the models of one machine share a group, and every other model has its own.
    ``sequential`` True makes one group of all; False gives each model its own.
    """
    turns: dict[object, tuple[str, ...]] = {}
    for mode in modes:
        machine = machine_of(mode) if sequential is None else HERE if sequential else ""
        turn = machine or (mode.spec,)
        turns[turn] = (*turns.get(turn, ()), mode.spec)
    return tuple(turns.values())


async def ask(model: Model, query: Query) -> Reply:
    """Return a model's timed reply to one query; an adapter's exception becomes a failed Reply."""
    start = time.perf_counter()
    try:
        reply = await model.answer(query)
        if not isinstance(reply, Reply):
            raise TypeError(f"the model answered with a {type(reply).__name__}, not with a Reply")  # noqa: TRY301
        reply = _in_one_line(cleaned(bounded(reply)))
        if wrong := invalid_field(reply):
            raise TypeError(f"the model's Reply cannot be kept: {wrong}")  # noqa: TRY301
    except asyncio.CancelledError:
        task = asyncio.current_task()
        if task is None or task.cancelling():
            raise
        # The adapter cancelled its own request. Raised here, it would silently end a worker.
        reply = Reply(error="exception", error_detail="CancelledError: the adapter cancelled its own request")
    except Exception as error:  # noqa: BLE001 - it is a row, not the end of the run
        reply = raised(error, 2000)
    seconds = time.perf_counter() - start
    return reply if reply.seconds is not None else replace(reply, seconds=seconds)


_SAID = tuple(one.name for one in fields(Reply) if one.type in {str, str | None} and one.name != "payload_sha256")
"""The fields of a reply that may hold words of others; `invalid_field` lets only a digest be the other."""
_words = attrgetter(*_SAID)


def _in_one_line(reply: Reply) -> Reply:
    """Return a reply whose error is told in one line: screens and pages have a line for it."""
    line = " ".join(str(reply.error_detail).split())
    return reply if line == reply.error_detail else replace(reply, error_detail=line)


def cleaned(reply: Reply) -> Reply:
    """Return a reply without the values of environment variables that are keys by their names."""
    texts = {name: text for name, text in zip(_SAID, _words(reply), strict=True) if text and isinstance(text, str)}
    found: dict[str, Any] = each_without_secrets(texts)
    return replace(reply, **found) if found != texts else reply


def known_models(adapters: Mapping[str, str] = ADAPTERS) -> dict[str, str]:
    """Return every SPEC of the adapters with a description; those to fill in come first."""
    found = [(one, *said) for one, module in adapters.items() for said in import_module(module).names().items()]
    return {f"{one}:{name}": says for one, name, says in sorted(found, key=lambda named: not named[1].isupper())}


def known_modes() -> dict[str, RequestMode]:
    """Return the request modes that come with eyechart, by the names that ``--mode`` takes."""
    return {name: RequestMode.from_dict(said, name) for name, said in tomllib.loads(PAPER.read_text("utf-8")).items()}


def find_mode(given: Path) -> RequestMode:
    """Return the request mode of a file, or of a name of `known_modes`.

    Raises SpecError where there is neither, or where a mode of eyechart names no server.
    """
    if given.suffix == ".toml" or given.exists():
        return read_mode(given)
    name, modes = str(given), known_modes()
    if name not in modes:
        raise SpecError(
            f"no request mode '{name}';{did_you_mean(name, modes)} give FILE.toml, or see 'eyechart list modes'"
        )
    mode = modes[name]
    if mode.spec.startswith("openai:") and not mode.base_url:
        raise SpecError(
            f"the mode '{name}' names no server, because the paper names none. Write it to a file with 'eyechart list "
            f"modes {name} > mode.toml', add base_url and the server's name for the model, and give --mode mode.toml"
        )
    return mode


def require_lerobot(specs: Iterable[str], python: Path | None) -> None:
    """Raise SpecError for a Python of LeRobot that none of some SPECs would be asked by."""
    named = list(specs)
    if python is not None and not any(spec.startswith("lerobot:") for spec in named):
        said = ", ".join(f"'{spec}'" for spec in named)
        raise SpecError(f"--lerobot-python is for a lerobot: SPEC, and {said} runs without it: leave the option out")


def require_options(mode: RequestMode, known: Mapping[str, str]) -> None:
    """Raise SpecError for an option that the adapter does not know, or a body with messages."""
    if "messages" in mode.body:
        raise SpecError(
            f"the body of '{mode.spec}' names messages, which hold the prompt and the picture: leave them out"
        )
    for name in mode.options:
        if name not in known:
            there = "; ".join(f"{option}: {says}" for option, says in known.items()) or "none"
            raise SpecError(
                f"'{mode.spec}' has no option '{name}';{did_you_mean(name, known)} its options are: {there}"
            )
