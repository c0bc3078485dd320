"""The page's table of what a battery costs is made of today's table of prices."""

import importlib.util
from types import ModuleType

import pytest

from eyechart.models.prices import read_prices
from pages import ROOT


@pytest.fixture(scope="module")
def update_costs() -> ModuleType:
    """Return the program that writes the table."""
    spec = importlib.util.spec_from_file_location("update_costs", ROOT / "docs" / "update_costs.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_table_is_what_the_prices_say(update_costs: ModuleType) -> None:
    """Where this fails, run: python docs/update_costs.py."""
    assert update_costs.shown() == update_costs.block(), "run: python docs/update_costs.py"


def test_every_price_has_its_row_and_a_sum_that_is_right(update_costs: ModuleType) -> None:
    """1584 calls of 400 tokens in and 20 out."""
    table = update_costs.shown()
    for price in read_prices().entries:
        cost = 1584 * (400 * price.input + 20 * price.output) / 1e6
        assert f"| `{price.model}` | ${cost:.2f} |" in table
