"""Finds a checkpoint, pins it to one commit or digest, and checks it before its weights load."""

import hashlib
import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from eyechart.errors import SpecError, raising
from eyechart.messages import Part, Turn
from eyechart.models import MEMORY_GB, WEIGHTS_GB
from eyechart.models.huggingface import organisms
from eyechart.models.huggingface import weights as huggingface_weights
from eyechart.models.huggingface.weights import LoadSettings, Weights, choose_loading, memory_gb, weigh, weights_by_type
from eyechart.modes import RequestMode

OPTIONS = {
    **huggingface_weights.OPTIONS,
    "revision": "a branch, tag or commit of the Hub, default main; the run records the commit",
    "trust_remote_code": "true runs code from the checkpoint's repository: read it first",
    "batch": "how many queries one generate may answer, default 32",
}
_BATCH = 32
_COMMIT = re.compile(r"[0-9a-f]{40}")
_HUB_ID = re.compile(r"[\w.-]+(/[\w.-]+)?")
_HUB_SECONDS = 15
_CHUNK = 1 << 20
_LACKS = re.compile(r"requires the (\w+) library but it was not found|Missing optional dependencies: (\w+)")
_IMAGE_TOKENS = ("image_token", "boi_token")
"""Attributes of Transformers' processors with the token that a template writes for a picture."""
_PRINTED = re.compile(r"""['"]type['"]\s*:\s*['"]image['"]""")
_UNREADABLE = (OSError, ValueError, ImportError, KeyError)
_ABOUT = frozenset({".md", ".lock"})
"""Suffixes of files that describe a checkpoint and are no part of it."""

SMALLER = "load it smaller with --option dtype=bfloat16 or bits=4, or spread it with device_map=auto"
"""Advice for weights that are too large for the memory."""

Processor = Any
"""A Transformers processor; the library gives it no narrower type."""


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint that exists, its processor, and the way to load it.

    ``place`` is a folder or a Hub id; ``commit`` is the Hub's, None for a folder.
    """

    place: str
    commit: str | None
    version: str
    processor: Processor
    loading: LoadSettings
    trust: bool
    batch: int
    facts: dict[str, str]


def list_edge() -> dict[str, str]:
    """Return the paper's edge models by Hub id, each with its size, memory and licence."""
    return {
        name: f"the paper's {facts['paper']}: {facts['parameters'] / 1e9:.2f} billion parameters, whose weights take "
        f"{_sizes(Weights(facts['parameters'], 2 * facts['parameters'], facts['linear']))}; licence {facts['license']}"
        + (f"; needs {', '.join(facts['needs'])}" if facts.get("needs") else "")
        for name, facts in edge_models().items()
    }


def edge_models() -> dict[str, Any]:
    """Return the table of the paper's edge models."""
    return tomllib.loads((Path(__file__).parent / "edge.toml").read_text(encoding="utf-8"))


def _sizes(weights: Weights) -> str:
    """Return the memory of weights in each precision, in words."""
    ways = {
        "GB in float32": LoadSettings("cpu", "float32"),
        "in float16": LoadSettings("cuda", "float16"),
        "in 8 bits": LoadSettings("cuda", "float16", bits=8),
        "in 4 bits": LoadSettings("cuda", "float16", bits=4),
    }
    return ", ".join(f"{how.gigabytes(weights):.1f} {words}" for words, how in ways.items())


