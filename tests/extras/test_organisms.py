"""The organisms deserve the labels that they were trained for, through the whole battery and the ordinary adapter."""

import importlib.util
from collections import Counter
from pathlib import Path
from types import ModuleType

import pytest

from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER
from eyechart.models.huggingface.organisms import ORGANISMS
from eyechart.studies import battery as study
from eyechart.studies.battery import BatteryScore
from eyechart.verdicts import judge

pytestmark = [pytest.mark.models, pytest.mark.filterwarnings("ignore")]

SPECS = {f"hf:organism:{name}": organism for name, organism in ORGANISMS.items()}


ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def page() -> ModuleType:
    """Return the program that writes the demo's output into the page about organisms."""
    spec = importlib.util.spec_from_file_location("page", ROOT / "docs" / "update_model_organisms.py")
    program = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(program)
    return program


@pytest.fixture(scope="module")
def printed(page: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """Run ``eyechart demo --vlm``: all five, 144 frames, eleven conditions; return what it prints, and its run."""
    base = tmp_path_factory.mktemp("organisms")
    return page.demo_output(base), base / "run-vlm-0"


@pytest.fixture(scope="module")
def run(printed: tuple[str, Path]) -> Path:
    """Return the demo's run."""
    return printed[1]


@pytest.fixture(scope="module")
def scored(run: Path) -> BatteryScore:
    """Return its score."""
    return study.score(run)


def test_the_page_shows_what_the_demo_prints(page: ModuleType, printed: tuple[str, Path]) -> None:
    """docs/update_model_organisms.py writes it."""
    assert page.shown() == printed[0]


def test_every_organism_gets_the_labels_that_it_was_trained_for(scored: BatteryScore) -> None:
    """Verdict and lateral label of all five."""
    verdicts = judge(scored)
    found = {spec: (verdict.calibrated.label, verdict.lateral.label) for spec, verdict in verdicts.items()}
    assert found == {spec: (one.calibrated, one.lateral) for spec, one in SPECS.items()}


def test_every_call_is_accounted_for(run: Path, scored: BatteryScore) -> None:
    """One finished reply a planned call, each complete, with its tokens counted."""
    with Ledger(run / LEDGER) as ledger:
        for spec in SPECS:
            replies = [reply for _, reply in ledger.replies(spec)]
            assert len(replies) == scored.models[spec].planned >= 11 * 144
            assert Counter(reply.error for reply in replies) == {None: len(replies)}
            assert Counter(reply.finish_reason for reply in replies) == {"stop": len(replies)}
            assert {reply.completion_tokens for reply in replies} == {7}
            assert all(reply.prompt_tokens is not None and reply.seconds is not None for reply in replies)
            assert scored.models[spec].statistics["unparsed_reference"].value == 0.0


def test_greedy_organisms_repeat_themselves_and_the_sampled_one_does_not(scored: BatteryScore) -> None:
    """Repeats are calls of their own; only the draw makes them differ."""
    for spec, one in SPECS.items():
        disagreement = scored.models[spec].statistics["self_disagreement"].value
        assert disagreement is not None
        assert disagreement > 0.7 if one.sampled else disagreement == 0.0


def test_the_grounded_organism_knows_what_it_sees(scored: BatteryScore) -> None:
    """On pictures of the real renderer, which training never saw, at least 19 of 20 decisions are what is demanded."""
    answers = scored.models["hf:organism:grounded"].answers
    demanded = [str(frame.truth["demand"]) for frame in answers.frames]
    right = sum(action == two for action, two in zip(answers.actions("real"), demanded, strict=True))
    assert right >= 0.95 * len(demanded)
    assert len(set(demanded)) == 5
