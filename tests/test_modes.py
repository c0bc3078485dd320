import string
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eyechart.errors import SpecError
from eyechart.keys import names_a_key
from eyechart.modes import ModeMeasurements, RequestMode, each_without_secrets, mode_text, read_mode, write_mode

LINES = st.text(st.characters(categories=["L", "N", "P", "S"]), max_size=20).map(lambda text: text.replace("$", "+"))
NAMES = (
    st.text(string.ascii_lowercase, min_size=1, max_size=6)
    .map(lambda name: f"x-{name}")
    .filter(lambda name: not names_a_key(name, header=True))
)
SCALARS = st.one_of(
    LINES, st.booleans(), st.integers(-(2**60), 2**60), st.floats(allow_nan=False, allow_infinity=False)
)
PLAIN = st.recursive(SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(NAMES, inner, max_size=3))
COUNTS = st.none() | st.integers(0, 10**6)
SECONDS = st.none() | st.floats(0, 1e6)
FLAGS = st.none() | st.booleans()
MEASURED = st.builds(
    ModeMeasurements,
    date=LINES,
    calls=COUNTS,
    sees_image=FLAGS,
    image_tokens=COUNTS,
    completion_tokens=SECONDS,
    seconds=SECONDS,
    schema_binds=FLAGS,
    facts=st.dictionaries(NAMES, st.text(st.characters(exclude_categories=["C"])), max_size=3),
)
MODES = st.builds(
    RequestMode,
    spec=LINES.map(lambda text: f"openai:{text}"),
    base_url=st.sampled_from(["", "http://127.0.0.1:8000/v1", "https://example.org"]),
    key_env=st.sampled_from(["", "MY_KEY"]),
    token_field=st.sampled_from(["max_tokens", "max_completion_tokens"]),
    max_tokens=st.integers(1, 10**6),
    structured=st.sampled_from(["none", "json_object", "json_schema"]),
    temperature=st.none() | st.floats(0, 2),
    seed=st.booleans(),
    timeout_s=st.floats(0.1, 1e4),
    headers=st.dictionaries(NAMES, LINES, max_size=3),
    body=st.dictionaries(NAMES, PLAIN, max_size=3),
    options=st.dictionaries(NAMES, SCALARS, max_size=3),
    measured=st.none() | MEASURED,
)


@given(MODES)
def test_a_mode_reads_back_from_its_file_as_it_was_written(mode: RequestMode) -> None:
    """Every field, also those that are absent, and as plain values for JSON."""
    with TemporaryDirectory() as folder:
        write_mode(Path(folder) / "mode.toml", mode)
        assert read_mode(Path(folder) / "mode.toml") == mode
    assert RequestMode.from_dict(mode.as_dict()) == mode


def test_a_default_mode_is_one_line() -> None:
    """What has its default is not written, and no temperature is written as a word."""
    assert mode_text(RequestMode("openai:m")) == 'spec = "openai:m"\n'
    assert 'temperature = "default"' in mode_text(RequestMode("openai:m", temperature=None))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('base_url = "x"', "no spec"),
        ('spec = "a:b"\nbase_url = "ftp://x"', "base_url must be a URL"),
        ('spec = "a:b"\nbase_url = "http://x:99999"', "base_url must be a URL"),
        ('spec = "a:b"\nmax_tokens = 0', "max_tokens must be a whole number of at least 1; got '0'"),
        ('spec = "a:b"\nmax_tokens = true', "max_tokens must be a whole number"),
        ('spec = "a:b"\ntemperature = -1', 'temperature must be a number of at least 0, or "default"'),
        ('spec = "a:b"\ntemperature = nan', "temperature must be"),
        ('spec = "a:b"\nstructured = "yaml"', "structured must be one of none, json_object, json_schema"),
        ('spec = "a:b"\ntoken_field = "tokens"', "token_field must be one of"),
        ('spec = "a:b"\ntimeout_s = 0', "timeout_s must be a number of seconds above 0"),
        ('spec = "a:b"\nbody = { x = inf }', "body must be a table of plain JSON values"),
        ('spec = "a:b"\nbody = { x = 1979-05-27 }', "body must be a table of plain JSON values"),
        ('spec = "a:b"\nheaders = { x = 1 }', "headers must be a table of lines"),
        ('spec = "a:b"\nheaders = { x = "a\\r\\nHost: b" }', "headers must be a table of lines"),
        ('spec = "a:b"\noptions = { x = [1] }', "options must be a table"),
        ('spec = "a:b"\nmax_token = 3', "there is no 'max_token'; did you mean 'max_tokens'? there are spec, base_url"),
        ('spec = "a:b"\nmeasured = 3', "measured must be a table"),
        ('spec = "a:b"\n[measured]\nspeed = 3', "there is no 'speed'"),
        ('spec = "a:b"\n[measured]\nseconds = "3"', "seconds must be a number"),
        ('spec = "a:b', "is no TOML file"),
    ],
)
def test_what_is_no_mode_is_refused_with_the_file_and_what_is_wrong(tmp_path: Path, text: str, says: str) -> None:
    """One line that says which field, and what it must be."""
    (tmp_path / "m.toml").write_text(text, encoding="utf-8")
    with pytest.raises(SpecError) as caught:
        read_mode(tmp_path / "m.toml")
    assert str(tmp_path / "m.toml") in str(caught.value)
    assert says in str(caught.value)


