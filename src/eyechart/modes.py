"""Request modes: the address, token budget and format of a model's calls, in one small TOML file.

A mode never holds a secret: a header names an environment variable as ``$NAME``.
"""

import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, cast
from urllib.parse import parse_qsl, unquote, urlsplit, urlunsplit

import msgspec
import tomli_w

from eyechart.errors import SecretError, SpecError, did_you_mean, raising, suggestion
from eyechart.keys import SHORTEST, is_beside_a_variable, looks_like_a_key, names_a_hash, names_a_key, without_keys
from eyechart.records import LARGEST, parse_json
from eyechart.spaces.discrete import read_toml

Scalar = str | int | float | bool
TokenField = Literal["max_tokens", "max_completion_tokens"]

TOKEN_FIELDS = ("max_tokens", "max_completion_tokens")
STRUCTURED = ("none", "json_object", "json_schema", "tool_call")
ROLES = ("system", "user")
ANSWERS = ("text", "reasoning")
STREAMS = ("none", "usage", "plain")
DEFAULT = "default"
"""The value of a file or option for no temperature: the endpoint's own applies."""

ELSEWHERE = "elsewhere"
"""The first word of the SPEC of imported answers (docs/decisions/bundles.md)."""

_LONG_HEX = 48
"""Hashes shorter than this in an address name an account or a deployment."""
_NO_KEY = "an id or a digest needs a name that says so, as request_id or revision"

_ADDRESS = ("base_url", "query", "key_env", "headers", "timeout_s")
"""Fields of a mode for the address and the time limit, which do not change the request itself."""

LEFT_OUT = "left_out"
"""The entry of ``about`` that names fields of a recorded mode that were not read."""

ALONE = "repeats alone"
"""The fact of a probe that counts equal single repeats at temperature 0, as ``5 of 5``."""

FEWEST_TOKENS = 16
"""The least tokens of a picture: fewer may be the placeholder of a dropped one."""

