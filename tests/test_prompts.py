from dataclasses import replace

import pytest

from eyechart.actions import DRIVING
from eyechart.errors import SpecError
from eyechart.prompts import PROMPTS, find_prompt

PAPER = {"baseline", "minimal", "chain_of_thought", "few_shot", "anti_degeneracy"}


def test_there_are_the_five_of_the_paper_and_a_sixth() -> None:
    """Six formulations, each under its own name, no two with one wording."""
    assert len(PROMPTS) == 6
    assert set(PROMPTS) > PAPER
    assert all(prompt.name == name for name, prompt in PROMPTS.items())
    assert len({(prompt.system, prompt.user) for prompt in PROMPTS.values()}) == 6


@pytest.mark.parametrize("name", PROMPTS)
def test_every_prompt_names_every_action(name: str) -> None:
    """A model can only choose what it was told of."""
    assert all(action in PROMPTS[name].user for action in DRIVING.actions)


@pytest.mark.parametrize("name", PROMPTS)
def test_every_prompt_is_the_same_for_every_frame(name: str) -> None:
    """No placeholder through which a fact about the frame could come in."""
    said = PROMPTS[name].system + PROMPTS[name].user
    assert "%" not in said
    assert "{}" not in said
    assert "gap" not in said.lower()


@pytest.mark.parametrize("name", PROMPTS)
def test_a_prompts_key_changes_with_any_change_of_its_wording(name: str) -> None:
    """The name stays readable in it."""
    prompt = find_prompt(name)
    assert prompt.key.startswith(f"{name}@")
    changed = {
        replace(prompt, user=prompt.user + " ").key,
        replace(prompt, system=prompt.system + ".").key,
        replace(prompt, user=prompt.system, system=prompt.user).key,
        prompt.key,
    }
    assert len(changed) == 4
    assert replace(prompt).key == prompt.key


def test_an_unknown_prompt_lists_the_known() -> None:
    """So that the next try succeeds."""
    with pytest.raises(SpecError) as refused:
        find_prompt("poem")
    assert "'poem'" in str(refused.value)
    assert all(name in str(refused.value) for name in PROMPTS)
