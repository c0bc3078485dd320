"""The files of a callable with their digests: its own, and its imports from below its folder.

They come from the import statements of each file, at any place in it, and from the values of loaded
modules. So the list is the same in every process, and complete before the first call. Installed
packages are left out. A module is not found if a call computes its name.
"""

import ast
import hashlib
import json
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import FunctionType, ModuleType

from eyechart.errors import printable
from eyechart.records import parse_json

OWN, FILES, FORMERLY = "file_sha256", "files", "formerly"
"""Facts of a callable: the digest of its own file, and those of all its files by name (JSON). The
third is its version in older runs, which covered only its own file."""
_INSTALLED = {"site-packages", "dist-packages"}
_SHOWN = 3


def facts_of(module: ModuleType | None) -> dict[str, str]:
    """Return the digests of the files of a callable's module; empty where it has no file."""
    if module is None or (file := _file(module)) is None:
        return {}
    files = _Folder(_root(module.__name__, file)).files(module.__name__, file)
    return {OWN: next(iter(files.values())), FILES: json.dumps(files)}


def version_of(facts: Mapping[str, str], *more: str) -> dict[str, str]:
    """Return a callable's ``version``, and the version that older runs recorded if it differs.

    ``more`` are further digests that the version includes.
    """
    own, files = facts[OWN], parse_json(facts[FILES])
    whole = own if len(files) == 1 else _digest(json.dumps(sorted(files.items())).encode())
    now, before = ((_digest("".join((one, *more)).encode()) if more else one)[:12] for one in (whole, own))
    return {"version": now} | ({FORMERLY: before} if before != now else {})


def is_formerly(version: str, facts: Mapping[str, str], now: Mapping[str, str]) -> bool:
    """Return whether an older run's version, of one file alone, is that of the callable ``now``."""
    return FILES not in facts and version == now.get(FORMERLY)


def changed(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Return in words which files differ between the facts of two versions; "" if not known."""
    old, new = _files(before), _files(now)
    if not old and new and before.get(OWN) not in {None, now.get(OWN)}:
        old = {**new, next(iter(new)): ""}
    if not old or not new:
        return ""
    found = (
        ("changed", [name for name in old if name in new and old[name] != new[name]]),
        ("imported now", [name for name in new if name not in old]),
        ("imported no more", [name for name in old if name not in new]),
    )
    return ", and ".join(f"{_some(names)} {'is' if len(names) == 1 else 'are'} {how}" for how, names in found if names)


def _some(names: list[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(map(printable, names[:_SHOWN])) + more


def _files(facts: Mapping[str, str]) -> dict[str, str]:
    try:
        found = parse_json(facts.get(FILES, "{}"))
    except ValueError:  # the run's manifest was edited
        return {}
    return {str(name): str(digest) for name, digest in found.items()} if isinstance(found, dict) else {}


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _file(module: ModuleType) -> Path | None:
    file = getattr(module, "__file__", None)
    return Path(file).absolute() if isinstance(file, str) and Path(file).is_file() else None


def _root(name: str, file: Path) -> Path:
    """Return the folder of a module's import; for an installed module, that of its own package."""
    parts = name.split(".")
    above = len(parts) - (file.stem != "__init__")
    root = file.parents[min(above, len(file.parents) - 1)]
    return root / parts[0] if _INSTALLED & set(root.parts) else root


@dataclass(frozen=True)
class _Folder:
    """A folder; its modules count as the callable's own."""

    root: Path

    def files(self, name: str, file: Path) -> dict[str, str]:
        """Return the digests of a module's file, then of its imports from this folder."""
        found, todo = dict[str, Path](), {name: file}
        while todo:
            name, file = todo.popitem()
            found[name] = file
            new = (other for other in _imports(name, file) if other not in found)
            todo |= {other: place for other in new if (place := self._of(other))}
        places = list(dict.fromkeys(found.values()))
        first, *others = ((self._name(one), _digest(one.read_bytes())) for one in places)
        return dict([first, *sorted(others)])

    def _of(self, name: str) -> Path | None:
        """Return the file of a module in this folder, loaded or not; None if it is elsewhere."""
        if name.partition(".")[0] in {"eyechart", "__main__"}:
            return None
        if (module := sys.modules.get(name)) is not None:
            places = [path] if (path := _file(module)) else []
        else:
            place = self.root.joinpath(*name.split("."))
            places = [place / "__init__.py", place.with_name(f"{place.name}.py")]
        return next((one for one in places if one.is_file() and self._is_own(one)), None)

    def _is_own(self, file: Path) -> bool:
        if not file.is_relative_to(self.root) or file.is_relative_to(sysconfig.get_path("stdlib")):
            return False
        return not _INSTALLED & set(file.relative_to(self.root).parts)

    def _name(self, file: Path) -> str:
        return file.relative_to(self.root).as_posix() if file.is_relative_to(self.root) else file.name


def _imports(name: str, file: Path) -> Iterator[str]:
    """Yield names that may be modules that this one imports, and the packages that hold them."""
    for one in (*_stated(name, file), *_standing(name)):
        parts = one.split(".")
        yield from (".".join(parts[:count]) for count in range(1, len(parts) + 1) if all(parts))


def _stated(name: str, file: Path) -> Iterator[str]:
    """Yield the names in its import statements, also inside functions."""
    try:
        tree = ast.parse(file.read_bytes()) if file.suffix == ".py" else ast.Module([], [])
    except (SyntaxError, ValueError):  # the file changed since it was loaded
        return
    package = name.split(".") if file.stem == "__init__" else name.split(".")[:-1]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (one.name for one in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            yield base
            yield from (f"{base}.{one.name}" for one in node.names)


def _standing(name: str) -> Iterator[str]:
    """Yield the modules of all values in a loaded module, whatever way they were imported."""
    for value in tuple(vars(sys.modules[name]).values()) if name in sys.modules else ():
        if isinstance(value, ModuleType):
            yield value.__name__
        else:
            where = value.__module__ if isinstance(value, FunctionType | type) else type(value).__module__
            if isinstance(where, str):
                yield where
