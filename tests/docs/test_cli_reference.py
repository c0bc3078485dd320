"""The reference of the command line is what the commands say of themselves."""

import importlib.util
from types import ModuleType

import pytest
from typer.main import get_command

from eyechart.cli.app import app
from pages import ROOT


@pytest.fixture(scope="module")
def update_cli() -> ModuleType:
    """Return the program that writes the page."""
    spec = importlib.util.spec_from_file_location("update_cli", ROOT / "docs" / "update_cli.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_is_what_the_commands_say(update_cli: ModuleType) -> None:
    """Where this fails, run: python docs/update_cli.py."""
    assert update_cli.PAGE.read_text(encoding="utf-8") == update_cli.page(), "run: python docs/update_cli.py"


def test_every_command_and_option_is_on_it(update_cli: ModuleType) -> None:
    """Each has a section, a sentence, an example, and a row an option with its words."""
    page, named = update_cli.page(), dict(update_cli.commands(get_command(app), "eyechart"))
    assert len(named) > 14
    for name, command in named.items():
        section = page.partition(f"\n## `{name}`\n")[2].partition("\n## ")[0]
        assert len(section.strip().splitlines()[0]) > 20, name
        for option in command.params:
            if option.param_type_name == "option" and not option.hidden:
                assert f"| `{option.opts[0]}" in section, f"{name} {option.opts[0]}"
                assert option.help, f"{name} {option.opts[0]}"