SECRET = "sk-very-secret-1234"  # noqa: S105 - the test's own


@pytest.mark.parametrize(
    "parts",
    [
        {"headers": {"Authorization": f"Bearer {SECRET}"}},
        {"headers": {"x-api-key": SECRET}},
        {"headers": {"x-plain": SECRET}},
        {"body": {"metadata": [{"api_key": SECRET}]}},
        {"body": {"note": SECRET}},
        {"options": {"note": SECRET}},
        {"base_url": f"https://user:{SECRET}@example.org/v1"},
        {"base_url": f"https://example.org/v1?key={SECRET}"},
        {"base_url": f"https://example.org/{SECRET}"},
    ],
)
def test_a_mode_refuses_to_hold_a_secret_and_does_not_quote_it(
    parts: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the name of the field, or because the environment holds this very value as a key."""
    monkeypatch.setenv("SOME_API_KEY", SECRET)
    with pytest.raises(SpecError) as caught:
        RequestMode("openai:m", **parts)  # type: ignore[arg-type]
    assert SECRET not in str(caught.value)


@pytest.mark.parametrize(
    ("parts", "left"),
    [
        ({"headers": {"x-api-key": SECRET, "x-title": "robot"}}, {"headers": {"x-title": "robot"}}),
        ({"body": {"note": {"api_key": SECRET}, "top_k": 5}}, {"body": {"top_k": 5}}),
        ({"options": {"note": SECRET}}, {}),
        ({"base_url": f"https://example.org/{SECRET}"}, {"base_url": "https://example.org"}),
        ({"headers": {"sk-abcdef1234567890abcd": "x", "x-title": "robot"}}, {"headers": {"x-title": "robot"}}),
        ({"key_env": "sk_live_abcdef1234567890abcd"}, {}),
    ],
)
def test_a_run_that_recorded_a_secret_is_read_without_it(
    parts: dict[str, object], left: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An older version took it: its calls stay readable, and the mode says what of it was left out."""
    monkeypatch.setenv("SOME_API_KEY", SECRET)
    mode = RequestMode.recorded({"spec": "openai:m", "max_tokens": 50, **parts}, "run.json")
    safe = RequestMode("openai:m", max_tokens=50, **left)  # type: ignore[arg-type]
    assert replace(mode, about={}) == safe
    assert not mode.is_same_request(safe), "a run goes on with what it asked"
    assert mode.about == {"left_out": f"a secret of {next(iter(parts))}"}
    assert SECRET not in mode_text(mode)
    with pytest.raises(SpecError, match="max_tokens must be a whole number"):
        RequestMode.recorded({"spec": "openai:m", "max_tokens": 0, **parts}, "run.json")


def test_headers_name_variables_and_are_filled_in_only_to_be_sent() -> None:
    """The mode keeps the name; a missing variable is named."""
    mode = RequestMode("openai:m", headers={"Authorization": "Token $MY_KEY", "x-user": "${WHO}-1", "x-plain": "2"})
    sent = mode.header_values({"MY_KEY": f"{SECRET}\n", "WHO": "me"})
    assert sent == {"Authorization": f"Token {SECRET}", "x-user": "me-1", "x-plain": "2"}
    assert SECRET not in mode_text(mode)
    with pytest.raises(SpecError, match="header 'x-user' names the environment variable WHO, which is not set"):
        mode.header_values({"MY_KEY": "x"})


def test_what_was_measured_does_not_make_another_request() -> None:
    """A later probe of the same mode resumes a run; another budget does not."""
    mode = RequestMode("openai:m", max_tokens=50)
    assert mode.is_same_request(RequestMode("openai:m", max_tokens=50, measured=ModeMeasurements(calls=3)))
    assert not mode.is_same_request(RequestMode("openai:m", max_tokens=51))


def test_a_mode_is_written_into_a_folder_that_is_not_there_yet(tmp_path: Path) -> None:
    """What a probe was paid for is not lost to a missing folder."""
    mode = RequestMode("openai:m")
    write_mode(tmp_path / "new" / "mode.toml", mode)
    assert read_mode(tmp_path / "new" / "mode.toml") == mode


KEYS = (
    "0f8a1c2b3d4e5f60718293a4b5c6d7e8",
    "0f8a1c2b3d4e5f60718293a4b5c6d7e8" * 2,
    "8c0f1d2e-3b4a-5968-7786-95a4b3c2d1e0",
    "Token 0123456789abcdef",
    "dapi0123456789abcdef0123456789abcdef",
    "dop_v1_0123456789abcdef0123456789abcdef",
    "npm_abcdefghij1234567890abcdefghij123456",
    "fw_3zabcdef12345678",
    "k3j9x2m8q7w5z1v4n6b0c2l8",
    "q83vEjRWeJCrze8SNFZ4kA==",
    "abcDef+123GHIjkl456+mnOP789",
    "sk-abcdefghijklmnopqrstuvwx",
    "SG.abcdefghij.klmnopqrstuvwxyz",
    "dckr_pat_abcdef12345678",
)
"""What services give as keys, none of them a real one; the first four may be something else in an address."""
HOLDERS = ("X-Pwd", "pwd", "X-Jwt", "X-Bearer", "Accesskey", "X-Session", "auth", "token", "authkey", "X-Signature")


@pytest.mark.parametrize(
    "given",
    [
        {"headers": {"X-Route": "sk-abcdef1234567890abcd"}},
        {"headers": {"X-Via": "Bearer abcdefgh12345678"}},
        {"body": {"user": {"tag": "hf_abcdEFGH1234ijklMNOP"}}},
        {"body": {"trace": ["Ab3dEf6hIj9lMn2pQr5tUv8x"]}},
        {"base_url": "https://gate.example/v1/sk-abcdef1234567890abcd"},
        {"headers": {"Ocp-Apim-Subscription-Key": "0123456789abcdef0123456789abcdef"}},
        {"headers": {"X-Passphrase": "abcdefgh12345678"}},
        {"body": {"extra": {"access_token": "abcdefgh12345678"}}},
        {"body": {"credentials": ["abcdefgh12345678"]}},
        {"body": {"sk-abcdef1234567890abcd": 1}},
        {"body": {"user": "-----BEGIN RSA PRIVATE KEY-----\nabcdefgh12345678"}},
        {"body": {"callback": "https://name:hunter22@gate.example/done"}},
        {"options": {"where": "hf_abcdEFGH1234ijklMNOP"}},
        {"base_url": "https://sk-abcdef1234567890abcd.gate.example/v1"},
        {"base_url": "https://name:hunter22@gate.example:port/v1"},
        {"base_url": "hunter22@gate.example"},
        {"headers": {"sk-abcdef1234567890abcd": "x"}},
        {"key_env": "sk_live_abcdef1234567890abcd"},
        {"key_env": "sk-abcdef1234567890abcd"},
        {"key_env": "no-such-abcdefgh12345678"},
        {"system": "sk-abcdef1234567890abcd"},
        *({where: {"x-route": key}} for key in KEYS for where in ("headers", "body")),
        {"headers": {"X-Route": "wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY"}},
        *({"base_url": f"https://gate.example/{key}/v1"} for key in KEYS[4:]),
        *({where: {name: "hunter22@"}} for name in HOLDERS for where in ("headers", "body")),
        {"headers": {"X-Api-Key": "hunter22@ ${HOME}"}},
        {"headers": {"Authorization": "Bearer-hunter22@ $HOME"}},
        {"headers": {"Authorization": "Bearer $HOME hunter22@"}},
    ],
)
def test_what_looks_like_a_secret_is_refused_and_not_quoted(given: dict[str, object]) -> None:
    """In a header, a field of the body or an address, whatever its name: in words, without the value."""
    with pytest.raises(SpecError) as refused:
        RequestMode("m", **given)  # type: ignore[arg-type]
    for secret in ("abcdef1234", "abcdefgh12345678", "abcdEFGH", "Ab3dEf6h", "hunter22@", *KEYS):
        assert secret not in str(refused.value)


@pytest.mark.parametrize(
    "given",
    [
        {"headers": {"X-Route": "$MY_KEY", "X-Title": "my-robot-of-2026"}},
        {"headers": {"Authorization": "Bearer $MY_KEY", "X-Api-Key": "$ONE-$TWO", "Cookie": "session=$ONE; team=$TWO"}},
        {"headers": {"X-Request-Id": KEYS[2], "traceparent": f"00-{KEYS[0]}-0123456789abcdef-01"}},
        {"body": {"session_id": KEYS[2], "digest": KEYS[1], "author": "me", "model": "accounts/x/models/qwen2p5vl72b"}},
        {"body": {"model": "meta-llama/Llama-3.2-11B-Vision-Instruct", "stop": ["the token generation of 2026"]}},
        {"body": {"guided_regex": "[A-Za-z0-9+/=]{20,40}", "first_pass": True, "model": "microsoft/Phi3v128kInstruct"}},
        {"base_url": f"https://gate.example/v1/{KEYS[2]}/openai"},
        {"body": {"revision": "0123456789abcdef0123456789abcdef01234567", "provider": {"order": ["Together-AI-2026"]}}},
        {"base_url": "https://gateway.example/v1/0123456789abcdef0123456789abcdef/sk-test/openai"},
        {"body": {"served": "Qwen2.5-VL-72B-Instruct-AWQ-int4"}},
        {"body": {"stop_token": "<end>", "max_completion_tokens": 5, "keys": ["a"], "monkey": "x"}},
        {"key_env": "HF_ACCESS_TOKEN_2026"},
    ],
)
def test_what_is_no_secret_is_not_refused(given: dict[str, object]) -> None:
    """Names of variables, revisions, accounts and names of models pass."""
    assert RequestMode("m", **given)  # type: ignore[arg-type]


def test_a_variable_that_holds_a_word_of_every_mode_is_no_secret(monkeypatch: pytest.MonkeyPatch) -> None:
    """A script may keep an option in one that is called so; a word that somebody chose still counts."""
    monkeypatch.setenv("TOKEN_FIELD", "max_tokens")
    monkeypatch.setenv("MY_KEY", "Together-AI")
    assert RequestMode("openai:m").spec == "openai:m"
    with pytest.raises(SpecError, match="environment variable MY_KEY"):
        RequestMode("openai:m", body={"provider": {"order": ["Together-AI"]}})


def test_a_text_as_long_as_the_shortest_secret_is_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """Values of eight characters count; shorter texts can hold none."""
    monkeypatch.setenv("SHORT_API_KEY", "STRAIGHT")
    found = each_without_secrets({"text": "STRAIGHT", "why": "STOP"})
    assert found == {"text": "[$SHORT_API_KEY]", "why": "STOP"}
