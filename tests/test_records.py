"""Records become plain values, as JSON and TOML have them."""

import importlib
import json
import pkgutil
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np

import eyechart.studies
from eyechart.records import JsonRecord, KeyedRecord, plain


@dataclass(frozen=True, slots=True)
class Inner(JsonRecord):
    """A record of two fields."""

    pair: tuple[int, int]
    share: float | None = None


class Own:
    """What writes itself otherwise."""

    def as_dict(self) -> dict[str, object]:
        """Return what it says."""
        return {"own": True}


@dataclass(frozen=True, slots=True)
class Outer(JsonRecord):
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


@dataclass(frozen=True, slots=True)
class Named(KeyedRecord):
    """A record that says what of it is written, and how that is called."""

    written = "first=inner.pair *inner other.share twice"

    inner: Inner
    other: Inner | None = None

    @property
    def twice(self) -> int:
        """Return what no field holds."""
        return 2 * sum(self.inner.pair)


def test_a_record_is_written_as_it_says() -> None:
    """By keys and paths in their order, all keys of a part among them, and what is not there as null."""
    written = Named(Inner((1, 2))).as_dict()
    assert json.dumps(written) == '{"first": [1, 2], "pair": [1, 2], "share": null, "twice": 6}'
    assert Named(Inner((1, 2)), Inner((3, 4), 0.5)).as_dict()["share"] == 0.5


def kinds(of: type) -> Iterator[type]:
    """Yield every class that derives from another, of eyechart's own."""
    for kind in of.__subclasses__():
        yield from kinds(kind)
        if kind.__module__.startswith("eyechart."):
            yield kind


def test_what_records_say_is_written_of_them_is_there() -> None:
    """The first word of every path is a member of its record."""
    for found in pkgutil.walk_packages(eyechart.studies.__path__, "eyechart.studies."):
        importlib.import_module(found.name)
    found = {kind.__name__: kind for kind in kinds(KeyedRecord)}
    assert {"BatteryScore", "Degeneracy", "StructuredScore"} <= found.keys()
    for kind in found.values():
        members = {*dir(kind), *(field.name for field in fields(kind))}
        for word in kind.written.split():
            assert word.rpartition("=")[2].removeprefix("*").partition(".")[0] in members, (kind, word)
