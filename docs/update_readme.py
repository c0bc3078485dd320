"""Write what ``eyechart look`` and ``eyechart demo`` print into the README, each between its two marks.

Usage: python docs/update_readme.py look|demo FOLDER (that of the look is an empty one)
"""

import re
import subprocess
import sys
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"
COMMANDS = {"look": ("look", "scripted:depth"), "demo": ("demo", "--out", "demo")}
"""What is shown, by the name in the marks."""


def _block(name: str) -> re.Pattern[str]:
    return re.compile(rf"(<!-- {name}: .*? -->\n).*?(<!-- end of {name} -->)", re.DOTALL)


def output(name: str, folder: Path) -> str:
    """Return what a command prints on standard output in a folder, as the README shows it."""
    command = [Path(sys.executable).with_name("eyechart"), *COMMANDS[name]]
    return masked(subprocess.run(command, capture_output=True, text=True, check=True, cwd=folder).stdout)


def masked(printed: str) -> str:
    """Return what was printed with its date masked and trailing blanks removed."""
    lines = [line.rstrip() for line in printed.splitlines()]
    return re.sub(r"\d{4}-\d\d-\d\d", "DATE", "\n".join(lines)).strip("\n")


def shown(name: str = "demo") -> str:
    """Return the block that stands in the README."""
    found = _block(name).search(README.read_text(encoding="utf-8"))
    if found is None:
        raise SystemExit(f"README.md has lost the marks of its block '{name}'")
    block = found.group().removeprefix(found.group(1)).removesuffix(found.group(2))
    return block.removeprefix("```text\n").removesuffix("\n```\n")


if __name__ == "__main__":
    block = f"```text\n{output(sys.argv[1], Path(sys.argv[2]))}\n```\n"
    text = README.read_text(encoding="utf-8")
    text = _block(sys.argv[1]).sub(lambda match: match.group(1) + block + match.group(2), text)
    README.write_text(text, encoding="utf-8")
