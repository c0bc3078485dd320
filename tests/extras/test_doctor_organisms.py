"""The doctor on real models that were trained to answer nothing but an action: an honest "cannot say"."""

import pytest

from eyechart.modes import RequestMode
from eyechart.probe import doctor, probe

pytestmark = [pytest.mark.models, pytest.mark.filterwarnings("ignore")]


@pytest.mark.parametrize("name", ["grounded", "blind"])
def test_an_organism_is_not_called_blind_for_answering_nothing_else(name: str) -> None:
    """One that looks and one that does not reply alike to questions that neither was trained for."""
    found = doctor(RequestMode(f"hf:organism:{name}", temperature=None))
    assert (found.outcome, found.exit_code) == ("cannot_say", 2)
    assert "14 of 14 replies name none of the choices" in found.causes[0]
    assert "A picture adds 7 tokens" in found.causes[0]
    assert (found.sight.same, found.budget_enough, found.schema_binds) == ((3, 3), True, None)
    assert found.spent.calls == 19


def test_an_organism_is_pinned_in_the_mode_that_its_adapter_can_keep() -> None:
    """Budget and tokens are measured; formats, seeds and unknown fields are not asked of what runs here."""
    found = probe(RequestMode("hf:organism:grounded"))
    measured = found.measured
    assert (found.mode.max_tokens, found.mode.structured, measured.completion_tokens_max) == (256, "none", 7)
    assert (measured.sees_image, measured.schema_binds, measured.seed_matters) == (None, None, None)
    assert measured.image_tokens == 7
    assert measured.seconds is not None
