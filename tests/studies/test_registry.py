"""Whoever adds a study to the registry is told what is still missing of it."""

from collections.abc import Mapping

import pytest

from eyechart.studies import STUDIES, Study, open_study

ASKED: Mapping[str, tuple[str, ...]] = {"gate": ("gate",), "bundle": ("require_scorable", "derive")}
"""What a study either refuses in words, or has methods for; a bundle of drives or of several runs needs ``whole``."""


@pytest.mark.parametrize("name", STUDIES)
@pytest.mark.parametrize("what", ASKED)
def test_a_study_either_refuses_or_does_what_it_may_be_asked(name: str, what: str) -> None:
    """A study that does neither would end in a bare error."""
    study = open_study(name)
    own = [method for method in ASKED[what] if getattr(type(study), method) is not getattr(Study, method)]
    if what in study.refuses:
        assert study.refuses[what].strip()
    else:
        whole = what == "bundle" and type(study).whole is not Study.whole
        assert own == list(ASKED[what]) or whole, f"{name} refuses no {what}, so it needs {ASKED[what]}"


@pytest.mark.parametrize("name", STUDIES)
def test_what_a_gate_asks_by_itself_is_among_what_it_may_ask(name: str) -> None:
    """And each requirement says what it means."""
    study = open_study(name)
    assert bool(study.requirements) == ("gate" not in study.refuses)
    assert not study.requirements or study.required in study.requirements
    assert all(says.strip() for says in study.requirements.values())


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_says_in_words_what_its_runs_are(name: str) -> None:
    """Its page asks what came of them."""
    assert open_study(name).runs_are
