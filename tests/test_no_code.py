"""No file is read as a program: the source calls nothing that would run what it reads."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import eyechart

SOURCE = Path(eyechart.__file__).parent
MODULES = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "joblib", "yaml"}
CALLS = {"eval", "exec", "compile", "__import__"}
MEMBERS = {"os.system", "os.popen", "torch.load", "runpy.run_path", "runpy.run_module"}
OPTIONS = {"shell", "allow_pickle"}
"""Arguments that may not be given as true, wherever they are given."""
FORMATS = {"format", "format_map"}
"""What runs a template, whose fields may ask for members, items and any width."""
OWN = {
    "compare.py: both.format",
    "verdicts/rules.py: _NEEDS.get((reads, holds), '').format",
    "studies/battery/evidence.py: fewer.format",
    "studies/battery/figures.py: words.format",
    "studies/battery/evidence.py: more.format",
}
"""Templates that the source itself passes on by a name; every other is a literal, or a constant of the source."""


def programs(text: str) -> Iterator[str]:
    """Yield what of a module's source would run what it reads."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names if name.name.partition(".")[0] in MODULES)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in MODULES:
            yield str(node.module)
        elif isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            if called in CALLS | MEMBERS or is_foreign_template(node):
                yield called
            for option in node.keywords:
                if option.arg in OPTIONS and not (
                    isinstance(option.value, ast.Constant) and option.value.value is False
                ):
                    yield f"{called}({option.arg}=…)"


def is_foreign_template(call: ast.Call) -> bool:
    """Return whether a call fills in a template, or takes a format, that is no text or constant of the source."""
    if isinstance(call.func, ast.Name):
        return call.func.id == "format" and any(not is_own(one) for one in call.args[1:])
    if not isinstance(call.func, ast.Attribute) or call.func.attr not in FORMATS:
        return False
    unbound = ast.unparse(call.func.value) == "str"
    return not is_own(call.args[0] if unbound and call.args else call.func.value)


def is_own(template: ast.expr) -> bool:
    """Return whether it is a text, or a constant by its name, or one out of such."""
    if isinstance(template, ast.Subscript):
        return is_own(template.value)
    if isinstance(template, ast.Name | ast.Attribute):
        return (template.id if isinstance(template, ast.Name) else template.attr).isupper()
    return isinstance(template, ast.Constant)


def test_no_module_runs_what_it_reads() -> None:
    """Code runs where its user names it: a callable by ``python:``, a world by ``gym:``, a trusted checkpoint."""
    found = {
        f"{path.relative_to(SOURCE)}: {what}"
        for path in sorted(SOURCE.rglob("*.py"))
        for what in programs(path.read_text(encoding="utf-8"))
    }
    assert found == OWN


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
        "info['video_path'].format(chunk=1)",
        "template.format_map(row)",
        "str.format(template, 1)",
        "f'{one}'.format(1)",
        "format(1.0, given)",
    ],
)
def test_each_of_them_would_be_found(text: str) -> None:
    """Or the test above could not fail."""
    assert list(programs(text))


def test_what_only_looks_alike_is_left_alone() -> None:
    """A model's ``eval()``, an option that is off, a pattern that is compiled, a template of the source's own."""
    assert list(programs("model.eval()\nre.compile('a')\nrun(line, shell=False)\nimport picklefree")) == []
    assert list(programs("'{}'.format(1)\n_TABLES.format(a=1)\n_WHY[tone].format(p=1)\nformat(1.0, '.2f')")) == []
