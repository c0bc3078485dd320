"""The architecture is a list: imports point down it, and modules of one layer do not import each other."""

import ast
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1] / "src"

LAYERS: tuple[tuple[str, ...], ...] = (
    ("__main__",),
    ("cli", "fixtures"),
    ("testing", "api", "bundle", "inspect", "paper"),
    ("looks",),
    ("serve",),
    ("calibrate", "compare", "transfer", "guardian", "overview", "eyechart_organisms"),
    ("studies", "edits"),
    ("report",),
    ("gate", "destination"),
    ("verdicts",),
    ("episodes",),
    ("planned_run",),
    ("run", "manifest", "costs", "integrity", "probe"),
    ("attempts",),
    ("models", "simulators", "policies", "ledger", "prompts", "importing", "limits", "stimuli"),
    ("perception", "mpc"),
    ("calls", "conditions", "modes"),
    ("channels", "messages", "corruptions"),
    ("frames",),
    ("spaces",),
    ("stats", "cameras", "event_loops", "formats", "clusters", "kept"),
    ("errors", "seeds", "records", "keys"),
    ("processes", "scratch"),
)
"""Top to bottom. A name is a module or a package of ``eyechart``, or the other distribution's package as a whole.

``probe`` stands beside ``run``: it asks models and reads replies, as a run does, and knows no study, ledger or verdict;
``integrity`` reads what it measured from the mode, not from it.
"""

FLOORS = {
    "stats": (
        "eyechart.stats.statistic",
        "eyechart.stats.shares",
        "eyechart.stats.association",
        "eyechart.stats.agreement",
        "eyechart.stats.jackknife",
        "eyechart.stats.margins",
    ),
    "models": (
        "eyechart.models.faults",
        "eyechart.models.http",
        "eyechart.models.event_stream",
        "eyechart.models.energy",
        "eyechart.models.sources",
        "eyechart.models.batches",
        "eyechart.models.python_callable",
        "eyechart.models.policy_callable",
    ),
    "simulators": (
        "eyechart.simulators.camera",
        "eyechart.simulators.banks",
        "eyechart.simulators.plan",
        "eyechart.simulators.road",
    ),
    "studies": (
        "eyechart.studies.battery",
        "eyechart.studies.battery.album",
        "eyechart.studies.battery.subjects",
        "eyechart.studies.closed_loop",
        "eyechart.studies.closed_loop.browser",
        "eyechart.studies.closed_loop.page",
        "eyechart.studies.closed_loop.visual_dependence",
        "eyechart.studies.closed_loop.tables",
        "eyechart.studies.probes",
    ),
}
"""Inside a package whose modules are peers, only its floor is shared: for statistics, tables of counts, how they are
drawn, and rates; for models, a request, what is streamed, energy, and the files and batches of callables; for
simulators, the forward camera, how a balanced bank is planned and written, and the road of rover and drone; for
studies, the battery, the drives that others are scored with, and what a probe needs of each."""

ASSEMBLED = {
    "api",
    "bundle",
    "calibrate",
    "cli",
    "conditions",
    "edits",
    "episodes",
    "eyechart_organisms",
    "frames",
    "guardian",
    "importing",
    "ledger",
    "looks",
    "models.huggingface",
    "models.lerobot",
    "probe",
    "report",
    "serve",
    "simulators.drone",
    "simulators.gym",
    "simulators.highway",
    "simulators.road",
    "simulators.rover",
    "simulators.tabletop",
    "spaces",
    "studies.battery",
    "studies.hierarchy",
    "studies.closed_loop",
    "studies.guardian",
    "studies.policy",
    "studies.structured",
    "verdicts",
}
"""Packages that are one room split into modules: their modules import each other, without a cycle."""

PACKAGES = {"eyechart", "eyechart_organisms"}
ALLOWED_FROM_ANYWHERE = PACKAGES
"""A package itself holds the version and imports nothing of the tree, but ``look`` where somebody asks for it."""
LATE = {"eyechart": {"eyechart.api"}}

DOORS = {"models", "simulators", "policies", "studies"}
"""Packages whose ``__init__`` is the floor of their modules: the Protocol, and the registry that opens them by name."""

OPENS_BY_NAME = {
    "eyechart.models",
    "eyechart.models.energy",
    "eyechart.models.python_callable",
    "eyechart.policies",
    "eyechart.simulators",
    "eyechart.formats",
    "eyechart.studies",
    "eyechart.importing.parquet",
}
"""The only modules that import by a name that is not written as an import: registries, extras, and a user's own."""


BY_NAME = {"import_module", "__import__"}


@cache
def modules(root: Path = ROOT) -> dict[str, ast.Module]:
    """Return every module below ``root`` by its dotted name."""
    paths = sorted(path for package in sorted(PACKAGES) for path in (root / package).rglob("*.py"))
    return {name_of(path, root): parsed(path.read_text(encoding="utf-8")) for path in paths}


