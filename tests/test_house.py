"""How the house is kept, measured over its source: what is too tangled, too wide, guessed at, or there twice.

Each list of exceptions is exact: what is mended is taken out of it, and nothing is added.
"""

import ast
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from radon.complexity import cc_visit_ast
from radon.visitors import Class, Function

SOURCE = Path(__file__).parents[1] / "src"
TEXTS = {
    path.relative_to(SOURCE).as_posix().removeprefix("eyechart/"): path.read_text(encoding="utf-8")
    for path in sorted(SOURCE.rglob("*.py"))
}
COMPLEXITY = 20
"""The most ways through a function; more is radon's rank D."""

TANGLED: set[str] = set()

PARAMETERS = 8
"""The most parameters of a function, but of a command, whose parameters are its options."""

WIDE: set[str] = set()

OTHERS = {
    "cli/terminal.py: hasattr(os, 'sched_getaffinity')",
    "frames/plain_pictures.py: getattr(found, 'n_frames', 1)",
    "models/huggingface/checkpoint.py: getattr(processor, 'chat_template', None)",
    "models/huggingface/checkpoint.py: getattr(processor, 'image_processor', None)",
    "models/huggingface/checkpoint.py: getattr(processor, 'tokenizer', None)",
    "models/ollama.py: getattr(error, 'reason', error)",
    "models/sources.py: getattr(module, '__file__', None)",
    "studies/closed_loop/film.py: getattr(av, 'codecs_available', set())",
    "spaces/motion.py: getattr(given, 'shape', None)",
    "spaces/motion.py: getattr(given[0], 'shape', ())",
    "spaces/motion.py: hasattr(given, '__array__')",
    "simulators/gym/drive.py: getattr(self._env.unwrapped, 'np_random', None)",
    "simulators/gym/drive.py: hasattr(self._env.unwrapped, 'enable_auto_render')",
}
"""Members of other people's objects, which differ by platform, version or kind."""

LINES, COPIED = 6, 0.006
"""The largest share of lines that stand in a run of so many lines that is there twice, word for word."""


@cache
def trees() -> dict[str, ast.Module]:
    """Return the syntax tree of every module."""
    return {module: ast.parse(text) for module, text in TEXTS.items()}


def functions() -> Iterator[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef]]:
    """Yield every function of the house with its module."""
    for module, tree in trees().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield module, node


def blocks(found: list[Function | Class]) -> Iterator[Function]:
    """Yield the functions among what radon found, those of classes and in functions too."""
    for block in found:
        if isinstance(block, Class):
            yield from blocks([*block.methods, *block.inner_classes])
        else:
            yield block
            yield from blocks(block.closures)


def compare(found: set[str], listed: set[str], what: str) -> None:
    """Fail with what is new and with what is mended."""
    new, gone = sorted(found - listed), sorted(listed - found)
    assert not new, f"{what}: {new}"
    assert not gone, f"mended, so take it out of the list of {what}: {gone}"


def test_no_function_is_tangled() -> None:
    """Not by radon's measure."""
    found = {
        f"{module}: {block.name}"
        for module, tree in trees().items()
        for block in blocks(cc_visit_ast(tree))
        if block.complexity > COMPLEXITY
    }
    compare(found, TANGLED, f"more than {COMPLEXITY} ways through a function")


