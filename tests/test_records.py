"""Records become plain values, as JSON and TOML have them."""

import ast
import importlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

import eyechart
from eyechart.records import JsonRecord, plain, to_json_fields


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


@dataclass(frozen=True)
class Named:
    """A record whose keys are not its fields."""

    inner: Inner
    other: Inner | None = None

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return to_json_fields(self, "inner twice", first=self.inner.pair)

    @property
    def twice(self) -> int:
        """Return what no field holds."""
        return 2 * sum(self.inner.pair)


def test_a_record_is_written_by_its_names_and_by_further_keys() -> None:
    """Properties among them, and the values of the keys as those of the names."""
    written = json.dumps(Named(Inner((1, 2))).as_dict())
    assert written == '{"inner": {"pair": [1, 2], "share": null}, "twice": 6, "first": [1, 2]}'


def names_of(method: ast.FunctionDef) -> Iterator[str]:
    """Yield the names that a method writes of its own record, also by way of a variable."""
    local = {ast.unparse(one.targets[0]): one.value for one in ast.walk(method) if isinstance(one, ast.Assign)}
    for call in ast.walk(method):
        if (
            isinstance(call, ast.Call)
            and ast.unparse(call.func) == "to_json_fields"
            and ast.unparse(call.args[0]) == "self"
        ):
            parts = list(ast.walk(call.args[1]))
            parts += [deep for one in parts if ast.unparse(one) in local for deep in ast.walk(local[ast.unparse(one)])]
            words = [part.value for part in parts if isinstance(part, ast.Constant) and isinstance(part.value, str)]
            yield from (name for word in words for name in word.split())


def test_names_that_a_record_is_written_by_are_there() -> None:
    """Every name in every package; mypy does not read them."""
    found: dict[str, list[str]] = {}
    for path in Path(eyechart.__path__[0]).rglob("*.py"):
        classes = [node for node in ast.parse(path.read_text(encoding="utf-8")).body if isinstance(node, ast.ClassDef)]
        for node in classes:
            names = [name for one in node.body if isinstance(one, ast.FunctionDef) for name in names_of(one)]
            if names:
                module = ".".join(("eyechart", *path.relative_to(eyechart.__path__[0]).with_suffix("").parts))
                kind = getattr(importlib.import_module(module.removesuffix(".__init__")), node.name)
                members = {*dir(kind), *(field.name for field in fields(kind))}
                assert members >= {*names}, (kind, {*names} - members)
                found[node.name] = names
    assert {"BatteryScore", "Degeneracy", "StructuredScore", "Verdict", "Look", "Statistic"} <= found.keys()
    assert len(found) > 25
