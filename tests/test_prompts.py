from dataclasses import replace

import pytest

from eyechart.errors import SpecError
from eyechart.prompts import FORWARD_PROMPTS, PROMPTS, Prompt, find_prompt
from eyechart.spaces.discrete import DRIVING

PAPER = {"baseline", "minimal", "chain_of_thought", "few_shot", "anti_degeneracy"}


def test_there_are_the_five_of_the_paper_and_a_sixth() -> None:
    """Six formulations, each under its own name, no two with one wording."""
    assert len(PROMPTS) == 6
    assert set(PROMPTS) > PAPER
    assert all(prompt.name == name for name, prompt in PROMPTS.items())
    assert len({(prompt.system, prompt.user) for prompt in PROMPTS.values()}) == 6


ALL = [*PROMPTS.values(), *FORWARD_PROMPTS.values()]


@pytest.mark.parametrize("prompt", ALL, ids=lambda prompt: prompt.key)
def test_every_prompt_names_every_action(prompt: Prompt) -> None:
    """A model can only choose what it was told of."""
    assert all(action in prompt.user for action in DRIVING.actions)


def test_a_forward_picture_is_not_called_a_view_from_above() -> None:
    """The same six formulations, found by the same names; only a forward camera's speak of one."""
    assert list(FORWARD_PROMPTS) == list(PROMPTS)
    assert len({prompt.key for prompt in ALL}) == 12
    for name in PROMPTS:
        assert find_prompt(name) == PROMPTS[name]
        assert find_prompt(name, "horizontal") == FORWARD_PROMPTS[name]
        assert "down" in PROMPTS[name].user
        assert "forward camera" in FORWARD_PROMPTS[name].user
        assert "down" not in FORWARD_PROMPTS[name].user


@pytest.mark.parametrize("prompt", ALL, ids=lambda prompt: prompt.key)
def test_every_prompt_is_the_same_for_every_frame(prompt: Prompt) -> None:
    """No placeholder through which a fact about the frame could come in."""
    said = prompt.system + prompt.user
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
