"""A pytest fixture for looks: ``pytest_plugins = ["eyechart.fixtures"]``."""

from collections.abc import Callable
from pathlib import Path

import pytest

from eyechart.api import look
from eyechart.looks import Look


@pytest.fixture(scope="session")
def looked(pytestconfig: pytest.Config) -> Callable[..., Look]:
    """Return `eyechart.api.look` with its folders in pytest's cache, so that no call is repeated.

    Each look has a folder by its ``name``, unless ``out`` is given.
    """
    cache = pytestconfig.cache
    if cache is None:
        pytest.fail("looks are kept in pytest's cache: do not switch off its plugin 'cacheprovider'")
    folder = Path(cache.mkdir("eyechart"))

    def make(subject: object, name: str, **how: object) -> Look:
        return look(subject, **{"out": folder / name, **how})  # type: ignore[arg-type]

    return make
