from pathlib import Path

import pytest

import banks
from eyechart import stimuli
from eyechart.conditions import BATTERY, show
from eyechart.stimuli import Stimuli


def test_pictures_are_those_of_the_conditions_however_few_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Within a bound of number or of bytes, and read from disk once where all are kept."""
    bank = banks.build_bank(tmp_path / "bank", scenarios=["light", "dense"], episodes=1)
    expected = {(name, frame.id): show(name, frame, bank, 3) for name in BATTERY for frame in bank}
    for bound in ("_MOST_PICTURES", "_MOST_BYTES"):
        with monkeypatch.context() as tight:
            tight.setattr(stimuli, bound, 2)
            few = Stimuli(bank, 3)
            assert {name: few.show(*name) for name in expected} == expected
            assert len(few._made._kept) <= 2
    kept = Stimuli(bank, 3)
    assert {name: kept.show(*name) for name in expected} == expected
    for frame in bank:
        (bank.root / frame.file).unlink()
    assert {name: kept.show(*name) for name in expected} == expected


def test_what_is_seen_once_is_made_once_and_not_kept(tmp_path: Path) -> None:
    """It is the same at every use, and takes no memory between."""
    bank = banks.build_bank(tmp_path / "bank", scenarios=["light", "dense"], episodes=1)
    once, frame = Stimuli(bank, 3, kept=False), bank.frames[0]
    for name in BATTERY:
        assert once.show(name, frame.id) == show(name, frame, bank, 3)
    assert len(once._made._kept) == 0
