"""The page on simulators: its example of a Gymnasium environment runs as it stands."""

import re
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "simulators.md").read_text(encoding="utf-8")


def part(title: str) -> str:
    """Return what stands under a heading of the second level."""
    return re.split(r"^## ", PAGE.partition(f"\n## {title}\n")[2], maxsplit=1, flags=re.MULTILINE)[0]


def test_the_example_in_gymnasium_runs_as_it_stands(capsys: pytest.CaptureFixture[str]) -> None:
    """It drives one world to its end."""
    (block,) = re.findall(r"^```python\n(.*?)^```", part("In Gymnasium"), re.MULTILINE | re.DOTALL)
    exec(compile(block, "docs/simulators.md", "exec"), {})  # noqa: S102 - it is what is tested
    shape, scenario, _, ended = re.fullmatch(r"(\(.*\)) (\w+) (\d+) (\w+)\n", capsys.readouterr().out).groups()
    assert shape == "(240, 320, 3)"
    assert scenario in {"offset", "single", "slalom", "gate", "clutter"}
    assert ended in {"goal", "crash", "time"}
