"""Write the pages of the Python API: one a room of the tree, top to bottom, filled from the docstrings."""

import ast
import shutil
from pathlib import Path

import eyechart

SOURCE = Path(eyechart.__file__).parent
LEFT_OUT = {"cli"}
"""The command line has a reference of its own."""

FIRST = ("api", "testing")
"""The doors for users; the other rooms follow as the tree has them."""

INTRO = """# The Python API

Most users need [`eyechart.api`](api.md) alone; [From Python](../python.md) shows it at work. The other rooms are the
tree itself: see [what stands where](../architecture.md).

"""


def rooms() -> list[str]:
    """Return the modules and packages directly below eyechart, those for users first."""
    found = {path.stem for path in SOURCE.iterdir() if path.suffix == ".py" or (path / "__init__.py").is_file()}
    return [*FIRST, *sorted(found - set(FIRST) - LEFT_OUT - {"__init__", "__pycache__"})]


def modules(room: str) -> list[str]:
    """Return the modules of a room that users may know: the package alone where it names what it offers."""
    folder = SOURCE / room
    if not folder.is_dir():
        return [f"eyechart.{room}"]
    result = []
    for path in sorted([folder, *folder.rglob("*")], key=lambda one: one.relative_to(SOURCE).with_suffix("").parts):
        inside = path.relative_to(SOURCE).with_suffix("").parts
        name = ".".join(("eyechart", *inside))
        package, module = (path / "__init__.py").is_file(), path.suffix == ".py" and path.stem != "__init__"
        if (package or module) and not any(name.startswith(f"{whole}.") for whole in result if offers(whole)):
            result.append(name)
    return result


def offers(module: str) -> bool:
    """Return whether a module is a package that says in ``__all__`` what it offers."""
    file = SOURCE.joinpath(*module.split(".")[1:], "__init__.py")
    return file.is_file() and "__all__ = " in file.read_text(encoding="utf-8")


def sentence(room: str) -> str:
    """Return the first sentence of a room's docstring."""
    path = SOURCE / room / "__init__.py" if (SOURCE / room).is_dir() else SOURCE / f"{room}.py"
    said = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return " ".join(said.split("\n\n")[0].split())


def page(room: str) -> str:
    """Return a room's page in MyST."""
    lines = [f"# `eyechart.{room}`", ""]
    names = modules(room)
    for name in names:
        if len(names) > 1 and name != names[0]:
            lines += [f"## `{name}`", ""]
        lines += ["```{eval-rst}", f".. automodule:: {name}", "   :members:", "```", ""]
    return "\n".join(lines)


def write(folder: Path) -> None:
    """Write the page of every room and the list of them into a folder, which is emptied before."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for room in rooms():
        (folder / f"{room}.md").write_text(page(room), encoding="utf-8")
    rows = [f"| [`eyechart.{room}`]({room}.md) | {sentence(room)} |" for room in rooms()]
    tree = ["```{toctree}", ":hidden:", "", *rooms(), "```", ""]
    (folder / "index.md").write_text(
        INTRO + "\n".join(["| room | what it is |", "|---|---|", *rows, "", *tree]), "utf-8"
    )
