"""No file is read as a program: the source calls nothing that would run what it reads."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src" / "eyechart"
MODULES = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "joblib", "yaml"}
CALLS = {"eval", "exec", "compile", "__import__"}
MEMBERS = {"os.system", "os.popen", "torch.load", "runpy.run_path", "runpy.run_module"}
OPTIONS = {"shell", "allow_pickle"}
"""Arguments that may not be given as true, wherever they are given."""


def programs(text: str) -> Iterator[str]:
    """Yield what of a module's source would run what it reads."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from (one.name for one in node.names if one.name.partition(".")[0] in MODULES)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in MODULES:
            yield str(node.module)
        elif isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            if called in CALLS | MEMBERS:
                yield called
            for option in node.keywords:
                if option.arg in OPTIONS and not (
                    isinstance(option.value, ast.Constant) and option.value.value is False
                ):
                    yield f"{called}({option.arg}=…)"


def test_no_module_runs_what_it_reads() -> None:
    """Code runs where its user names it: a callable by ``python:``, a world by ``gym:``, a trusted checkpoint."""
    found = {
        f"{path.relative_to(SOURCE)}: {what}"
        for path in sorted(SOURCE.rglob("*.py"))
        for what in programs(path.read_text(encoding="utf-8"))
    }
    assert found == set()


@pytest.mark.parametrize(
    "text",
    [
        "import pickle",
        "from yaml import load",
        "import os\nos.system('ls')",
        "eval(said)",
        "subprocess.run(line, shell=True)",
        "numpy.load(path, allow_pickle=trusted)",
        "torch.load(path)",
    ],
)
def test_each_of_them_would_be_found(text: str) -> None:
    """Or the test above could not fail."""
    assert list(programs(text))


def test_what_only_looks_alike_is_left_alone() -> None:
    """A model's ``eval()``, an option that is off, a pattern that is compiled."""
    assert list(programs("model.eval()\nre.compile('a')\nrun(line, shell=False)\nimport picklefree")) == []
