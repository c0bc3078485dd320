"""The table from paper to module to test: complete, and every module and test in it exists."""

import re
from pathlib import Path

from eyechart.paper import BESIDES, LABELS

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
ROWS = [
    tuple(cell.strip() for cell in line.strip("|").split("|"))
    for line in PAGE.splitlines()
    if line.startswith("| ") and not line.startswith(("| paper |", "| what |", "| label |", "| `"))
]
MISSING = "*not implemented yet*"

PRINTED = (
    "t:conditions",
    "t:baselines",
    "t:controller-local",
    "t:positive-guardian",
    "t:mpc-intent",
    "t:degeneracy",
    "t:frontier",
    "t:qwenorder",
    "t:prompts",
    "fgr:vlm-interface",
    "fgr:mi",
    "fgr:bicb",
)
"""Every table and figure of the paper."""

SECTIONS = (
    "The Input-Ablation Battery",
    "Experimental Setup",
    "Models",
    "Corpus and parsing",
    "Constructive renderer-calibrated controller",
    "Symmetry-consensus longitudinal guardian",
    "Hierarchical VLM–MPC diagnostic",
    "Structured output is not geometric grounding",
    "Symmetry consensus recovers a longitudinal guardian",
    "MPC cannot repair an ungrounded intent layer",
    "Edge models are image-invariant",
    "Four regimes in the hosted arm",
    "Prompt formulation gates measured grounding",
    "Transfer and deployment characteristics",
)
"""Every section of the paper that states a procedure or a result."""


def test_every_section_table_and_figure_has_a_row() -> None:
    """Also where nothing of it is there yet."""
    papers = [row[0] for row in ROWS]
    for label in PRINTED:
        kind = "Table" if label.startswith("t:") else "Figure"
        assert any(re.search(rf"{kind} {label}(?![\w-])", cell) for cell in papers), label
    for section in SECTIONS:
        assert any(f"Section {section}" in cell for cell in papers), section


def test_every_label_has_the_command_that_the_code_names() -> None:
    """Label, run and what is needed besides, as `eyechart paper` says them where they are missing."""
    rows = re.findall(r"^\| `(\S+)` \| `([^`]+)` \| (.*?) ?\|$", PAGE, re.MULTILINE)
    assert {label: run for label, run, _ in rows} == LABELS
    assert {label: besides.replace("`", "") for label, _, besides in rows if besides} == BESIDES
    assert LABELS.keys() == set(PRINTED)


def test_every_module_and_test_exists() -> None:
    """As a file or a folder below src/eyechart, and from the root."""
    for paper, module, test in ROWS:
        for name in re.findall(r"`([^`]+)`", module):
            assert (ROOT / "src" / "eyechart" / name).exists(), f"{paper}: {name}"
        for name in re.findall(r"`([^`]+)`", test):
            assert name.startswith("tests/"), f"{paper}: {name}"
            assert (ROOT / name).exists(), f"{paper}: {name}"


def test_every_row_has_a_module_with_a_test_or_says_that_there_is_none() -> None:
    """No row is silent about what is missing."""
    for paper, module, test in ROWS:
        assert "`" in module or MISSING in module, paper
        assert ("`" in module) == ("`" in test), paper
