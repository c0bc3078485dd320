"""Write what ``eyechart demo --vlm`` prints into docs/model-organisms.md, between its two marks.

Usage: python docs/update_model_organisms.py DEMO_FOLDER
"""

import re
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).with_name("model-organisms.md")
BLOCK = re.compile(r"(<!-- demo-vlm: .*? -->\n).*?(<!-- end of demo-vlm -->)", re.DOTALL)


def demo_output(folder: Path) -> str:
    """Return what the demo prints on standard output, its date masked and trailing blanks removed."""
    command = [Path(sys.executable).with_name("eyechart"), "demo", "--vlm", "--out", str(folder)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    lines = [line.rstrip() for line in printed.splitlines()]
    return re.sub(r"\d{4}-\d\d-\d\d", "DATE", "\n".join(lines)).strip("\n")


def shown() -> str:
    """Return the block that stands in the page."""
    match = BLOCK.search(PAGE.read_text(encoding="utf-8"))
    if match is None:
        raise SystemExit(f"{PAGE} has lost the marks of its block")
    block = match.group().removeprefix(match.group(1)).removesuffix(match.group(2))
    return block.removeprefix("```text\n").removesuffix("\n```\n")


if __name__ == "__main__":
    block = f"```text\n{demo_output(Path(sys.argv[1]))}\n```\n"
    text = BLOCK.sub(lambda match: match.group(1) + block + match.group(2), PAGE.read_text(encoding="utf-8"))
    PAGE.write_text(text, encoding="utf-8")
