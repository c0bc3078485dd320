"""What ``hf:`` says and refuses where its library is not there, or is not to be imported yet."""

import importlib.metadata
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace

import pytest

from eyechart.errors import SpecError
from eyechart.models import huggingface, open_model
from eyechart.models.huggingface import checkpoint, organisms
from eyechart.modes import RequestMode
from eyechart.verdicts import LABELS
from eyechart.verdicts.admission import CLAUSES


def test_a_missing_library_is_one_line_that_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    """The core works without torch; ``hf:`` says which extra it needs."""

    def absent(name: str) -> str:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(checkpoint, "version", absent)
    with pytest.raises(SpecError) as caught:
        open_model("hf:organism:grounded")
    assert str(caught.value) == "hf: needs torch: pip install 'eyechart[transformers]'"


def test_the_list_names_the_organisms_and_the_papers_edge_models() -> None:
    """Every organism with what it does, every edge model with its size and licence."""
    names = huggingface.names()
    assert names["organism:blind"] == "answers SLOW, whatever it is shown"
    assert names["llava-hf/llava-1.5-7b-hf"] == (
        "the paper's LLaVA-1.5-7B: 7.06 billion parameters, whose weights take 28.3 GB in float32, 14.1 in float16, "
        "7.3 in 8 bits, 4.4 in 4 bits; licence Llama 2"
    )
    assert names["Qwen/Qwen2-VL-7B-Instruct"].endswith("; needs torchvision")
    assert sum(says.startswith("the paper's ") for says in names.values()) == 4


def test_an_unknown_organism_lists_the_known_ones() -> None:
    """In one line."""
    with pytest.raises(SpecError, match="unknown organism 'giant'; known are grounded, depth_only, presence_only"):
        organisms.folder("giant")


def test_every_organism_declares_labels_that_there_are() -> None:
    """A typing error here would fail no other test."""
    for one in (organisms.ORGANISMS | organisms.PLANNERS).values():
        assert one.calibrated in LABELS
        assert one.lateral in {"turns_clear", "swaps", "does_not_swap", "one_sided", "no_power"}
    assert all(estimator.fails <= CLAUSES.keys() for estimator in organisms.ESTIMATORS.values())


@pytest.mark.parametrize(("field", "value"), [("headers", {"X-Title": "eyechart"}), ("key_env", "MY_KEY")])
def test_what_only_a_server_can_be_told_is_refused(field: str, value: object) -> None:
    """Rather than left undone without a word."""
    mode = RequestMode("hf:organism:grounded", **{field: value})  # type: ignore[arg-type]
    with pytest.raises(SpecError, match=f"where '{field}' has no effect"):
        open_model(mode.spec, mode)


def _printed(messages: Sequence[object], **how: object) -> str:
    del how
    return str(messages)


@pytest.mark.parametrize(
    ("processor", "says"),
    [
        (SimpleNamespace(chat_template="x", apply_chat_template=_printed), "takes only text"),
        (
            SimpleNamespace(
                chat_template="x",
                apply_chat_template=_printed,
                image_processor=object(),
                tokenizer=SimpleNamespace(),
                image_token="<image>",  # noqa: S106 - no password
            ),
            "has no image slot",
        ),
        (
            SimpleNamespace(
                chat_template="x",
                apply_chat_template=_printed,
                image_processor=object(),
                tokenizer=SimpleNamespace(),
            ),
            "has no image slot",
        ),
    ],
)
def test_a_checkpoint_that_takes_no_picture_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, processor: SimpleNamespace, says: str
) -> None:
    """A tokenizer alone, or a template that prints the parts of a message as they are."""
    (tmp_path / "config.json").write_text("{}", encoding="utf-8")
    opened: Callable[..., SimpleNamespace] = lambda *_, **__: processor  # noqa: E731
    monkeypatch.setattr(checkpoint, "require_library", lambda: None)
    monkeypatch.setattr(checkpoint, "_open_processor", opened)
    with pytest.raises(SpecError, match=says):
        open_model(f"hf:{tmp_path}")
