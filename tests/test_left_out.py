"""Tests that need an extra are left out by the name of its module, in whatever words pytest is called."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
BLOCKED = """
import importlib.util as util
real = util.find_spec
util.find_spec = lambda name, *more: None if name in {"pyarrow", "torch"} else real(name, *more)
"""


def collected(tmp_path: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Return what pytest collects of a file with a test of the extras, where two modules are not installed."""
    (tmp_path / "blocked.py").write_text(BLOCKED)
    words = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "blocked", "-p", "no:cacheprovider"]
    given = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT / "src")]), **environment}
    file = "tests/test_mutated_files.py"
    return subprocess.run(
        [*words, "-k", "broken", file], cwd=ROOT, env=given, capture_output=True, text=True, check=False
    )


def test_what_lacks_an_extra_is_left_out_by_name(tmp_path: Path) -> None:
    """And said in the summary, with the modules and what installs them; the file's other tests are there."""
    found = collected(tmp_path)
    assert found.returncode == 0, found.stdout
    assert "test_a_broken_data_set" not in found.stdout
    assert "tests that need" in found.stdout
    assert "pyarrow" in found.stdout
    assert "make test-models" in found.stdout
    assert "test_mutated_files.py::" in found.stdout


def test_nothing_is_left_out_where_the_extras_are_required(tmp_path: Path) -> None:
    """So that what is to run them cannot pass without them."""
    found = collected(tmp_path, EYECHART_EXTRAS="required")
    assert "test_a_broken_data_set" in found.stdout
    assert "tests that need" not in found.stdout
