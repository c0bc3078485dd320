"""The pages on statistics and verdicts name what the code prints, all of it and nothing else."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import banks
import drawn
from eyechart.conditions import BATTERY, CONDITIONS, COUNTERFACTUALS, OF_BANKS
from eyechart.frames import LEAD_GAP
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.space import Decision
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.depth import EARLIER, KINDS, THIRDS
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.studies.battery.scores import statistics_of
from eyechart.verdicts import LABELS, LATERAL, PAPER_LABELS
from eyechart.verdicts.battery_rules import DISTANCE, LATERAL_AXIS
from eyechart.verdicts.paper import PAPER

ROOT = Path(__file__).parents[2]
STATISTICS = (ROOT / "docs" / "statistics.md").read_text(encoding="utf-8")
VERDICTS = (ROOT / "docs" / "verdicts.md").read_text(encoding="utf-8")


def headings(text: str) -> list[str]:
    """Return the names in the headings of the third level."""
    lines = re.findall(r"^### (.+)$", text, re.MULTILINE)
    return [name for line in lines for name in re.findall(r"`([^`]+)`", line)]


def part(page: str, title: str) -> str:
    """Return what stands under a heading of the second level."""
    return re.split(r"^## ", page.partition(f"\n## {title}\n")[2], maxsplit=1, flags=re.MULTILINE)[0]


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    """Return the name of every statistic that a run under all conditions prints; CONDITION stands for a further one."""
    bank = banks.build_bank(tmp_path_factory.mktemp("reading") / "bank")
    names = [name for name in OF_BANKS if name in (*BATTERY, *COUNTERFACTUALS, "text_swapped")]
    given = {name: tuple(Decision("STOP", None) for _ in bank) for name in (*names, "blank@main")}
    answers = Answers("m", bank.frames, DRIVING, LEAD_GAP, given, has_text=True)
    printed = statistics_of(answers, Resampling(resamples=20, intervals=False))
    return {name.replace("blank@main", "CONDITION") for name in printed}


def test_every_statistic_that_is_printed_has_its_paragraph(printed: set[str]) -> None:
    """A heading a statistic in docs/statistics.md; none for one that is printed no more."""
    named = headings(STATISTICS)
    assert sorted(printed - set(named)) == [], "give these a heading in docs/statistics.md"
    assert sorted(set(named) - printed) == [], "docs/statistics.md explains what is not printed"
    assert len(named) == len(set(named))


def test_the_page_names_the_statistics_that_leave_holes_out() -> None:
    """Those of fewer answers where a scenario is a hole, and no other."""
    plain = drawn.answered(drawn.grades)
    rng, far = np.random.default_rng(0), plain.at["far"]
    plain = replace(plain, before={name: rng.permuted(np.tile(far, (EARLIER, 1))) for name in plain.levels})
    hole = plain.strata["scenario"] == "blocked"
    blind = replace(plain, levels={name: np.where(hole, 0.0, level) for name, level in plain.levels.items()})
    whole, rest = ({name: test().n for name, test in moved.tests().items()} for moved in (plain, blind))
    sentence = STATISTICS.partition("### `holes`, `place_open`")[2].partition("Then")[2].partition("lies outside.")[0]
    named = re.findall(r"`(\w+)`", sentence)
    parts = [f"{name}_{part}" for name, many in (("specificity", THIRDS), ("order", KINDS)) for part in many]
    fewer = {name for name in whole if rest[name] < whole[name] and not name.startswith("place_")}  # of one place
    assert sorted(fewer) == sorted([*named, *parts])


def test_every_paragraph_says_what_its_statistic_does_not_show() -> None:
    """No statistic and no verdict is explained without its limits."""
    for page in (STATISTICS, VERDICTS):
        for paragraph in re.split(r"^### ", page, flags=re.MULTILINE)[1:]:
            assert "*Does not show:* " in paragraph, paragraph.splitlines()[0]


def test_the_page_names_only_statistics_and_conditions_that_there_are(printed: set[str]) -> None:
    """A name in running text is a statistic, a condition, a label or an option."""
    known = printed | set(CONDITIONS) | set(LABELS) | {"mirrored"}
    words = set(re.findall(r"`([a-z]\w*(?:\.\w+)?)`", STATISTICS))
    assert sorted(words - known) == []


def test_every_verdict_has_its_paragraph() -> None:
    """A heading a label, calibrated and lateral, in the order in which they are tried; a row a label of the paper."""
    assert tuple(headings(part(VERDICTS, "The calibrated rules"))) == in_the_order_tried()
    assert set(headings(part(VERDICTS, "Lateral"))) == set(LATERAL)
    assert set(re.findall(r"^\| `(\w+)` \|", part(VERDICTS, "The paper's rules"), re.MULTILINE)) == set(PAPER_LABELS)


def in_the_order_tried() -> tuple[str, ...]:
    """Return the calibrated labels with depth before depth_lateral, which is depth and more."""
    labels = [label for label in LABELS if label != "depth_lateral"]
    labels.insert(labels.index("depth") + 1, "depth_lateral")
    return tuple(labels)


def test_the_lists_of_labels_hold_every_label_that_a_rule_can_give() -> None:
    """The labels of the rows, and none that no row gives."""
    given = {rule.label for axis in (DISTANCE, LATERAL_AXIS, PAPER) for rule in axis.rules}
    assert given == {*LABELS, *PAPER_LABELS, *LATERAL}
