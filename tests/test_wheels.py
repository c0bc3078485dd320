"""What a release must be: the checks find each thing that is wrong with a wheel."""

import sys
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from check_wheel import EYECHART, ORGANISMS, Distribution, main, problems
from try_wheel import found as found_python
from try_wheel import pythons_of

Files = dict[str, str]
ABOUT = "eyechart_organisms-1.2.dist-info"
METADATA = (
    "Metadata-Version: 2.4\nName: eyechart-organisms\nVersion: 1.2\nLicense-Expression: MIT\nRequires-Python: >=3.11\n"
    "Description-Content-Type: text/markdown\nRequires-Dist: eyechart==1.2\n\n# Organisms\n"
)
TINY = replace(ORGANISMS, most=5000, needed=("py.typed",))


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Return a project of three files."""
    package = tmp_path / "src" / "eyechart_organisms"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text('__version__ = "1.2"\n')
    (package / "py.typed").touch()
    (tmp_path / "LICENSE").write_text("MIT\n")
    return tmp_path


def sound() -> Files:
    """Return what the wheel of that project holds."""
    of = dict.fromkeys(("WHEEL", "RECORD", "top_level.txt"), "x") | {"METADATA": METADATA, "licenses/LICENSE": "MIT\n"}
    package = {"eyechart_organisms/__init__.py": '__version__ = "1.2"\n', "eyechart_organisms/py.typed": ""}
    return package | {f"{ABOUT}/{name}": text for name, text in of.items()}


def found(root: Path, files: Files, one: Distribution = TINY) -> list[str]:
    """Return what is wrong with a wheel of these files."""
    wheel = root / "one.whl"
    with zipfile.ZipFile(wheel, "w") as made:
        for name, text in files.items():
            made.writestr(name, text)
    return problems(wheel, one, root)


def test_a_wheel_that_holds_what_it_should_has_no_problem(root: Path) -> None:
    """Else each of the others would find something."""
    assert found(root, sound()) == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda files: files.pop("eyechart_organisms/py.typed"), "eyechart_organisms/py.typed is in src and not"),
        (lambda files: files.update({"tests/test_one.py": ""}), "tests/test_one.py is in the wheel, and should not be"),
        (lambda files: files.update({"eyechart/run.py": ""}), "eyechart/run.py is in the wheel, and should not be"),
        (lambda files: files.pop(f"{ABOUT}/licenses/LICENSE"), "licenses/LICENSE is missing"),
        (lambda files: files.update({f"{ABOUT}/licenses/LICENSE": "GPL"}), "its licence is not the project's"),
        (lambda files: files.update({f"{ABOUT}/RECORD": "x" * 5000}), "more than 5000"),
        *(
            (lambda files, old=old, new=new: files.update({f"{ABOUT}/METADATA": METADATA.replace(old, new)}), said)
            for old, new, said in (
                ("Version: 1.2", "Version: 1.1", "its Version is 1.1, not 1.2"),
                ("Expression: MIT", "Expression: BSD", "its License-Expression is BSD, not MIT"),
                ("eyechart==1.2", "eyechart>=1", "it does not require eyechart==1.2"),
                ("# Organisms", "", "it has no description"),
            )
        ),
    ],
)
def test_what_is_wrong_with_a_wheel_is_said(root: Path, change: Callable[[Files], object], said: str) -> None:
    """A file too few or too many, a licence, the size, the metadata; nothing else is said beside it."""
    files = sound()
    change(files)
    lines = found(root, files)
    assert any(said in line for line in lines), lines
    assert len(lines) <= 2


def test_one_wheel_of_each_is_wanted(capsys: pytest.CaptureFixture[str]) -> None:
    """One alone is no release, and neither are two versions of one."""
    for wheels in ([], ["dist/eyechart-1.whl"], ["eyechart-1.whl", "eyechart-2.whl", "eyechart_organisms-1.whl"]):
        assert main(wheels) == 2
        assert "name one wheel of each distribution" in capsys.readouterr().err


def test_the_two_have_one_version_and_ask_for_each_other() -> None:
    """In the packages and in both projects: another version's would be refused."""
    root = Path(__file__).parents[1]
    version = EYECHART.version(root / "src")
    assert ORGANISMS.version(root / "src") == version
    assert f'"eyechart-organisms=={version}"' in (root / "pyproject.toml").read_text(encoding="utf-8")
    assert f'"eyechart=={version}"' in (root / "organisms" / "pyproject.toml").read_text(encoding="utf-8")
    assert (root / "organisms" / "LICENSE").read_bytes() == (root / "LICENSE").read_bytes()


@pytest.fixture
def pyenv(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of versions of a pyenv, with a path that has no other Python."""
    monkeypatch.setenv("PYENV_ROOT", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    return tmp_path / "versions"


def kept(pyenv: Path, version: str) -> str:
    """Have pyenv hold a Python; returns its path."""
    python = pyenv / version / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.touch()
    return str(python)


def test_a_python_that_runs_this_is_taken_as_it_is(pyenv: Path) -> None:
    """Its requirements are installed already."""
    here = f"{sys.version_info.major}.{sys.version_info.minor}"
    kept(pyenv, f"{here}.99")
    assert found_python(f"python{here}") == sys.executable


def test_the_newest_of_pyenv_is_found(pyenv: Path) -> None:
    """By number, not by letter, and of no other minor version; a name on the path that does not run is passed over."""
    shim = pyenv.parent / "bin" / "python3.99"
    shim.parent.mkdir()
    shim.write_text("#!/bin/sh\nexit 127\n")
    shim.chmod(0o755)
    assert found_python("python3.99") is None
    kept(pyenv, "3.99.9")
    kept(pyenv, "3.9.99")
    newest = kept(pyenv, "3.99.10")
    assert found_python("python3.99") == newest
    shim.write_text("#!/bin/sh\nexit 0\n")
    assert found_python("python3.99") == str(shim)


def test_a_python_that_is_missing_is_named(pyenv: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A release ends there; where those that there are are tried, at least one must be."""
    python, names = kept(pyenv, "3.99.1"), ["python3.98", "python3.99"]
    assert pythons_of(names, if_there=True) == [python]
    assert capsys.readouterr().out == "try_wheel: NOT TRIED: there is no python3.98 here\n"
    with pytest.raises(SystemExit, match=r"there is no python3\.98;"):
        pythons_of(names, if_there=False)
    with pytest.raises(SystemExit, match=r"there is no python3\.97, python3\.98;"):
        pythons_of(["python3.97", "python3.98"], if_there=True)
