"""Check both built wheels: what each holds, weighs and says of itself. Usage: check_wheel.py dist/*.whl."""

import re
import sys
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from email import message_from_bytes
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).parents[1]


@dataclass(frozen=True)
class Distribution:
    """What a wheel must be: its package, the most bytes, what it needs beside code, and what it says that it requires.

    ``needed`` is one of each kind of file that is no Python: without any of them a command fails. ``requires`` is a
    line of its metadata, with V for the version.
    """

    package: str
    most: int
    needed: tuple[str, ...]
    beside: tuple[str, ...]
    requires: str

    def version(self, source: Path) -> str:
        """Return the version that its package says."""
        about = (source / self.package / "__init__.py").read_text(encoding="utf-8")
        return re.findall(r'^__version__ = "(.+)"$', about, re.MULTILINE)[0]


EYECHART = Distribution(
    "eyechart",
    1_512_000,  # the aim is 1_500_000: what reads replies of other languages and forms is 11 kB above it
    ("py.typed", "models/prices.toml", "models/paper.toml", "report/template/page.html"),
    ("METADATA", "WHEEL", "RECORD", "top_level.txt", "licenses/LICENSE", "entry_points.txt"),
    'eyechart-organisms==V; extra == "organisms"',
)
ORGANISMS = Distribution(
    "eyechart_organisms",
    6_500_000,
    ("py.typed", "checkpoints/grounded/model.safetensors", "policies/sees.npz"),
    ("METADATA", "WHEEL", "RECORD", "top_level.txt", "licenses/LICENSE"),
    "eyechart==V",
)


def problems(wheel: Path, one: Distribution, root: Path = ROOT) -> list[str]:
    """Return what is wrong with a wheel, a line each."""
    source, version = root / "src", one.version(root / "src")
    about = f"{one.package}-{version}.dist-info"
    with zipfile.ZipFile(wheel) as opened:
        held = {name for name in opened.namelist() if not name.endswith("/")}
        read = {name: opened.read(f"{about}/{name}") for name in one.beside if f"{about}/{name}" in held}
    wanted = {
        path.relative_to(source).as_posix()
        for path in (source / one.package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    result = [f"{name} is in src and not in the wheel" for name in sorted(wanted - held)]
    allowed = wanted | {f"{about}/{name}" for name in one.beside}
    result += [f"{name} is in the wheel, and should not be" for name in sorted(held - allowed)]
    result += [f"{name} is needed, and src has none" for name in one.needed if f"{one.package}/{name}" not in wanted]
    result += [f"{about}/{name} is missing" for name in one.beside if name not in read]
    result += _metadata(read.get("METADATA", b""), one, version)
    if read.get("licenses/LICENSE") != (root / "LICENSE").read_bytes():
        result.append("its licence is not the project's")
    if (size := wheel.stat().st_size) > one.most:
        result.append(f"it has {size} bytes, more than {one.most}")
    return result


def _metadata(text: bytes, one: Distribution, version: str) -> Iterator[str]:
    """Yield what the metadata say otherwise than they should."""
    said = message_from_bytes(text)
    wanted = {
        "Name": one.package.replace("_", "-"),
        "Version": version,
        "License-Expression": "MIT",
        "Requires-Python": ">=3.11",
        "Description-Content-Type": "text/markdown",
    }
    for name, value in wanted.items():
        if said[name] != value:
            yield f"its {name} is {said[name]}, not {value}"
    if (requires := one.requires.replace("V", version)) not in said.get_all("Requires-Dist", []):
        yield f"it does not require {requires}"
    if not str(said.get_payload()).strip():
        yield "it has no description"


def main(wheels: list[str]) -> int:
    """Check the wheel of each distribution; returns the exit code."""
    named = {PurePosixPath(wheel).name.partition("-")[0]: Path(wheel) for wheel in wheels}
    if len(wheels) != len(named) or set(named) != {EYECHART.package, ORGANISMS.package}:
        print(f"check_wheel: name one wheel of each distribution, not {' '.join(wheels) or 'none'}", file=sys.stderr)
        return 2
    wrong = 0
    for one in (EYECHART, ORGANISMS):
        wheel = named[one.package]
        found = problems(wheel, one)
        print("\n".join(f"{wheel}: {line}" for line in found) or f"{wheel} is as src is, {wheel.stat().st_size} bytes")
        wrong += len(found)
    versions = {one.version(ROOT / "src") for one in (EYECHART, ORGANISMS)}
    if len(versions) > 1:
        print(f"the two are of different versions: {', '.join(sorted(versions))}")
    return int(bool(wrong) or len(versions) > 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