_VARIABLE = re.compile(r"\$(?:([A-Za-z_]\w*)|\{([A-Za-z_]\w*)\})")
_SECRET_VARIABLE = re.compile(r"KEY|TOKEN|SECRET|PASSWORD|CREDENTIAL", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class ModeMeasurements:
    """A probe's measurements of a model in its mode; None means not measured.

    ``prompt_tokens`` and ``image_tokens`` are those of one call, and of its picture alone.
    ``completion_tokens`` and ``reasoning_tokens`` are means over replies; ``completion_tokens_max``
    is that of the longest complete reply. ``seconds`` is the median of a call, and ``seconds_min``
    the shortest. ``facts`` identify the model: digest, quantisation, template, provider.
    """

    date: str = ""
    calls: int | None = None
    sees_image: bool | None = None
    image_tokens: int | None = None
    prompt_tokens: int | None = None
    completion_tokens: float | None = None
    completion_tokens_max: int | None = None
    reasoning_tokens: float | None = None
    seconds: float | None = None
    seconds_min: float | None = None
    schema_binds: bool | None = None
    temperature_matters: bool | None = None
    seed_matters: bool | None = None
    unknown_fields_ignored: bool | None = None
    facts: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _require(self, _MEASURED, "[measured]")


@dataclass(frozen=True, slots=True)
class RequestMode:
    """The request mode of one model. Raises SpecError for a wrong value, or one with a secret.

    ``query`` is appended to the address, as Azure's ``api-version``; a query in ``base_url`` moves
    there. ``base_url`` and ``key_env`` (the name of the variable with the key) are the adapter's
    own where empty. ``max_tokens`` is the budget of a reply, sent as ``token_field``.
    ``temperature`` None sends none. ``seed`` says whether the call's seed is sent. ``system`` is
    the role of the prompt's system text: ``user`` puts it before the user's own, for servers that
    refuse the role. ``answer`` is the place of the answer: ``reasoning`` reads the end of the
    reasoning, if the text is empty. ``stream`` requests the reply in pieces; ``usage`` also its
    tokens. ``body`` is merged into the request, and ``options`` are the adapter's own. ``about``
    describes the origin of the mode, and changes nothing.
    """

    spec: str
    base_url: str = ""
    query: Mapping[str, str] = field(default_factory=dict)
    key_env: str = ""
    token_field: TokenField = "max_tokens"  # noqa: S105 - the name of a field
    max_tokens: int = 1024
    structured: Literal["none", "json_object", "json_schema", "tool_call"] = "none"
    temperature: float | None = 0.0
    seed: bool = False
    timeout_s: float = 120.0
    headers: Mapping[str, str] = field(default_factory=dict)
    body: Mapping[str, object] = field(default_factory=dict)
    options: Mapping[str, Scalar] = field(default_factory=dict)
    system: Literal["system", "user"] = "system"
    answer: Literal["text", "reasoning"] = "text"
    stream: Literal["none", "usage", "plain"] = "none"
    measured: ModeMeasurements | None = None
    about: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _require(self, _MODE, f"the mode of {self.spec!r}")
        if "?" in self.base_url:
            base_url, query = _without_query(self.base_url)
            object.__setattr__(self, "base_url", base_url)
            object.__setattr__(self, "query", {**self.query, **query})
        _refuse_secrets(self)

    def is_same_request(self, other: "RequestMode") -> bool:
        """Return whether two modes send equal requests; measurements and ``about`` do not count."""
        return self.request() == other.request()

    def request(self) -> "RequestMode":
        """Return this mode without its measurements and ``about``, with its address in plain form.

        The names of fields that were not read stay, since their values are unknown.
        """
        about = {LEFT_OUT: self.about[LEFT_OUT]} if LEFT_OUT in self.about else {}
        return replace(self, measured=None, about=about, base_url=plain_address(self.base_url))

    def moved_to(self, other: "RequestMode") -> "RequestMode":
        """Return this mode with the address, key, headers and time limit of another one."""
        return replace(self, **{name: getattr(other, name) for name in _ADDRESS})

    def differs_in_address_only(self, other: "RequestMode") -> bool:
        """Return whether two modes differ at most in address, key, headers and time limit."""
        return self.moved_to(other).is_same_request(other)

    def header_values(self, environ: Mapping[str, str] | None = None) -> dict[str, str]:
        """Return the headers with their variables filled in; raises SpecError for a missing one."""
        known = os.environ if environ is None else environ
        return {name: _expand(name, value, known) for name, value in self.headers.items()}

    def as_dict(self) -> dict[str, object]:
        """Return plain values for JSON or TOML, without defaults and with variables unexpanded."""
        plain = {name: value for name, value in asdict(self).items() if value != _DEFAULTS.get(name)}
        if self.temperature is None:
            plain["temperature"] = DEFAULT
        if self.measured is not None:
            found = asdict(self.measured)
            plain["measured"] = {name: value for name, value in found.items() if value not in (None, "", {})}
        return plain

    @classmethod
    def from_dict(cls, values: Mapping[str, object], where: str = "a mode") -> "RequestMode":
        """Build a mode from plain values; raises SpecError, which names ``where`` and the fault."""
        raw = dict(values)
        _refuse_unknown(raw, cls, where)
        if not isinstance(raw.get("spec"), str):
            raise SpecError(f'{where}: no spec; write for example spec = "openai:MODEL"')
        if raw.get("temperature") == DEFAULT:
            raw["temperature"] = None
        elif "temperature" in raw and raw["temperature"] is None:
            raise SpecError(f"{where}: temperature must be {_MODE['temperature'][1]}")
        with raising(SpecError, where, of=SpecError):
            if "measured" in raw:
                measured = raw["measured"]
                if not isinstance(measured, Mapping):
                    raise SpecError("measured must be a table: [measured]")
                _refuse_unknown(measured, ModeMeasurements, "[measured]")
                raw["measured"] = ModeMeasurements(**measured)
            return cls(**cast("dict[str, str]", raw))  # type: ignore[arg-type]

    @classmethod
    def recorded(cls, values: Mapping[str, object], where: str) -> "RequestMode":
        """Build a mode from a run's record, also if it holds a secret by newer rules.

        That field is left out, and ``about`` names it, so the mode equals no other one. Raises
        SpecError as ``from_dict`` does for anything else.
        """
        raw, left = dict(values), []
        for part in ("query", "headers", "body", "options", "about"):
            kept = raw.get(part)
            if isinstance(kept, Mapping):
                held = [name for name, value in kept.items() if cls._holds_secret(**{part: {name: value}})]
                raw[part] = {name: value for name, value in kept.items() if name not in held}
                left += [part] * bool(held)
        if cls._holds_secret(base_url=raw.get("base_url", "")):
            parts = urlsplit(str(raw["base_url"]))
            raw["base_url"] = f"{parts.scheme}://{parts.hostname}"
            left.append("base_url")
        if cls._holds_secret(key_env=raw.get("key_env", "")):
            del raw["key_env"]
            left.append("key_env")
        if left:
            raw["about"] = {
                **cast("dict[str, str]", raw.get("about", {})),
                "left_out": f"a secret of {', '.join(left)}",
            }
        return cls.from_dict(raw, where)

    @classmethod
    def _holds_secret(cls, **parts: object) -> bool:
        try:
            cls("m", **parts)  # type: ignore[arg-type]
        except SecretError:
            return True
        except SpecError:
            return False
        return False


def is_made_elsewhere(spec: str) -> bool:
    """Return whether the answers of a SPEC were imported, so nothing is known of its calls."""
    return spec.startswith(f"{ELSEWHERE}:")


def read_mode(path: Path) -> RequestMode:
    """Read a mode from its TOML file; raises SpecError, which names the file and the fault."""
    return RequestMode.from_dict(read_toml(path), str(path))


def mode_of(spec: str, given: Mapping[str, object]) -> RequestMode:
    """Return a SPEC's request mode with these fields; raises SpecError that names a wrong one."""
    return RequestMode.from_dict({"spec": spec, **given}, f"the options of {without_secrets(spec)}")


_FIELDS = {"timeout": "timeout_s", "header": "headers", "option": "options", "json_mode": "structured"}
"""A field's name, where an option of the command has another."""


def fields_in_words(given: Mapping[str, Any]) -> dict[str, object]:
    """Return the fields that a command's options set, by the options' names; None sets no field.

    Raises SpecError for a wrong pair.
    """
    temperature = given["temperature"]
    found = {
        **given,
        "temperature": None if temperature is None else _number(temperature),
        "header": _pairs(given["header"], ":", "--header 'NAME: VALUE'"),
        "body": _pairs(given["body"], "=", "--body KEY=JSON", _json),
        "option": _pairs(given["option"], "=", "--option KEY=VALUE", _scalar),
    }
    return {_FIELDS.get(name, name): value for name, value in found.items() if value is not None}


def _number(text: str) -> object:
    try:
        return float(text)
    except ValueError:
        return text


def _pairs(
    given: Sequence[str] | None, sign: str, form: str, read: Callable[[str], object] = str
) -> dict[str, object] | None:
    pairs = {}
    for text in given or ():
        name, found, value = text.partition(sign)
        if not found or not name.strip():
            # Only its start is quoted: it may be a secret.
            raise SpecError(f"this is given as {form}; got '{name[:8]}'{'…' * (len(name) > 8)}")
        pairs[name.strip()] = read(value.strip())
    return pairs or None


def _json(text: str) -> object:
    """Return a text's JSON value, or the text if it is no JSON."""
    try:
        return parse_json(text)
    except ValueError:
        return text


def _scalar(text: str) -> Scalar:
    value = _json(text)
    return value if isinstance(value, str | int | float | bool) else text


def mode_text(mode: RequestMode) -> str:
    """Return a mode as TOML, which reads back as the same mode."""
    return tomli_w.dumps(mode.as_dict())


def untried_text(mode: RequestMode) -> str:
    """Return one of the paper's modes as TOML, below whose it is and what the paper does not say."""
    said = f"# {mode.about['paper']} of the paper's {mode.about['arm']} arm. Never tried: run 'eyechart probe' first.\n"
    if mode.spec.startswith("openai:"):
        said += "# The paper names no endpoint: set base_url to the server's address, and spec to its model name.\n"
        said += '# base_url = "https://…/v1"\n# key_env = "…"\n'
    return said + mode_text(mode)


def untried_words(mode: RequestMode) -> str:
    """Return one of the paper's modes in a line: its model, and how it was asked."""
    settings = f"{mode.max_tokens} tokens, {mode.structured}, temperature {mode.temperature:g}"
    thinks = "" if "think" not in mode.options else f", think {str(mode.options['think']).lower()}"
    return f"the paper's {mode.about['paper']} ({mode.about['arm']} arm): {mode.spec}, {settings}{thinks}; untested"


def write_mode(path: Path, mode: RequestMode) -> None:
    """Write a mode's TOML file, and make its folder if needed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(mode_text(mode), encoding="utf-8")


def _is_line(value: object) -> bool:
    return isinstance(value, str) and (value == "" or value.isprintable())


def is_address(value: object) -> bool:
    """Return whether a value is the URL of a server, or empty."""
    if not _is_line(value):
        return False
    try:
        parts = urlsplit(str(value))
        port = 1 if parts.port is None else parts.port
    except ValueError:
        return False
    host = re.fullmatch(r"[^\s\"'<>\\^`{|}]+", parts.hostname or "")
    return value == "" or (parts.scheme in {"http", "https"} and host is not None and port > 0)


def _without_query(base_url: str) -> tuple[str, dict[str, str]]:
    """Return an address and its query apart; raises SpecError for a name with two values."""
    parts = urlsplit(base_url)
    pairs = parse_qsl(parts.query, keep_blank_values=True)
    if len(dict(pairs)) < len(pairs):
        raise SpecError("base_url: a name occurs twice in its query: leave one out")
    return urlunsplit(parts._replace(query="")), dict(pairs)


@lru_cache(maxsize=256)
def plain_address(base_url: str) -> str:
    """Return an address in one form: host in small letters, no usual port, final slash or route."""
    parts = urlsplit(base_url)
    host, usual = parts.hostname or "", {"http": 80, "https": 443}.get(parts.scheme)
    port = "" if parts.port in {None, usual} else f":{parts.port}"
    path = parts.path.rstrip("/").removesuffix("/chat/completions").rstrip("/")
    return f"{parts.scheme}://{f'[{host}]' if ':' in host else host}{port}{path}" if base_url else ""


def _is_plain(value: object) -> bool:
    """Return whether both JSON and TOML can hold a value: no null, no infinity, only text keys."""
    if isinstance(value, Mapping):
        return all(isinstance(key, str) and _is_plain(one) for key, one in value.items())
    if isinstance(value, list | tuple):
        return all(map(_is_plain, value))
    if isinstance(value, int):
        return -(2**63) <= value < 2**63
    return isinstance(value, str) or (isinstance(value, float) and math.isfinite(value))


def _is_lines(value: object) -> bool:
    return isinstance(value, Mapping) and all(_is_line(key) and _is_line(one) for key, one in value.items())


def _is(kind: object) -> Callable[[object], bool]:
    """Return a predicate for values of a type, in msgspec's sense: true is no number."""

    def holds(value: object) -> bool:
        try:
            msgspec.convert(value, kind)
        except msgspec.ValidationError:
            return False
        return not isinstance(value, Mapping | float) or _is_plain(value)

    return holds


_Check = tuple[Callable[[object], bool], str]
_Count = Annotated[int, msgspec.Meta(ge=0, lt=2**53)]
_Number = Annotated[float, msgspec.Meta(ge=0, le=LARGEST)]
_MODE: dict[str, _Check] = {
    "spec": (lambda value: _is_line(value) and value != "", "a model's SPEC, for example openai:MODEL"),
    "base_url": (is_address, "a URL that begins with http:// or https://"),
    "key_env": (lambda value: value == "" or bool(re.fullmatch(r"[A-Za-z_]\w*", str(value))), "a variable's name"),
    "token_field": (lambda value: value in TOKEN_FIELDS, f"one of {', '.join(TOKEN_FIELDS)}"),
    "max_tokens": (_is(Annotated[int, msgspec.Meta(ge=1, lt=2**53)]), "a whole number of at least 1"),
    "structured": (lambda value: value in STRUCTURED, f"one of {', '.join(STRUCTURED)}"),
    "system": (lambda value: value in ROLES, f"one of {', '.join(ROLES)}"),
    "answer": (lambda value: value in ANSWERS, f"one of {', '.join(ANSWERS)}"),
    "stream": (lambda value: value in STREAMS, f"one of {', '.join(STREAMS)}"),
    "temperature": (_is(_Number | None), f'a number of at least 0, or "{DEFAULT}"'),
    "seed": (_is(bool), "true or false"),
    "timeout_s": (_is(Annotated[float, msgspec.Meta(gt=0, le=LARGEST)]), "a number of seconds above 0"),
    "query": (_is_lines, "a table of lines of text"),
    "headers": (_is_lines, "a table of lines of text"),
    "about": (_is_lines, "a table of lines of text"),
    "body": (lambda value: isinstance(value, Mapping) and _is_plain(value), "a table of plain JSON values, no null"),
    "options": (_is(dict[str, Scalar]), "a table of texts, numbers and booleans"),
}
_CHOICES: Mapping[str, tuple[str, ...]] = {
    "token_field": TOKEN_FIELDS,
    "structured": STRUCTURED,
    "system": ROLES,
    "answer": ANSWERS,
    "stream": STREAMS,
}
"""The allowed words of a field."""
_COUNTS = ("calls", "image_tokens", "prompt_tokens", "completion_tokens_max")
_NUMBERS = ("completion_tokens", "reasoning_tokens", "seconds", "seconds_min")
_FLAGS = ("sees_image", "schema_binds", "temperature_matters", "seed_matters", "unknown_fields_ignored")
_MEASURED: dict[str, _Check] = {
    "date": (_is_line, "a line of text"),
    "facts": (_is(dict[str, str]), "a table of texts"),
    **dict.fromkeys(_COUNTS, (_is(_Count | None), "a whole number")),
    **dict.fromkeys(_NUMBERS, (_is(_Number | None), "a number of at least 0")),
    **dict.fromkeys(_FLAGS, (_is(bool | None), "true or false")),
}


def _require(value: object, checks: Mapping[str, _Check], where: str) -> None:
    for name, (holds, words) in checks.items():
        given = getattr(value, name)
        if not holds(given):
            secret = name in {"base_url", "key_env"} or looks_like_a_key(str(given))  # may be one
            said = f"{str(given)[:8]!r}…" if secret else repr(str(given)[:80])
            near = "" if secret or name not in _CHOICES else suggestion(str(given), _CHOICES[name])
            raise SpecError(f"{where}: {name} must be {words}; got {said}{near}")


def _refuse_unknown(values: Mapping[str, object], kind: type[RequestMode] | type[ModeMeasurements], where: str) -> None:
    known = [one.name for one in fields(kind)]
    for name in values:
        if name not in known:
            raise SpecError(f"{where}: there is no '{name}';{did_you_mean(name, known)} there are {', '.join(known)}")


def _expand(name: str, value: str, environ: Mapping[str, str]) -> str:
    def fill(match: re.Match[str]) -> str:
        variable = match.group(1) or match.group(2)
        if not environ.get(variable):
            raise SpecError(f"header '{name}' names the environment variable {variable}, which is not set")
        return environ[variable].strip()

    return _VARIABLE.sub(fill, value)


def _refuse_secrets(mode: RequestMode) -> None:
    """Raise SecretError, without the value, where a mode would write a secret to a file."""
    _refuse_secret_fields(mode)
    parts = urlsplit(mode.base_url)
    if parts.username or parts.password or parts.fragment:
        at = f"{parts.scheme}://{parts.hostname}…"
        raise SecretError(f"base_url {at} holds a user or a fragment: leave it out")
    for name, value in mode.query.items():
        if _names_a_key(name) or looks_like_a_key(name) or looks_like_a_key(value):
            shown = "a name" if looks_like_a_key(name) else f"'{name}'"
            raise SecretError(f"{shown} in the query of base_url looks like a secret: send it in a header as $NAME")
    if looks_like_a_key(parts.netloc, hashes=True):
        raise SecretError("the host of base_url looks like a secret: send it in a header as $NAME")
    if any(looks_like_a_key(part, hashes=len(part) < _LONG_HEX) for part in unquote(parts.path).split("/")):
        raise SecretError(
            f"base_url {parts.scheme}://{parts.hostname}… seems to hold a secret in its path: send it in a "
            "header as $NAME"
        )
    held = str([mode.spec, mode.base_url, mode.query, mode.key_env, mode.headers, mode.body, mode.options, mode.about])
    for variable, value in _secrets():
        if value in held:
            raise SecretError(
                f"the mode holds the value of the environment variable {variable}, which may be secret: write "
                f"'${variable}' in single quotes, so that the shell leaves the name"
            )


def _names_a_key(name: str) -> bool:
    """Return whether a name in a query is that of a key; Azure's functions use ``code``."""
    return names_a_key(name) or names_a_key(name, header=True) or name.lower() in {"code", "key", "sig", "signature"}


def without_secrets(text: str) -> str:
    """Return a text without the values of environment variables that are keys by name."""
    return each_without_secrets({"": text})[""]


def in_one_line(error: BaseException, most: int = 500) -> str:
    """Return the type and the words of another program's exception: one line, without secrets."""
    return " ".join(without_secrets(f"{type(error).__name__}: {error}").split())[:most]


def each_without_secrets(texts: Mapping[str, str]) -> dict[str, str]:
    """Return texts by name without the values of environment variables that are keys by name.

    Encoded forms are removed too (`without_keys`).
    """
    if all(len(text) < SHORTEST for text in texts.values()):
        return dict(texts)  # none can hold a key, and a search of the environment takes time
    keys = {value: f"[${variable}]" for variable, value in _secrets()}
    return {name: without_keys(text, keys) for name, text in texts.items()}


def _secrets() -> list[tuple[str, str]]:
    known = [(name, os.environ.get(name, "").strip()) for name in os.environ if _is_secret(name)]
    return [one for one in known if len(one[1]) >= SHORTEST]


@lru_cache(maxsize=4096)
def _is_secret(variable: str) -> bool:
    """Return whether a variable is a key by name; cached, as every reply checks all variables."""
    return _SECRET_VARIABLE.search(variable) is not None


def _names(value: object) -> list[str]:
    if isinstance(value, Mapping):
        return [name for key, one in value.items() for name in (str(key), *_names(one))]
    return [name for one in value for name in _names(one)] if isinstance(value, list | tuple) else []


def _refuse_secret_fields(mode: RequestMode) -> None:
    """Raise SecretError for a secret in a header, the body, an option or key_env."""
    if not mode.key_env.isupper() and looks_like_a_key(mode.key_env):
        raise SecretError("key_env looks like a secret: give the name of the variable that holds it")
    for name, value in mode.headers.items():
        if looks_like_a_key(name):
            raise SecretError("a header's name looks like a secret: give 'NAME: $VARIABLE'")
        rest = _VARIABLE.sub("", value)
        if names_a_key(name, header=True) and (rest == value or not is_beside_a_variable(rest)):
            raise SecretError(f"header '{name}' looks like a secret: give the name of a variable, as '{name}: $NAME'")
        if looks_like_a_key(value, hashes=names_a_hash(name)):
            raise SecretError(
                f"header '{name}' seems to hold a secret: give a variable, as '{name}: $NAME' ({_NO_KEY})"
            )
    _refuse_secret_body(mode.body)
    for where, value in _texts(mode.options):
        if looks_like_a_key(value, hashes=names_a_hash(where)):
            raise SecretError(f"option '{where}' seems to hold a secret, and a mode must not hold one")


def _refuse_secret_body(body: Mapping[str, object]) -> None:
    for name in _names(body):
        if looks_like_a_key(name):
            raise SecretError("a name in the body looks like a secret, which belongs in a header as $NAME")
        if names_a_key(name):
            raise SecretError(f"the body's '{name}' looks like a secret, which belongs in a header as $NAME")
    for where, value in _texts(body):
        if looks_like_a_key(value, hashes=names_a_hash(where)):
            raise SecretError(
                f"the body's '{where}' seems to hold a secret, which belongs in a header as $NAME ({_NO_KEY})"
            )


def _texts(value: object, where: str = "") -> Iterator[tuple[str, str]]:
    """Yield each text in plain values with its name."""
    if isinstance(value, str):
        yield where, value
    elif isinstance(value, Mapping):
        for key, one in value.items():
            yield from _texts(one, str(key))
    elif isinstance(value, list | tuple):
        for one in value:
            yield from _texts(one, where)


_DEFAULTS: dict[str, object] = {one.name: getattr(RequestMode("x"), one.name) for one in fields(RequestMode)[1:]}
