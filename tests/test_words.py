"""Names: a class stands once, a module is a noun, and neither has one of the words that nobody outside knows."""

import ast
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src"

STAY = {"eyechart/testing.py", "eyechart/importing", "eyechart/verdicts/ruling.py"}
"""Names in -ing that are nouns: two that users know, and a ruling."""

PRIVATE_CLASSES = """
About Added Addressing Again Ahead Allowed Answered Asked Asking AtMost Beside Blind Brought
Built Calibrated Calling Closed Coded Comparing Costing Counted Course Declared Derived
Described Discordant Drawn Driven Driving Early Embedded Ended Exchanged Extent Failure
Finding First Followed Found Frozen Full Given HalfBlind Halting Held How HowTold InStages
Judged Kept Known Lacking Later Left Loading Logged Looking Made Making Measured Met Mirrored
Misfit Moved Nested OfEpisodes OfFrames OfModel OnePolicy Online Opened Opening Packed
Paired Pictured Placed Plain Planned Planning Printed Published Read Recorded Reflected
Refused Remembering Rig Ruled Rung Said Same Scored Seen Sent Served Shared Shown Shows Sized
Speaker Spending Spent Stated Staying Stopped Streamed Structured Told Took Tried Twins
Unfinished Unobserved Unpacked Unread Unseen Use Usual Vetted Walk Wanted Who Wish Wording
Written
"""
"""Participles and riddles that were names of classes or of types."""

PRIVATE_MODULES = """
asked axes beside committee course described drawn early elsewhere flips guessing identical
known life logged loops notes patterns plain planned probed published reels seen sight stated
told uses wanted whole
"""
"""Participles and riddles that were names of modules."""


LONGEST = 29
"""Words of a sentence, at most."""


def sentences_of(text: str) -> list[str]:
    """Return the sentences of a docstring or of a help text, paragraph by paragraph."""
    parts = (" ".join(part.split()) for part in re.split(r"\n\s*\n", text))
    return [one for part in parts for one in re.split(r"(?<=[.!?])\s+", part) if one]


def long_ones(tree: ast.Module) -> set[str]:
    """Return the names of what has a docstring or a help text with a sentence that is too long."""
    found = set()
    for node in ast.walk(tree):
        said: list[tuple[str, str | None]] = []
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            said.append((getattr(node, "name", ""), ast.get_docstring(node)))
        elif isinstance(node, ast.keyword) and node.arg == "help":
            texts = (one.value for one in ast.walk(node.value) if isinstance(one, ast.Constant))
            said.append((f"help, line {node.value.lineno}", "".join(text for text in texts if isinstance(text, str))))
        found |= {name for name, text in said for one in sentences_of(text or "") if len(one.split()) > LONGEST}
    return found


