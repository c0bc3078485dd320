"""The runs that several tests of the report look at, and the browser that shows them."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

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


def chromium() -> str:
    """Return where Chromium is."""
    result = os.environ.get("EYECHART_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    assert result, "Chromium is not there: apt-get install chromium, or name one in EYECHART_CHROMIUM"
    return result


@pytest.fixture(scope="module")
def engine() -> Iterator[Any]:
    """Return a running Chromium."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - an extra

    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=chromium(), args=["--no-sandbox", "--disable-gpu"])
        yield running
        running.close()
