"""Write what doctor and probe print of the tests' stand-ins into docs/test-your-endpoint.md, between its marks.

Usage: python docs/update_endpoint.py
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path[:0] = [str(Path(__file__).parents[1] / "tests"), str(Path(__file__).parents[1] / "tests" / "docs")]

from test_test_your_endpoint import BLOCK, PAGE, printed  # noqa: E402 - it stands where its test is

if __name__ == "__main__":
    text = PAGE.read_text(encoding="utf-8")
    for match in BLOCK.finditer(text):
        kind, what, shown = match.groups()
        with TemporaryDirectory() as folder:
            new = match.group().replace(f"```text\n{shown}```", f"```text\n{printed(kind, what, Path(folder))}```")
        text = text.replace(match.group(), new)
    PAGE.write_text(text, encoding="utf-8")
