"""Records become plain values, as JSON and TOML have them."""

import json
from dataclasses import dataclass

import numpy as np

from eyechart.records import Plain, plain


@dataclass(frozen=True, slots=True)
class Inner(Plain):
    """A record of two fields."""

    pair: tuple[int, int]
    share: float | None = None


class Own:
    """What writes itself otherwise."""

    def as_dict(self) -> dict[str, object]:
        """Return what it says."""
        return {"own": True}


@dataclass(frozen=True, slots=True)
class Outer(Plain):
    """A record of records."""

    inner: Inner
    named: dict[str, Own]


def test_a_record_is_its_fields_in_order_with_its_records_in_their_own_words() -> None:
    """Nested records and tuples are written too."""
    written = Outer(Inner((1, 2)), {"a": Own()}).as_dict()
    assert json.dumps(written) == '{"inner": {"pair": [1, 2], "share": null}, "named": {"a": {"own": true}}}'


def test_numbers_of_numpy_become_numbers_of_python() -> None:
    """No number of numpy is left for JSON to refuse."""
    values = plain({"n": np.int64(3), "rates": (np.float64(0.5), 1.5), "is": np.bool_(True)})
    assert json.dumps(values) == '{"n": 3, "rates": [0.5, 1.5], "is": true}'
