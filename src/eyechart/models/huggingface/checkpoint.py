"""A checkpoint is found, pinned to one commit or digest, and checked, before a weight of it is loaded."""

import hashlib
import re
import tomllib
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from eyechart.errors import SpecError
from eyechart.models.huggingface import organisms
from eyechart.modes import RequestMode

OPTIONS = {
    "device": "cpu, cuda, cuda:1, mps; default: a GPU where there is one",
    "dtype": "float32, float16, bfloat16; default: float32 on a CPU, the checkpoint's own elsewhere",
    "revision": "a branch, tag or commit of the Hub; it is resolved to a commit, default main",
    "trust_remote_code": "true runs code from the checkpoint's repository: read it first",
    "batch": "how many queries one generate may answer, default 32",
}
_DTYPES = ("float32", "float16", "bfloat16")
_BATCH = 32
_COMMIT = re.compile(r"[0-9a-f]{40}")
_HUB_ID = re.compile(r"[\w.-]+(/[\w.-]+)?")
_HUB_SECONDS = 15
_CHUNK = 1 << 20
_IMAGE_TOKENS = ("image_token", "boi_token")
"""Where Transformers' processors keep the token that a template writes for a picture."""
_PRINTED = re.compile(r"""['"]type['"]\s*:\s*['"]image['"]""")
_ABOUT = frozenset({".md", ".lock"})
"""Files of these kinds say something about a checkpoint, and are no part of it."""

Processor = Any
"""A Transformers processor; the library is imported only here, and has no types that say more."""


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint that is there, its processor, and how it is to be loaded.

    ``place`` is a folder or a Hub id, ``commit`` that of the Hub or None for a folder.
    """

    place: str
    commit: str | None
    version: str
    processor: Processor
    device: str
    dtype: str
    trust: bool
    batch: int
    facts: dict[str, str]


def list_edge() -> dict[str, str]:
    """Return the paper's edge models by Hub id, with what to know of each."""
    table = tomllib.loads((Path(__file__).parent / "edge.toml").read_text(encoding="utf-8"))
    return {
        name: f"the paper's {facts['paper']}: {facts['parameters']} billion parameters, {facts['memory_gb']} GB in "
        f"float16, licence {facts['license']}" + (f"; needs {', '.join(facts['needs'])}" if facts.get("needs") else "")
        for name, facts in table.items()
    }


def find(name: str, mode: RequestMode) -> Checkpoint:
    """Find a checkpoint and open its processor; raises SpecError that says what is missing and what to do."""
    require_library()
    options = mode.options
    trust = options.get("trust_remote_code", False)
    batch = options.get("batch", _BATCH)
    if not isinstance(trust, bool) or not isinstance(batch, int) or isinstance(batch, bool) or batch < 1:
        raise SpecError(f"'{mode.spec}': trust_remote_code is true or false, and batch a whole number of at least 1")
    place, commit = _locate(name, str(options.get("revision", "main")))
    processor = _open_processor(place, commit, trust=trust)
    template = _require_image_slot(processor, mode.spec)
    device = _choose_device(str(options.get("device", "auto")), mode.spec)
    dtype = _choose_dtype(str(options.get("dtype", "auto")), device, mode.spec)
    facts = {
        "device": device,
        "dtype": dtype,
        "template": hashlib.sha256(template.encode()).hexdigest()[:12],
        "torch": version("torch"),
        "transformers": version("transformers"),
        **({"revision": commit} if commit else {}),
        **({"remote_code": "trusted"} if trust else {}),
    }
    return Checkpoint(
        place=place,
        commit=commit,
        version=commit or f"sha256:{digest(Path(place))[:16]}",
        processor=processor,
        device=device,
        dtype=dtype,
        trust=trust,
        batch=batch,
        facts=facts,
    )


def require_library() -> None:
    """Raise SpecError where torch or Transformers is not installed; keep Transformers from printing."""
    try:
        version("torch")
        version("transformers")
    except PackageNotFoundError as error:
        raise SpecError(f"hf: needs {error.name}: pip install 'eyechart[transformers]'") from error
    from transformers.utils import logging  # noqa: PLC0415  (an extra)

    logging.set_verbosity_error()
    logging.disable_progress_bar()


def digest(folder: Path) -> str:
    """Return the SHA-256 of a folder's files by name and content, what only speaks about them left out."""
    whole = hashlib.sha256()
    for path in sorted(folder.iterdir()):
        if path.is_file() and path.suffix not in _ABOUT and not path.name.startswith("."):
            whole.update(f"{path.name}\0{path.stat().st_size}\0".encode())
            with path.open("rb") as file:
                while chunk := file.read(_CHUNK):
                    whole.update(chunk)
    return whole.hexdigest()


def _locate(name: str, revision: str) -> tuple[str, str | None]:
    """Return the folder, or the Hub id with the commit that its revision stands for."""
    kind, colon, organism = name.partition(":")
    if colon and kind == "organism":
        return str(organisms.folder(organism)), None
    folder = Path(name).expanduser()
    if folder.is_dir():
        if not (folder / "config.json").is_file():
            raise SpecError(f"the folder {folder} holds no config.json, so it is no Transformers checkpoint")
        return str(folder.resolve()), None
    if not _HUB_ID.fullmatch(name):
        raise SpecError(f"'hf:{name}' is neither a folder here nor a Hub id such as OWNER/NAME")
    return name, revision if _COMMIT.fullmatch(revision) else _pin(name, revision)


