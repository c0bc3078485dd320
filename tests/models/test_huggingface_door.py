"""What ``hf:`` says and refuses where its library is not there, or is not to be imported yet."""

import importlib.metadata

import pytest

from eyechart.errors import SpecError
from eyechart.models import huggingface, open_model
from eyechart.models.huggingface import checkpoint, organisms
from eyechart.verdicts import CALIBRATED_LABELS


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
    assert names["llava-hf/llava-1.5-7b-hf"].startswith("the paper's LLaVA-1.5-7B: 7.1 billion parameters, 14.1 GB")
    assert sum(says.startswith("the paper's ") for says in names.values()) == 4


def test_an_unknown_organism_lists_the_known_ones() -> None:
    """In one line."""
    with pytest.raises(SpecError, match="unknown organism 'giant'; known are grounded, depth_only, presence_only"):
        organisms.folder("giant")


def test_every_organism_declares_labels_that_there_are() -> None:
    """A typing error here would fail no other test."""
    for one in organisms.ORGANISMS.values():
        assert one.calibrated in CALIBRATED_LABELS
        assert one.lateral in {"swaps", "does_not_swap", "one_sided", "no_power"}