@cache
def parsed(text: str) -> ast.Module:
    """Return a module's syntax tree; what stands unchanged in another copy of the source is parsed once."""
    return ast.parse(text)


def name_of(path: Path, root: Path = ROOT) -> str:
    """Return the dotted name of a module's file."""
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def named(tree: ast.Module) -> tuple[tuple[ast.Import | ast.ImportFrom, ...], bool]:
    """Return the imports of a module, at its top or inside a function, and whether it imports by name."""
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    words = {getattr(node, "id", getattr(node, "attr", getattr(node, "name", None))) for node in ast.walk(tree)}
    return tuple(nodes), bool(words & BY_NAME)


def imports(tree: ast.Module, known: set[str]) -> Iterator[str]:
    """Yield the modules of the tree that a module imports."""
    for node in named(tree)[0]:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.split(".")[0] in PACKAGES)
        elif node.level:
            yield "a relative import"
        elif (node.module or "").split(".")[0] in PACKAGES:
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield full if full in known else str(node.module)


def part_of(module: str) -> str:
    """Return the module or package of ``eyechart`` to which a module belongs; the other distribution's is one."""
    package, _, inside = module.partition(".")
    return inside.partition(".")[0] if package == "eyechart" else package


def layer_of(module: str) -> int:
    """Return the number of a module's layer, counted from the top."""
    first = part_of(module)
    for number, names in enumerate(LAYERS):
        if first in names:
            return number
    raise AssertionError(f"{module} stands in no layer: add it to LAYERS")


def room_of(module: str) -> str:
    """Return the assembled package that a module belongs to, or the module itself."""
    inside = module.removeprefix("eyechart.")
    return next((room for room in ASSEMBLED if f"{inside}.".startswith(f"{room}.")), inside)


def violations(trees: Mapping[str, ast.Module]) -> list[str]:
    """Return every import that the architecture forbids, in words."""
    wrong = []
    for module, tree in trees.items():
        if module not in OPENS_BY_NAME and named(tree)[1]:
            wrong.append(f"{module} imports by name, which only {sorted(OPENS_BY_NAME)} may")
        if module in ALLOWED_FROM_ANYWHERE:
            late = LATE.get(module, set())
            wrong += [
                f"{module} imports {target}, but holds the version only"
                for target in imports(tree, set(trees))
                if target not in late
            ]
            continue
        for target in imports(tree, set(trees)):
            if target in ALLOWED_FROM_ANYWHERE:
                continue
            if target == "a relative import":
                wrong.append(f"{module} has a relative import; imports are absolute")
                continue
            here, there = layer_of(module), layer_of(target)
            if there < here:
                wrong.append(f"{module} imports {target}, which stands above it")
            if there == here and not shared(module, target):
                wrong.append(f"{module} imports {target}, its peer")
    return wrong


def shared(module: str, target: str) -> bool:
    """Return whether two modules of one layer may know each other."""
    package = part_of(module)
    if room_of(module) == room_of(target) and room_of(module) in ASSEMBLED:
        return True
    return target in FLOORS.get(package, ()) or (package in DOORS and target == f"eyechart.{package}")


def cycles(trees: Mapping[str, ast.Module]) -> list[str]:
    """Return the modules that import themselves through others at import time."""
    graph = {name: {target for target in imports(tree, set(trees)) if target != name} for name, tree in trees.items()}
    graph = {name: {target for target in targets if not name.startswith(target)} for name, targets in graph.items()}

    def reaches(start: str, goal: str, seen: set[str]) -> bool:
        for target in graph.get(start, ()):
            if target == goal:
                return True
            if target not in seen:
                seen.add(target)
                if reaches(target, goal, seen):
                    return True
        return False

    return [name for name in graph if reaches(name, name, set())]


def test_imports_point_down_and_peers_do_not_know_each_other() -> None:
    """The tree as it stands keeps to its layers."""
    assert violations(modules()) == []


def test_eyechart_goes_without_the_other_distribution() -> None:
    """What needs it imports it in a function, where its lack is said in words."""
    whole = {module: tree for module, tree in modules().items() if part_of(module) != "eyechart_organisms"}
    first = (ast.Import, ast.ImportFrom)
    tops = {
        module: ast.Module([one for one in tree.body if isinstance(one, first)], []) for module, tree in whole.items()
    }

    def wanting(trees: Mapping[str, ast.Module]) -> set[str]:
        known = set(modules())
        return {
            module
            for module, tree in trees.items()
            if any(one.startswith("eyechart_organisms") for one in imports(tree, known))
        }

    assert wanting(tops) == set()
    assert wanting(whole) == {"eyechart.models", "eyechart.cli.demo"}


def test_no_module_imports_itself_through_others() -> None:
    """There is no cycle of imports."""
    assert cycles(modules()) == []


