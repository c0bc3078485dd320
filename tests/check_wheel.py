"""Check a built wheel: it holds what the source tree holds, and nothing else. Usage: check_wheel.py dist/*.whl."""

import re
import sys
import zipfile
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src"
NEEDED = (
    "eyechart/py.typed",
    "eyechart/models/prices.toml",
    "eyechart/models/paper/hosted-kimi-k3.toml",
    "eyechart/models/huggingface/organisms/grounded/model.safetensors",
    "eyechart/models/trained/sees.npz",
    "eyechart/report/template/page.html",
)
"""One of each kind of file that is no Python: without any of them a command fails."""


def problems(wheel: Path) -> list[str]:
    """Return what a wheel lacks or has too much, a line each."""
    about = (SOURCE / "eyechart" / "__init__.py").read_text(encoding="utf-8")
    version = re.findall(r'^__version__ = "(.+)"$', about, re.MULTILINE)[0]
    with zipfile.ZipFile(wheel) as opened:
        held = {name for name in opened.namelist() if not name.endswith("/")}
    beside = {name for name in held if PurePosixPath(name).parts[0] == f"eyechart-{version}.dist-info"}
    source = {
        path.relative_to(SOURCE).as_posix()
        for path in (SOURCE / "eyechart").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    found = [f"{name} is in src and not in the wheel" for name in sorted(source - held)]
    found += [f"{name} is in the wheel and not in src" for name in sorted(held - source - beside)]
    found += [f"{name} is needed, and src has none" for name in NEEDED if name not in source]
    needed = [f"eyechart-{version}.dist-info/{name}" for name in ("METADATA", "entry_points.txt", "licenses/LICENSE")]
    return found + [f"{name} is missing" for name in needed if name not in beside]


def main(wheels: list[str]) -> int:
    """Check the one wheel that is named; returns the exit code."""
    if len(wheels) != 1:
        print(f"check_wheel: name one wheel, not {len(wheels)}", file=sys.stderr)
        return 2
    found = problems(Path(wheels[0]))
    print("\n".join(found) or f"{wheels[0]} holds what src holds")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
