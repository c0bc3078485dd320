"""Regular expressions that are compiled at first use, because a command needs few of them."""

import re
from typing import Any, cast


def pattern(text: str, flags: int = 0) -> re.Pattern[str]:
    """Return a pattern like `re.compile`, compiled at its first use."""
    return cast("re.Pattern[str]", _Pattern(text, flags))


class _Pattern:
    def __init__(self, text: str, flags: int) -> None:
        self._text, self._flags = text, flags

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever a pattern has
        if name.startswith("__"):  # copy and pickle ask for these first
            raise AttributeError(name)
        compiled = re.compile(self._text, self._flags)
        result = getattr(compiled, name)
        setattr(self, name, result)  # found directly from now on
        return result