@pytest.mark.parametrize(
    ("file", "line", "message"),
    [
        (
            "frames/nouns.py",
            "from eyechart.ledger import Ledger",
            "eyechart.frames.nouns imports eyechart.ledger, which stands above it",
        ),
        (
            "spaces/space.py",
            "import eyechart.frames",
            "eyechart.spaces.space imports eyechart.frames, which stands above it",
        ),
        (
            "ledger/ledger.py",
            "from eyechart import prompts",
            "eyechart.ledger.ledger imports eyechart.prompts, its peer",
        ),
        (
            "stats/paired_tests.py",
            "from eyechart.stats.sign_flip import sign_flip_test",
            "imports eyechart.stats.sign_flip, its peer",
        ),
        ("stats/paired_tests.py", "    from eyechart import cli", "eyechart.stats.paired_tests imports eyechart.cli"),
        ("run.py", "from . import frames", "eyechart.run has a relative import"),
        ("perception/estimators.py", "from eyechart.models.scripted import see", "which stands above it"),
        ("perception/renderer.py", "from eyechart.simulators import SIMULATORS", "which stands above it"),
        ("calls.py", "from eyechart.conditions import show", "eyechart.calls imports eyechart.conditions, its peer"),
        ("models/scripted.py", "from eyechart.models.openai_compatible import names", "openai_compatible, its peer"),
        ("models/scripted.py", "from eyechart.simulators import open_simulator", "eyechart.simulators, its peer"),
        ("simulators/highway/world.py", "from eyechart.models import open_model", "eyechart.models, its peer"),
        ("verdicts/verdict.py", "from eyechart.studies import battery", "which stands above it"),
        ("report/table.py", "from eyechart.cli.app import app", "which stands above it"),
        (
            "verdicts/paper.py",
            "from eyechart import gate",
            "eyechart.verdicts.paper imports eyechart.gate, which stands above",
        ),
        (
            "stats/__init__.py",
            "from eyechart.stats import paired_tests",
            "eyechart.stats imports eyechart.stats.paired_tests",
        ),
        (
            "stats/paired_tests.py",
            "import eyechart.stats",
            "eyechart.stats.paired_tests imports eyechart.stats, its peer",
        ),
        ("__init__.py", "from eyechart.cli import app", "eyechart imports eyechart.cli"),
        (
            "frames/nouns.py",
            'import importlib\nimportlib.import_module("eyechart.verdicts")',
            "eyechart.frames.nouns imports by name",
        ),
        ("errors.py", "from eyechart.seeds import key_seed", "eyechart.errors imports eyechart.seeds, its peer"),
        ("verdicts/paper.py", "from eyechart_organisms.adversaries import ADVERSARIES", "which stands above it"),
        (
            "../eyechart_organisms/adversaries.py",
            "from eyechart.calibrate import policies",
            "eyechart.calibrate.policies, its peer",
        ),
    ],
)
def test_a_forbidden_import_is_found(file: str, line: str, message: str) -> None:
    """An upward or sideways import that is added to the tree, even inside a function, is named."""
    path = (ROOT / "eyechart" / file).resolve()
    added = f"\ndef _late() -> None:\n{line}\n" if line.startswith(" ") else f"\n{line}\n"
    changed = ast.parse(path.read_text(encoding="utf-8") + added)
    assert any(message in found for found in violations({**modules(), name_of(path): changed}))


def lacking(program: ast.Module, trees: Mapping[str, ast.Module]) -> list[str]:
    """Return the names that a program imports from ``eyechart`` and that are not there."""
    wanted = [
        (node.module, name.name)
        for node in ast.walk(program)
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in PACKAGES
        for name in node.names
    ]
    return [
        f"{module}:{name}"
        for module, name in wanted
        if module not in trees or (f"{module}.{name}" not in trees and name not in held(trees[module]))
    ]


def held(tree: ast.Module) -> set[str]:
    """Return the names that a module binds."""
    result = {
        node.name for node in tree.body if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            result |= {name.asname or name.name for name in node.names}
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            result.add(node.id)
    return result


def test_programs_beside_the_package_import_what_there_is() -> None:
    """Those that train, measure and write pages run seldom, so that a renamed class would be missed there."""
    trees = modules()
    programs = [path for folder in ("organisms", "benchmarks", "docs") for path in (ROOT.parent / folder).glob("*.py")]
    missing = {
        path.name: names for path in programs if (names := lacking(parsed(path.read_text(encoding="utf-8")), trees))
    }
    assert len(programs) > 50
    assert missing == {}


def test_a_name_that_is_not_there_is_found() -> None:
    """A class that was renamed, a module that is gone; a submodule is one, and so is a constant."""
    text = (
        "from eyechart.simulators.tabletop.world import COLOURS, Tabel\n"
        "from eyechart.gone import it\nfrom eyechart.simulators import tabletop\n"
    )
    assert lacking(parsed(text), modules()) == ["eyechart.simulators.tabletop.world:Tabel", "eyechart.gone:it"]