def _pin(name: str, revision: str) -> str:
    """Return the commit that a revision stands for: the Hub's word, or, where it is out of reach, the cache's."""
    from huggingface_hub import HfApi, snapshot_download  # noqa: PLC0415  (an extra)
    from huggingface_hub.errors import GatedRepoError, RepositoryNotFoundError, RevisionNotFoundError  # noqa: PLC0415

    try:
        commit = HfApi().model_info(name, revision=revision, timeout=_HUB_SECONDS).sha
    except GatedRepoError as error:
        raise SpecError(f"'{name}' is gated: ask for access on the Hub, then set HF_TOKEN") from error
    except RevisionNotFoundError as error:
        raise SpecError(f"'{name}' has no revision '{revision}' on the Hub") from error
    except RepositoryNotFoundError as error:
        raise SpecError(f"no model '{name}' on the Hub, and no folder of that name here") from error
    except Exception as error:  # noqa: BLE001 - the Hub is out of reach in many ways
        try:
            return Path(snapshot_download(name, revision=revision, local_files_only=True)).name
        except Exception:  # noqa: BLE001 - whatever the cache lacks, the reason above is the one to tell
            what = type(error).__name__
            raise SpecError(f"the Hub cannot be reached ({what}) and '{name}' is not in the cache") from error
    if not commit:
        raise SpecError(f"the Hub names no commit for '{name}' at revision '{revision}'")
    return str(commit)


def _open_processor(place: str, commit: str | None, *, trust: bool) -> Processor:
    from transformers import AutoProcessor  # noqa: PLC0415  (an extra)

    try:
        return AutoProcessor.from_pretrained(place, revision=commit or "main", trust_remote_code=trust)
    except (OSError, ValueError, ImportError, KeyError) as error:
        line = first_line(error)
        if "trust_remote_code" in str(error):
            line = "it needs code from its repository: read that code, then give the option trust_remote_code=true"
        raise SpecError(f"the processor of '{place}' cannot be opened: {line}") from error


def first_line(error: BaseException) -> str:
    """Return an error's kind and the first line of what it says, at most 300 characters."""
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0] if lines else ''}"[:300]


def conversation(system: str, user: str, *, pictures: int) -> list[dict[str, object]]:
    """Return the messages of a query: the pictures stand before the words, as in the checkpoints' own examples."""
    messages: list[dict[str, object]] = []
    if system:
        messages.append({"role": "system", "content": [{"type": "text", "text": system}]})
    messages.append({"role": "user", "content": [{"type": "image"}] * pictures + [{"type": "text", "text": user}]})
    return messages


def _require_image_slot(processor: Processor, spec: str) -> str:
    """Return the chat template; raises SpecError where it has no place for a picture, so that none would be seen."""
    if getattr(processor, "image_processor", None) is None or getattr(processor, "tokenizer", None) is None:
        raise SpecError(f"'{spec}' takes words alone: it has no processor of pictures; take an image-text-to-text one")
    template = getattr(processor, "chat_template", None)
    if not template:
        raise SpecError(f"'{spec}' has no chat template, so it cannot be asked; take a checkpoint that has one")
    try:
        seen, unseen = (
            processor.apply_chat_template(
                conversation("", "?", pictures=picture), add_generation_prompt=True, tokenize=False
            )
            for picture in (1, 0)
        )
    except Exception as error:
        raise SpecError(f"the chat template of '{spec}' takes no picture: {first_line(error)}") from error
    if not _has_slot(processor, seen, unseen):
        raise SpecError(f"the chat template of '{spec}' has no image slot: the picture would never reach the model")
    return str(template)


def _has_slot(processor: Processor, seen: str, unseen: str) -> bool:
    """Return whether words rendered with a picture hold a token for it, and not just the printed list of parts."""
    holders = (processor, processor.tokenizer)
    named = [getattr(holder, name, None) for holder in holders for name in _IMAGE_TOKENS]
    tokens = {token for one in named if (token := str(one or ""))}
    if tokens:
        return any(seen.count(token) > unseen.count(token) for token in tokens)
    return seen != unseen and not _PRINTED.search(seen)


def _choose_device(wanted: str, spec: str) -> str:
    import torch  # noqa: PLC0415  (an extra)

    if wanted == "auto":
        if torch.cuda.is_available():
            return "cuda"
        return "mps" if torch.backends.mps.is_available() else "cpu"
    try:
        torch.empty(0, device=wanted)
    except Exception as error:
        raise SpecError(f"'{spec}': device '{wanted}' is not to be had here: {first_line(error)}") from error
    return wanted


def _choose_dtype(wanted: str, device: str, spec: str) -> str:
    """Return a name of torch's, or ``auto`` for the checkpoint's own."""
    if wanted == "auto":
        return "float32" if device == "cpu" else "auto"
    if wanted not in _DTYPES:
        raise SpecError(f"'{spec}': dtype is one of {', '.join(_DTYPES)}, not '{wanted}'")
    return wanted
