"""Options of the whole test run; they stand here so that plain ``pytest`` knows them too."""

from pathlib import Path

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add ``--vectors FILE``: other paper vectors than the copy in the repository.

    Without a path on the command line write ``--vectors=FILE``: pytest looks for this file beside its first
    argument, and would take a FILE of its own for that.
    """
    parser.addoption(
        "--vectors",
        type=Path,
        default=Path(__file__).parent / "paper" / "paper_vectors.json",
        metavar="FILE",
        help="the paper's numbers with their inputs, as JSON (default: tests/paper/paper_vectors.json)",
    )
