"""Write into the pages what their commands print, each block between its two marks, and how eyechart is installed.

Usage: python docs/update_readme.py install
       python docs/update_readme.py look|demo FOLDER (that of the look is an empty one)
"""

import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"


class Published(NamedTuple):
    """The name on the package index, and the address of the project; both are empty until somebody has published it."""

    name: str = ""
    address: str = ""


PUBLISHED = Published()


class Block(NamedTuple):
    """Where what a command prints is shown, and how many of its lines."""

    page: Path
    command: tuple[str, ...]
    lines: int | None = None


BLOCKS = {
    "look": Block(README, ("look", "scripted:depth"), 10),
    "demo": Block(ROOT / "docs" / "first-verdict.md", ("demo", "--out", "demo")),
}
"""What is shown, by the name in the marks."""
INSTALLED = (README, ROOT / "docs" / "index.md")
"""The pages that say how eyechart is installed."""


def installing(published: Published = PUBLISHED) -> str:
    """Return how eyechart is installed, and the first thing to type: from a checkout where nobody published it."""
    return f"```sh\npip install {published.name or '.'}\neyechart look scripted:depth\n```\n"


def between(name: str, page: Path) -> str:
    """Return what stands between two marks of a page."""
    found = _marks(name).search(page.read_text(encoding="utf-8"))
    if found is None:
        raise SystemExit(f"{page.name} has lost the marks of its block '{name}'")
    return found.group(2)


def _marks(name: str) -> re.Pattern[str]:
    return re.compile(rf"(<!-- {name}: .*? -->\n)(.*?)(<!-- end of {name} -->)", re.DOTALL)


def _write(name: str, page: Path, block: str) -> None:
    between(name, page)
    text = page.read_text(encoding="utf-8")
    text = _marks(name).sub(lambda match: match.group(1) + block + match.group(3), text)
    page.write_text(text, encoding="utf-8")


def output(name: str, folder: Path) -> str:
    """Return what a command prints on standard output in a folder, its date masked and without trailing blanks."""
    command = [Path(sys.executable).with_name("eyechart"), *BLOCKS[name].command]
    return masked(subprocess.run(command, capture_output=True, text=True, check=True, cwd=folder).stdout)


def masked(printed: str) -> str:
    """Return what was printed with its date masked and trailing blanks removed."""
    lines = [line.rstrip() for line in printed.splitlines()]
    return re.sub(r"\d{4}-\d\d-\d\d", "DATE", "\n".join(lines)).strip("\n")


def head(name: str, printed: str) -> str:
    """Return as much of what is printed as a page shows."""
    return "\n".join(printed.splitlines()[: BLOCKS[name].lines])


def shown(name: str) -> str:
    """Return the block that stands in its page."""
    return between(name, BLOCKS[name].page).removeprefix("```text\n").removesuffix("\n```\n")


if __name__ == "__main__":
    if sys.argv[1] == "install":
        for page in INSTALLED:
            _write("install", page, installing())
    else:
        printed = head(sys.argv[1], output(sys.argv[1], Path(sys.argv[2])))
        _write(sys.argv[1], BLOCKS[sys.argv[1]].page, f"```text\n{printed}\n```\n")
