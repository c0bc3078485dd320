"""What tells how far a work is, where standard error is no terminal."""

import time

import pytest

from eyechart.cli.terminal import progress


def test_a_second_part_of_a_work_has_a_rate_of_its_own(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The count falls from the rows that were read to the frames that are written, and no rate is below 0."""
    now = iter(range(0, 1000, 3))
    monkeypatch.setattr(time, "monotonic", lambda: next(now))
    with progress("import", "rows") as move:
        for done, total in ((5000, 9000), (9000, 9000), (1, 90), (45, 90), (90, 90)):
            move(done, total)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) >= 4
    assert not any("-" in line for line in lines)
    assert lines[-1].startswith("import: 90/90 rows")