def test_no_function_takes_more_parameters_than_one_can_hold() -> None:
    """A command is no exception by size but by kind: its parameters are the options of the command line."""
    found = set()
    for module, node in functions():
        given = node.args
        named = [one.arg for one in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
        if named[:1] in (["self"], ["cls"]):
            named = named[1:]
        if len(named) + bool(given.vararg) + bool(given.kwarg) > PARAMETERS and not module.startswith("cli/"):
            found.add(f"{module}: {node.name}")
    compare(found, WIDE, f"more than {PARAMETERS} parameters")


def test_no_door_is_guessed_at() -> None:
    """What may be asked of an object stands in its Protocol."""
    found = set()
    for module, tree in trees().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                named = len(node.args) > 1 and isinstance(node.args[1], ast.Constant)
                if node.func.id == "hasattr" or (node.func.id == "getattr" and named):
                    found.add(f"{module}: {ast.unparse(node)}")
    compare(found, OTHERS, "members that no door declares")


def test_hardly_a_line_is_there_twice() -> None:
    """The places are named, those with most lines first."""
    places: dict[tuple[str, ...], list[tuple[str, int]]] = defaultdict(list)
    for module, text in TEXTS.items():
        lines = [line.strip() for line in text.splitlines()]
        for at in range(len(lines) - LINES + 1):
            if all(lines[at : at + LINES]):
                places[tuple(lines[at : at + LINES])].append((module, at))
    twice = {
        (module, at + n) for found in places.values() if len(found) > 1 for module, at in found for n in range(LINES)
    }
    total = sum(len(text.splitlines()) for text in TEXTS.values())
    by_module: dict[str, list[int]] = defaultdict(list)
    for module, line in sorted(twice):
        by_module[module].append(line + 1)
    most = sorted(by_module.items(), key=lambda one: -len(one[1]))[:8]
    named = "\n".join(f"{module}: lines {lines}" for module, lines in most)
    assert len(twice) / total <= COPIED, f"{len(twice)} of {total} lines are copies:\n{named}"


@pytest.mark.parametrize("word", ["utils", "common", "base", "manager", "helper", "helpers", "misc"])
def test_no_module_is_named_for_nothing(word: str) -> None:
    """A module is named for the noun that it holds."""
    assert not [module for module in TEXTS if word in Path(module).stem.split("_")]


def test_an_equivalent_mutant_is_of_a_line_that_stands_in_the_code() -> None:
    """With a reason, another line in its place, and none twice: what was changed since is judged anew."""
    path = SOURCE.parent / "benchmarks" / "equivalent_mutants.toml"
    listed = tomllib.loads(path.read_text(encoding="utf-8"))["mutant"]
    assert len({(one["module"], one["out"], one["in"]) for one in listed}) == len(listed)
    for one in listed:
        text = TEXTS[one["module"].removeprefix("eyechart.").replace(".", "/") + ".py"]
        assert set(one["out"].splitlines()) <= {line.strip() for line in text.splitlines()}, one["out"]
        assert one["in"] != one["out"]
        assert one["reason"]


TOLD = {"note", "method", "detail", "because"}
"""What a statistic or a ruling tells people: it is printed whole, and nothing is decided by it."""

CUT = {"count", "endswith", "find", "get", "index", "partition", "removeprefix", "removesuffix", "rpartition", "split"}
"""What takes a part of a text or a table, or looks whether it is there; besides these ``startswith``."""

BY_WORDS = {
    "studies/policy/tables.py",
}
"""The modules that still read what is told of statistics of policies."""

OF_OTHERS = {"report/table.py: one.note == first.note", "serve/server.py: request.method not in _READS"}
"""The note of a table, and the method of a request."""


def _told(node: ast.expr) -> bool:
    """Return whether an expression is what a statistic tells, or that or something else."""
    if isinstance(node, ast.BoolOp):
        return any(map(_told, node.values))
    return isinstance(node, ast.Attribute) and node.attr in TOLD


def _decides(node: ast.AST) -> bool:
    """Return whether a node compares what a statistic tells, or takes a part of it."""
    if isinstance(node, ast.Compare):
        absent = any(isinstance(one, ast.Is | ast.IsNot) for one in node.ops)
        return not absent and any(map(_told, (node.left, *node.comparators)))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        return node.func.attr in {*CUT, "startswith"} and _told(node.func.value)
    return isinstance(node, ast.Subscript) and _told(node.value)


def test_nothing_is_decided_by_what_a_statistic_tells_people() -> None:
    """Outside ``stats`` a number that decides is a field; a note, a method, a detail or a reason is printed whole."""
    found = {
        (module, f"{module}: {ast.unparse(node)}")
        for module, tree in trees().items()
        if not module.startswith("stats/")
        for node in ast.walk(tree)
        if _decides(node)
    }
    compare({said for module, said in found if module not in BY_WORDS}, OF_OTHERS, "words that decide")
    compare({module for module, _ in found if module in BY_WORDS}, BY_WORDS, "modules that decide by words")


@pytest.mark.parametrize(
    "code",
    [
        "one.method.startswith('one-sided')",
        "'do not vary' in noise.note",
        "found.because[:-1]",
        "(one.detail or {}).get('same') == 1.0",
        "one.detail['k']",
        "one.note.partition('; ')[2]",
    ],
)
def test_what_decides_by_words_is_found(code: str) -> None:
    """Each way to take a text apart; to print it whole, or to ask whether there is any, decides nothing by it."""
    assert any(map(_decides, ast.walk(ast.parse(code))))
    assert not any(map(_decides, ast.walk(ast.parse("print(one.note if one.detail is not None else one.method)"))))


SPACES = {"Space", "Discrete", "SceneSpace", "MotionSpace"}
"""The kinds of spaces, whatever they are called where they are imported."""


def kinds_asked(tree: ast.Module) -> list[str]:
    """Return where a module asks which kind of space something is: by isinstance, its type, or a pattern."""
    named = {
        name.asname or name.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("eyechart.spaces")
        for name in node.names
        if name.name in SPACES
    }

    def is_kind(node: ast.AST) -> bool:
        return any(
            (isinstance(one, ast.Name) and one.id in named)
            or (isinstance(one, ast.Attribute) and one.attr in SPACES and not ast.unparse(one).startswith("gymnasium"))
            for one in ast.walk(node)
        )

    asked = []
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name)
            and node.func.id in {"isinstance", "issubclass"}
        ):
            asked += [node] if is_kind(node.args[1]) else []
        elif isinstance(node, ast.Compare) and any(isinstance(one, ast.Is | ast.IsNot | ast.Eq) for one in node.ops):
            asked += (
                [node]
                if any(is_kind(comparator) for comparator in node.comparators if isinstance(comparator, ast.Name))
                else []
            )
        elif isinstance(node, ast.MatchClass) and is_kind(node.cls):
            asked.append(node)
    return [ast.unparse(one) for one in asked]


