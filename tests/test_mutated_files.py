"""Files that were broken by mutation are read, or refused in words: a short form of ``make long-fuzz``."""

from pathlib import Path

import pytest

from mutated_files import data_set, subjects, wholes

SINGLE = {"ledgers": 40, "modes": 300, "prompts": 300, "tables": 300, "guardians": 150}
WHOLE = {"bundles": 2, "banks": 6}
DATA_SETS = 80


@pytest.mark.parametrize("kind", SINGLE)
def test_a_broken_file_is_read_or_refused_in_words(tmp_path: Path, kind: str) -> None:
    """No other error comes, whatever stands in it; the mutations follow from their numbers."""
    (tmp_path / "work").mkdir()
    subject = subjects(tmp_path / "work")[kind]
    assert [found for number in range(SINGLE[kind]) if (found := subject.wrong(number, tmp_path))] == []


@pytest.mark.parametrize("kind", WHOLE)
def test_a_broken_bundle_or_bank_is_read_or_refused_in_words(tmp_path: Path, kind: str) -> None:
    """Its digests were mended by whoever broke it."""
    (tmp_path / "work").mkdir()
    wrong = wholes(tmp_path / "work")[kind]
    for number in range(WHOLE[kind]):
        folder = tmp_path / str(number)
        folder.mkdir()
        assert wrong(number, folder) is None


@pytest.mark.models
def test_a_broken_data_set_is_read_or_refused_in_words(tmp_path: Path) -> None:
    """A LeRobotDataset of which a description, a cell, a column, a film or a file is another."""
    wrong, found = data_set(tmp_path / "work"), []
    for number in range(DATA_SETS):
        folder = tmp_path / str(number)
        folder.mkdir()
        found.append(wrong(number, folder))
    assert [one for one in found if one is not None] == []