def find(name: str, mode: RequestMode) -> Checkpoint:
    """Find a checkpoint and open its processor; raises SpecError, which says what is missing."""
    organism = organisms.folder(name.removeprefix("organism:")) if name.startswith("organism:") else None
    require_library()
    options = mode.options
    trust = options.get("trust_remote_code", False)
    batch = options.get("batch", _BATCH)
    if not isinstance(trust, bool) or not isinstance(batch, int) or isinstance(batch, bool) or batch < 1:
        raise SpecError(f"'{mode.spec}': trust_remote_code is true or false, and batch a whole number of at least 1")
    place, commit, weights = _locate(str(organism or name), str(options.get("revision", "main")))
    processor = _open_processor(place, commit, trust=trust)
    template = _require_image_slot(processor, mode.spec)
    how = choose_loading(mode, _open_config(place, commit, trust=trust))
    facts = {
        **how.facts(),
        "template": hashlib.sha256(template.encode()).hexdigest()[:12],
        "torch": version("torch"),
        "transformers": version("transformers"),
        **({"revision": commit} if commit else {}),
        **({"remote_code": "trusted"} if trust else {}),
        **_memory(how, weights),
    }
    answers = commit or f"sha256:{digest(Path(place))[:16]}"
    return Checkpoint(
        place=place,
        commit=commit,
        version=" ".join(filter(None, (answers, how.precision))),
        processor=processor,
        loading=how,
        trust=trust,
        batch=batch,
        facts=facts,
    )


def _memory(how: LoadSettings, weights: Weights | None) -> dict[str, str]:
    """Return the needed and available memory in 10^9 bytes, with a warning if it is too small."""
    if weights is None:
        return {}
    result = {"parameters": str(weights.parameters)}
    needed, there = how.gigabytes(weights), memory_gb(how)
    if needed is not None:
        result[WEIGHTS_GB] = f"{needed:.3g}"
    if there is not None:
        result[MEMORY_GB] = f"{there:.3g}"
    if needed is not None and there is not None and needed > there:
        result["warning"] = (
            f"its weights alone take {needed:.1f} GB as {how.precision or how.dtype}, the memory is {there:.1f} GB: "
            f"{SMALLER}"
        )
    return result


def require_library() -> None:
    """Raise SpecError without torch or Transformers; keep Transformers from printing."""
    try:
        version("torch")
        version("transformers")
    except PackageNotFoundError as error:
        raise SpecError(f"hf: needs {error.name}: pip install 'eyechart[transformers]'") from error
    from transformers.utils import logging  # noqa: PLC0415  (an extra)

    logging.set_verbosity_error()
    logging.disable_progress_bar()


def digest(folder: Path) -> str:
    """Return the SHA-256 of a folder's files, by name and content, without its descriptions."""
    whole = hashlib.sha256()
    for path in sorted(folder.iterdir()):
        if path.is_file() and path.suffix not in _ABOUT and not path.name.startswith("."):
            whole.update(f"{path.name}\0{path.stat().st_size}\0".encode())
            with path.open("rb") as file:
                while chunk := file.read(_CHUNK):
                    whole.update(chunk)
    return whole.hexdigest()


def _locate(name: str, revision: str) -> tuple[str, str | None, Weights | None]:
    """Return the folder, or the Hub id with its revision's commit, and the weights if known."""
    folder = Path(name).expanduser()
    if folder.is_dir():
        if not (folder / "config.json").is_file():
            raise SpecError(f"the folder {folder} holds no config.json, so it is no Transformers checkpoint")
        return str(folder.resolve()), None, weigh(folder)
    if not _HUB_ID.fullmatch(name):
        raise SpecError(f"'hf:{name}' is neither a folder here nor a Hub id such as OWNER/NAME")
    if _COMMIT.fullmatch(revision):
        return name, revision, None
    return name, *_pin(name, revision)


