"""The runs that several tests of the report look at."""

from pathlib import Path

import pytest

import banks
import report_runs
import stand_ins


@pytest.fixture(scope="session")
def bank(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bank of eighteen frames that no test changes."""
    return banks.build_bank(tmp_path_factory.mktemp("report") / "bank").root


@pytest.fixture(scope="session")
def hostile(bank: Path, tmp_path_factory: pytest.TempPathFactory) -> report_runs.Reported:
    """Return the report on a model whose replies mean harm, and on one that always stops."""
    folder = tmp_path_factory.mktemp("hostile")
    run = report_runs.make_run(bank, folder / "run", {"hostile": report_runs.hostile, "steady": stand_ins.stop})
    return report_runs.report(run, folder / "report.html", bank)
