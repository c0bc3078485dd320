"""Write what ``eyechart demo`` prints into the README, between its two marks.

Usage: python docs/update_readme.py DEMO_FOLDER
"""

import re
import subprocess
import sys
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"
BLOCK = re.compile(r"(<!-- demo: .*? -->\n).*?(<!-- end of demo -->)", re.DOTALL)


def demo_output(folder: Path) -> str:
    """Return what the demo prints on standard output, as the README shows it."""
    command = [Path(sys.executable).with_name("eyechart"), "demo", "--out", str(folder)]
    return masked(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def masked(printed: str) -> str:
    """Return what was printed with its date masked and trailing blanks removed."""
    lines = [line.rstrip() for line in printed.splitlines()]
    return re.sub(r"\d{4}-\d\d-\d\d", "DATE", "\n".join(lines)).strip("\n")


def shown() -> str:
    """Return the block that stands in the README."""
    found = BLOCK.search(README.read_text(encoding="utf-8"))
    if found is None:
        raise SystemExit("README.md has lost the marks of its demo block")
    block = found.group().removeprefix(found.group(1)).removesuffix(found.group(2))
    return block.removeprefix("```text\n").removesuffix("\n```\n")


if __name__ == "__main__":
    block = f"```text\n{demo_output(Path(sys.argv[1]))}\n```\n"
    text = BLOCK.sub(lambda match: match.group(1) + block + match.group(2), README.read_text(encoding="utf-8"))
    README.write_text(text, encoding="utf-8")