def _pin(name: str, revision: str) -> tuple[str, Weights | None]:
    """Return the commit of a revision, and the weights if known.

    Both come from the Hub, or from the cache where the Hub cannot be reached.
    """
    from huggingface_hub import HfApi, snapshot_download  # noqa: PLC0415  (an extra)
    from huggingface_hub.errors import GatedRepoError, RepositoryNotFoundError, RevisionNotFoundError  # noqa: PLC0415

    try:
        found = HfApi().model_info(name, revision=revision, timeout=_HUB_SECONDS)
    except GatedRepoError as error:
        raise SpecError(f"'{name}' is gated: ask for access on the Hub, then set HF_TOKEN") from error
    except RevisionNotFoundError as error:
        raise SpecError(f"'{name}' has no revision '{revision}' on the Hub") from error
    except RepositoryNotFoundError as error:
        raise SpecError(f"no model '{name}' on the Hub, and no folder of that name here") from error
    except Exception as error:  # noqa: BLE001 - the Hub is out of reach in many ways
        try:
            cached = Path(snapshot_download(name, revision=revision, local_files_only=True))
        except Exception:  # noqa: BLE001 - the reason to report is the Hub's failure
            what = type(error).__name__
            raise SpecError(f"the Hub cannot be reached ({what}) and '{name}' is not in the cache") from error
        return cached.name, weigh(cached)
    if not found.sha:
        raise SpecError(f"the Hub names no commit for '{name}' at revision '{revision}'")
    return str(found.sha), weights_by_type(found.safetensors.parameters) if found.safetensors else None


def _open_config(place: str, commit: str | None, *, trust: bool) -> dict[str, Any]:
    from transformers import AutoConfig  # noqa: PLC0415  (an extra)

    what = f"the configuration of '{place}' cannot be opened"
    with raising(SpecError, what, of=_UNREADABLE, words=huggingface_weights.first_line):
        config = AutoConfig.from_pretrained(place, revision=commit or "main", trust_remote_code=trust)
    result: dict[str, Any] = config.to_dict()
    return result


def _open_processor(place: str, commit: str | None, *, trust: bool) -> Processor:
    from transformers import AutoProcessor  # noqa: PLC0415  (an extra)

    try:
        return AutoProcessor.from_pretrained(place, revision=commit or "main", trust_remote_code=trust)
    except _UNREADABLE as error:
        line = huggingface_weights.first_line(error)
        if "trust_remote_code" in str(error):
            line = "it needs code from its repository: read that code, then give the option trust_remote_code=true"
        elif lacks := _LACKS.search(str(error)):
            package = (lacks[1] or lacks[2]).lower()
            line = f"it needs {package}: pip install {package}"
        raise SpecError(f"the processor of '{place}' cannot be opened: {line}") from error


def conversation(turns: Sequence[Turn]) -> list[dict[str, object]]:
    """Return messages for a chat template, with a mark in the place of each picture."""
    return [{"role": turn.role, "content": list(map(_content, turn.parts))} for turn in turns]


def _content(part: Part) -> dict[str, str]:
    return {"type": "text", "text": part} if isinstance(part, str) else {"type": "image"}


def _require_image_slot(processor: Processor, spec: str) -> str:
    """Return the chat template; raises SpecError where it has no place for a picture."""
    if getattr(processor, "image_processor", None) is None or getattr(processor, "tokenizer", None) is None:
        raise SpecError(f"'{spec}' takes only text: it has no image processor; use an image-text-to-text checkpoint")
    template = getattr(processor, "chat_template", None)
    if not template:
        raise SpecError(f"'{spec}' has no chat template, so it takes no prompt; use a checkpoint with one")
    with raising(
        SpecError, f"the chat template of '{spec}' takes no picture", of=Exception, words=huggingface_weights.first_line
    ):
        seen, unseen = (
            processor.apply_chat_template(
                conversation([Turn("user", parts)]), add_generation_prompt=True, tokenize=False
            )
            for parts in ((b"", "?"), ("?",))
        )
    if not _has_slot(processor, seen, unseen):
        raise SpecError(f"the chat template of '{spec}' has no image slot: the picture would never reach the model")
    return str(template)


def _has_slot(processor: Processor, seen: str, unseen: str) -> bool:
    """Return whether text rendered with a picture holds an image token, not just printed parts."""
    holders = (processor, processor.tokenizer)
    named = [getattr(holder, name, None) for holder in holders for name in _IMAGE_TOKENS]
    tokens = {token for one in named if (token := str(one or ""))}
    if tokens:
        return any(seen.count(token) > unseen.count(token) for token in tokens)
    return seen != unseen and not _PRINTED.search(seen)