@cache
def types() -> dict[str, list[str]]:
    """Return where each class of the source is defined, inside another one or a function too."""
    found = defaultdict(list)
    for path in sorted(SOURCE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                found[node.name].append(path.relative_to(SOURCE).as_posix())
    return dict(found)


def aliases() -> dict[str, str]:
    """Return where the names of types are given that are no class: assignments at the top of a module."""
    found = {}
    for path in sorted(SOURCE.rglob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            for target in node.targets if isinstance(node, ast.Assign) else ():
                if isinstance(target, ast.Name) and re.match(r"_?[A-Z]\w*[a-z]", target.id):
                    found[target.id] = path.relative_to(SOURCE).as_posix()
    return found


def modules() -> list[Path]:
    """Return the modules and packages of the source."""
    return [path for path in sorted(SOURCE.rglob("*")) if path.suffix == ".py" or (path / "__init__.py").is_file()]


def test_a_class_name_stands_once() -> None:
    """One name means one thing, so that a reader who finds it knows what it is."""
    assert len(types()) > 500
    assert {name: places for name, places in types().items() if len(places) > 1} == {}


def test_a_class_is_called_by_what_it_is() -> None:
    """Neither a participle alone nor a riddle, public or private; a name of a type is none either."""
    named = {**aliases(), **{name: places[0] for name, places in types().items()}}
    private = {name: place for name, place in named.items() if name.lstrip("_") in PRIVATE_CLASSES.split()}
    assert private == {}


def test_a_class_is_no_lone_word_in_ing() -> None:
    """What is done to a thing is a function; ``Reading`` is what a rule reads, ``Drawing`` a figure."""
    words = {name for name in types() if re.fullmatch(r"_?[A-Z][a-z]*ing", name)}
    assert words == {"Drawing", "Reading", "Resampling", "Ruling", "Setting"}


def test_a_module_is_a_noun() -> None:
    """No module is a word in -ing but those that users know."""
    found = {path.relative_to(SOURCE).as_posix() for path in modules() if path.stem.endswith("ing")}
    assert found == STAY


def test_a_module_is_called_by_what_it_holds() -> None:
    """Neither a participle alone nor a riddle."""
    assert {path.relative_to(SOURCE).as_posix() for path in modules() if path.stem in PRIVATE_MODULES.split()} == set()


def test_no_sentence_of_a_docstring_or_of_help_has_thirty_words() -> None:
    """But those whose files wait for a measurement; one that is mended leaves the list."""
    found = {
        f"{path.relative_to(SOURCE).as_posix()}:{name}"
        for path in sorted(SOURCE.rglob("*.py"))
        for name in long_ones(ast.parse(path.read_text(encoding="utf-8")))
    }
    assert found == set()


@pytest.mark.parametrize("words", [28, 29, 30])
def test_a_long_sentence_is_found_in_a_docstring_and_in_help(words: int) -> None:
    """Of a function, of a module and of an option; two short ones are none, with a blank line between them or not."""
    text = " ".join(["word"] * words)
    said = f'"""{text}."""\ndef f(a: Annotated[int, typer.Option(help="{text}.")]):\n    """Short. {text[5:]}."""\n'
    assert long_ones(ast.parse(said)) == ({"", "help, line 2"} if words > LONGEST else set())


PRIVATE_NAMES = {"told", "asked"}
"""Words that meant ten things each: a variable, a parameter, a field or a function has the noun of its meaning."""

TYPED = {("eyechart/inspect.py", "asked")}
"""What users type: ``inspect eval eyechart/battery -T asked=FOLDER``."""

PREDICATES = {"is", "are", "has", "can", "may", "was", "were"}
"""The heads of a predicate."""

VERBS = """
applies asks blocks calls clears commits contradicts corrects crosses differs disagrees draws earns
fails fits flickers flips goes holds joins keeps lacks leaves looks makes moves names numbers
overlaps passes reads refuses rests says sees shows spans states takes thinks touches turns varies
wants
"""
"""Verbs in the third person, which read well at a call: ``clause.holds(statistics)``."""

DEEDS = {
    "eyechart/limits.py:turn",
    "eyechart/models/event_stream.py:_add",
    "eyechart/models/python_callable.py:give_up",
    "eyechart/spaces/scene.py:_flag",
    "eyechart/studies/guardian/votes.py:hazard_of",
}
"""No predicates: they wait, add or end something and say how it went, or read a value that is true or false."""


def trees() -> dict[str, ast.Module]:
    """Return the syntax tree of each module of the source, and of what makes the model organisms."""
    homes = (SOURCE, SOURCE.parent / "organisms")
    paths = {path.relative_to(home).as_posix(): path for home in homes for path in sorted(home.rglob("*.py"))}
    source = {name: path for name, path in paths.items() if not name.startswith("build/")}  # a wheel's copy of it
    return {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in source.items()}


def identifiers(tree: ast.Module) -> set[str]:
    """Return the names that a module gives or uses: of variables, parameters, fields, functions and classes."""
    found = set()
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name) | ast.Attribute(attr=name) | ast.arg(arg=name) | ast.keyword(arg=str(name)):
                found.add(name)
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                found.add(name)
            case ast.ExceptHandler(name=str(name)) | ast.MatchAs(name=str(name)) | ast.MatchStar(name=str(name)):
                found.add(name)
            case ast.alias(name=name, asname=other):
                found |= {name, other or name}
    return found


def misnamed_predicates(tree: ast.Module) -> set[str]:
    """Return the functions that return bool and begin neither as a predicate does nor with a verb."""
    return {
        node.name
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and node.returns is not None
        and ast.unparse(node.returns).strip("'\"") == "bool"
        and not (node.name.startswith("__") and node.name.endswith("__"))
        and node.name.lstrip("_").partition("_")[0] not in PREDICATES.union(VERBS.split())
    }


def test_a_name_is_the_noun_of_its_meaning() -> None:
    """Whatever it names, and private or not."""
    named = {(module, name) for module, tree in trees().items() for name in identifiers(tree)}
    assert len(named) > 10_000
    assert {(module, name) for module, name in named if name.strip("_") in PRIVATE_NAMES} == TYPED


@pytest.mark.parametrize(
    "code",
    [
        "told = 1",
        "def f(told): ...",
        "def f(*, told=1): ...",
        "def told(): ...",
        "class A:\n    told: int",
        "a.told",
        "f(told=1)",
        "from a import told",
        "import a as told",
        "[told for told in a]",
        "(told := 1)",
        "try: ...\nexcept E as told: ...",
        "match a:\n    case [*told]: ...",
    ],
)
def test_a_private_name_is_found_wherever_it_stands(code: str) -> None:
    """A string or a comment is no name."""
    assert "told" in identifiers(ast.parse(code))
    assert "told" not in identifiers(ast.parse(f"f({code!r})  # told"))


def test_a_predicate_says_that_it_is_one() -> None:
    """Every function that returns bool; what does or reads something and returns bool stands in a list."""
    found = {f"{module}:{name}" for module, tree in trees().items() for name in misnamed_predicates(tree)}
    assert found == DEEDS


@pytest.mark.parametrize(
    ("name", "returns", "wrong"),
    [
        ("is_near", "bool", False),
        ("_has", "bool", False),
        ("holds", "bool", False),
        ("_names_a_key", "'bool'", False),
        ("__eq__", "bool", False),
        ("near", "float", False),
        ("near", "bool", True),
        ("_settled", "'bool'", True),
        ("isnt", "bool", True),
    ],
)
def test_a_predicate_is_known_by_its_head(name: str, returns: str, *, wrong: bool) -> None:
    """The whole first word, without underscores before it; a method too."""
    code = f"class A:\n    async def {name}(self) -> {returns}: ..."
    assert misnamed_predicates(ast.parse(code)) == ({name} if wrong else set())
