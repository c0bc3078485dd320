"""Install both wheels into fresh environments and try them there.

Usage: try_wheel.py dist [--if-there] [PYTHON ...]. A PYTHON is python3.12, or a path; pyenv's is found where the name
is not on the path. With --if-there one that is missing is named and left out; else it ends the program.

Without a PYTHON it is this one, whose installed requirements are used; for others they are installed once, into
build/requirements. The wheels themselves come from the folder alone. In an empty folder it is tried what the core does,
what it says where the organisms are missing, and that they are found once they are installed. Each Python stages
frames, looks and calibrates; only the first has the whole demo and every sentence of what is missing, which depend on
no Python. All are tried side by side.
"""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor
from email import message_from_bytes
from pathlib import Path

ROOT = Path(__file__).parents[1]
BUILD = ROOT / "build"
ENVIRONMENT = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "EYECHART"))}
FOUND = """
import eyechart, sys
from eyechart.models import open_model, organisms_folder
from eyechart.models.trained import TRAINED
from eyechart.models.huggingface.organisms import SAYS, folder
assert eyechart.__file__.startswith(sys.prefix), eyechart.__file__
assert all((folder(name) / "model.safetensors").is_file() for name in SAYS)
assert all(open_model(f"trained:{name}", answering="policy").version for name in TRAINED)
"""
MISSING = (
    (("calibrate",), "organisms"),
    (("demo", "--policy", "--out", "policy"), "organisms"),
    (("demo", "--vlm", "--out", "vlm"), "organisms,transformers"),
    (("doctor", "hf:organism:grounded"), "organisms,transformers"),
)
"""Commands that need the organisms, and the extras that each names where they are missing."""


def run(*words: str | Path, cwd: Path | None = None, codes: tuple[int, ...] = (0,)) -> str:
    """Return what a command prints; ends the program where it exits otherwise than it should."""
    done = subprocess.run(words, cwd=cwd, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    if done.returncode not in codes:
        sys.exit(f"{' '.join(map(str, words))}: exit {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout + done.stderr


def expect(words: str, said: str) -> None:
    """End the program where a command did not say what it should."""
    if words not in " ".join(said.split()):
        sys.exit(f"try_wheel: '{words}' was expected, and not said:\n{said}")


def found(named: str) -> str | None:
    """Return the file of a Python: this one, one on the path, or pyenv's newest of that version; None without one.

    pip's --python takes no name.
    """
    version = named.removeprefix("python")
    if version == f"{sys.version_info.major}.{sys.version_info.minor}":
        return sys.executable
    there = shutil.which(named)
    if there and subprocess.run((there, "-c", ""), capture_output=True, check=False).returncode == 0:
        return there
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv")
    kept = [*pyenv.glob(f"versions/{version}.*/bin/python")]
    return str(max(kept, key=lambda one: [int(part) for part in re.findall(r"\d+", one.parts[-3])])) if kept else None


def pythons_of(named: list[str], *, if_there: bool) -> list[str]:
    """Return the Pythons to try; ends the program where one is missing, or with ``if_there`` where all are."""
    there = {one: found(one) for one in named}
    missing = [one for one, python in there.items() if python is None]
    result = [python for python in there.values() if python is not None]
    if missing and not (if_there and result):
        sys.exit(
            f"try_wheel: there is no {', '.join(missing)}; "
            "name those that there are: make release PYTHONS='/path/to/python …'"
        )
    for one in missing:
        print(f"try_wheel: NOT TRIED: there is no {one} here", flush=True)
    return result


def version_of(python: str) -> str:
    """Return the version of a Python, as 3.12."""
    return run(python, "-c", "import sys; print('%d.%d' % sys.version_info[:2])").strip()


def requirements(python: str, version: str, place: Path, dist: Path) -> Path:
    """Return a folder of what eyechart requires, without eyechart: links to what this Python has, or installed once."""
    if python == sys.executable:
        place.mkdir()
        for path in Path(sysconfig.get_path("purelib")).iterdir():
            if not path.name.startswith(("eyechart", "__")):
                (place / path.name).symlink_to(path)
        return place
    kept = BUILD / "requirements" / version
    if not kept.is_dir():
        with zipfile.ZipFile(next(dist.glob("eyechart-*.whl"))) as wheel:
            about = next(name for name in wheel.namelist() if name.endswith("/METADATA"))
            named = message_from_bytes(wheel.read(about)).get_all("Requires-Dist", [])
        needed = [one for one in named if "extra ==" not in one]
        part = kept.with_name(f"{version}.part")
        shutil.rmtree(part, ignore_errors=True)
        install(python, *needed, "-c", ROOT / "constraints.txt", "--target", part)
        part.rename(kept)
    return kept


def install(python: str | Path, *what: str | Path) -> None:
    """Install for a Python by the pip of this one; nothing that nobody imports is compiled."""
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", python, "install", "--quiet")
    run(*pip, "--no-compile", *what)


def try_in(python: str, dist: Path, *, whole: bool) -> str:
    """Try the wheels in a fresh environment of a Python; returns what was done, with the seconds that it took.

    ``whole`` is for the first Python: the demo's sixteen controllers, and every command that needs the organisms.
    """
    version, start = version_of(python), time.perf_counter()
    place = BUILD / "tried" / version
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    needed = requirements(python, version, place / "requirements", dist)
    run(python, "-m", "venv", "--without-pip", place / "venv")
    own = place / "venv" / "bin" / "python"
    packages = run(own, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip()
    (Path(packages) / "requirements.pth").write_text(f"{needed}\n", encoding="utf-8")
    from_dist = ("--no-index", "--find-links", dist)
    install(own, *from_dist, "eyechart")
    command, empty = own.with_name("eyechart"), place / "empty"
    empty.mkdir()
    if whole:
        expect("16 of 16 verdicts are as the controllers declared.", run(command, "demo", cwd=empty))
    else:
        run(command, "frames", "build", "highway", "--seeds", "0,1", "--steps", "8", "--out", "demo/bank-0", cwd=empty)
    # On these frames, at most half of what a look would stage anew: the README's test stages that.
    expect("Yes. It may be tried", run(command, "look", "scripted:depth", "--frames", "demo/bank-0", cwd=empty))
    for words, extras in MISSING if whole else MISSING[:1]:
        said = run(command, *words, cwd=empty, codes=(2,))
        expect(f"needs eyechart-organisms: pip install 'eyechart[{extras}]'", said)
        if "Traceback" in said or not {path.name for path in empty.iterdir()} <= {"demo", "looks"}:
            sys.exit(f"try_wheel: {' '.join(words)} left something, or broke:\n{said}")
    install(own, *from_dist, "eyechart[organisms]")
    run(own, "-c", FOUND, cwd=empty)
    expect(
        "Targets:", run(command, "calibrate", "--replications", "1", "--setting", "small_10", cwd=empty, codes=(0, 1))
    )
    shutil.rmtree(place)
    seconds = time.perf_counter() - start
    did = "demo" if whole else "frames"
    return f"Python {version}: {did}, look, what is said to be missing, calibrate with the organisms: {seconds:.0f} s"


if __name__ == "__main__":
    where, *named = (one for one in sys.argv[1:] if one != "--if-there")
    pythons = pythons_of(named, if_there="--if-there" in sys.argv) if named else [sys.executable]
    with ThreadPoolExecutor() as side_by_side:
        tried = [
            side_by_side.submit(try_in, python, Path(where).resolve(), whole=python == pythons[0]) for python in pythons
        ]
        for one in tried:
            print(one.result(), flush=True)