def test_nobody_outside_its_room_asks_which_kind_of_space_it_is() -> None:
    """What differs between spaces is a member of them; a new space is one module."""
    asked = {module: found for module, tree in trees().items() if (found := kinds_asked(tree))}
    assert {module: found for module, found in asked.items() if not module.startswith("spaces/")} == {}


@pytest.mark.parametrize(
    "code",
    [
        "from eyechart.spaces.motion import MotionSpace\nisinstance(one, int | MotionSpace)",
        "from eyechart.spaces.discrete import Discrete as D\nisinstance(one, (str, D))",
        "from eyechart.spaces import scene\nisinstance(one, scene.SceneSpace)",
        "from eyechart.spaces.scene import SceneSpace\ntype(one) is SceneSpace",
        "from eyechart.spaces.scene import SceneSpace\nmatch one:\n    case SceneSpace():\n        pass",
    ],
)
def test_who_asks_which_kind_of_space_it_is_is_found(code: str) -> None:
    """In each way in which that can be asked; an environment of Gymnasium has spaces of its own."""
    assert kinds_asked(ast.parse(code))
    assert not kinds_asked(ast.parse("isinstance(one, gymnasium.spaces.Discrete)"))


def test_one_registry_is_called_policies() -> None:
    """The adapters of policies, which are models; drivers that need no model are references."""
    named = [
        module
        for module, tree in trees().items()
        for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign)
        and any(isinstance(one, ast.Name) and one.id == "POLICIES" for one in ast.walk(node) if one is not node.value)
    ]
    assert named == ["models/__init__.py"]
