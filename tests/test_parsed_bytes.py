"""What parses bytes of others reads each input of the kept corpus: an answer, or an error in words."""

import ast
from pathlib import Path

import pytest

from matrix.targets import CORPUS, TARGETS, parse

ROOT = Path(__file__).parents[1]
KEPT = [path.relative_to(CORPUS).as_posix() for path in sorted(CORPUS.rglob("*")) if path.is_file()]


@pytest.mark.parametrize("name", KEPT)
def test_each_input_of_the_corpus_is_read_or_refused_in_words(name: str) -> None:
    """What coverage-guided fuzzing begins with; what it found once stays here."""
    parse(name.partition("/")[0], (CORPUS / name).read_bytes())


@pytest.mark.parametrize("target", TARGETS)
def test_each_target_reads_one_input_of_its_corpus_to_its_end(target: str) -> None:
    """Else the fuzzer would begin at the door and never come in."""
    TARGETS[target]((CORPUS / min(name for name in KEPT if name.startswith(f"{target}/"))).read_bytes())


def test_the_fuzzer_knows_every_target_without_importing_it() -> None:
    """It measures what it imports, so that its list stands beside."""
    tree = ast.parse((ROOT / "benchmarks" / "atheris_doors.py").read_text(encoding="utf-8"))
    assigned = {
        node.targets[0].id: node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
    }
    names = ast.literal_eval(assigned["NAMES"])
    assert list(names) == list(TARGETS)
    assert {name.partition("/")[0] for name in KEPT} == TARGETS.keys()


def test_an_input_that_raises_what_is_no_error_in_words_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Or the tests above could not fail."""
    from matrix import targets  # noqa: PLC0415 - to be changed

    monkeypatch.setattr(targets, "TARGETS", {"replies": lambda data: 1 / len(data)})
    with pytest.raises(ZeroDivisionError):
        parse("replies", b"")
