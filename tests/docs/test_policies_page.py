"""The pages on policies: the examples run as they stand, and every label, guard and condition is named."""

import re
import sys
from pathlib import Path

import pytest

from eyechart.conditions.policies import conditions_of
from eyechart.models.policy_callable import DECLARED
from eyechart.simulators import open_bank_simulator
from eyechart.verdicts.labels import GUARDS
from eyechart.verdicts.policy_verdict import AXES

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "policies.md").read_text(encoding="utf-8")
REFERENCE = (DOCS / "policy-reference.md").read_text(encoding="utf-8")
FUNCTION, *PYTHON = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


@pytest.mark.slow
def test_the_function_is_a_policy_and_the_example_in_python_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first is asked by the doctor, which finds that it never moves; the others are cells of one notebook."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "my_robot", raising=False)  # another page's
    (tmp_path / "my_robot.py").write_text(FUNCTION, encoding="utf-8")
    session: dict[str, object] = {}
    for cell in PYTHON:
        exec(compile(cell, "docs/policies.md", "exec"), session)  # noqa: S102 - it is what is tested
    printed = capsys.readouterr().out
    assert "AMISS       state" not in printed
    assert "camera_content state_used instruction_ignored\n[]\n" in printed
    assert "trained:sees, step 10000 → trained:one_object, step 20000: camera " in printed
    assert (tmp_path / "report.html").is_file()
    from eyechart.frames import open_bank  # noqa: PLC0415 - the page made the bank
    from eyechart.probe.policies import examine_policy  # noqa: PLC0415

    findings = examine_policy("python:my_robot:act", open_bank(tmp_path / "bank")).findings
    assert [finding.fine for finding in findings if finding.name == "motions"] == [True]
    assert [finding.fine for finding in findings if finding.name == "constant"] == [False]


def test_it_names_every_label_guard_attribute_and_condition(tmp_path: Path) -> None:
    """All of them, in signs of code."""
    text = re.sub(r"^```.*?^```", "", PAGE + REFERENCE, flags=re.MULTILINE | re.DOTALL)
    named = set(re.findall(r"`([^`]+)`", text))
    assert {label for labels in AXES.values() for label in labels} <= named
    assert set(GUARDS) <= named
    assert set(DECLARED) <= named
    bank = open_bank_simulator("tabletop").build(tmp_path / "bank", seeds=(0,), steps=4)
    bases = {name.partition("@")[0] for name in conditions_of(bank)[0]}
    said = {name.partition("@")[0] for name in named}
    assert {name for name in bases if not name.startswith("told_")} <= said
