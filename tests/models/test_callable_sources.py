"""The version of a callable is that of its file and of all that it imports from below its folder."""

import hashlib
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from banks import build_bank
from eyechart.errors import LedgerError
from eyechart.frames import FrameBank
from eyechart.manifest import RUN, read_manifest
from eyechart.models import open_model
from eyechart.modes import RequestMode
from eyechart.studies import battery

EYE = """
import os
from near import brain
from {0}_brain import word
import installed_thing

def decide(prompt, image):
    from {0}_later import more
    return word
"""


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a small bank."""
    return build_bank(tmp_path_factory.mktemp("bank") / "bank")


@pytest.fixture
def eye(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Write a module that imports in every way that there is, from a folder of its own; return its name."""
    name = f"eye_{abs(hash(tmp_path))}"
    (tmp_path / "code").mkdir()
    files = {
        f"{name}.py": EYE.format(name).replace("near", f"{name}_near"),
        f"{name}_brain.py": "word = 'SLOW'\n",
        f"{name}_later.py": "more = 1\n",
        f"{name}_near/__init__.py": "",
        f"{name}_near/brain.py": "from . import deep\nfrom .deeper.down import down\n",
        f"{name}_near/deep.py": f"import importlib\nmade = importlib.import_module('{name}_' + 'by_name')\n",
        f"{name}_near/deeper/__init__.py": "",
        f"{name}_near/deeper/down.py": "down = 1\n",
        f"{name}_by_name.py": "",
        f"{name}_unused.py": "",
        "venv/lib/site-packages/installed_thing.py": "",
    }
    for file, text in files.items():
        place = tmp_path / "code" / file
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path / "code" / "venv/lib/site-packages"))
    monkeypatch.syspath_prepend(str(tmp_path / "code"))
    yield name
    for one in [module for module in sys.modules if module.startswith((name, "installed_thing"))]:
        del sys.modules[one]


def version(eye: str) -> str:
    """Return the version of the callable."""
    return open_model(f"python:{eye}:decide").version


IMPORTED = ("{}.py", "{}_brain.py", "{}_later.py", "{}_near/__init__.py", "{}_near/brain.py", "{}_near/deep.py")
IMPORTED += ("{}_near/deeper/down.py", "{}_by_name.py")


@pytest.mark.parametrize("file", IMPORTED)
def test_a_change_of_any_file_that_it_imports_is_another_version(eye: str, tmp_path: Path, file: str) -> None:
    """At its head, inside a function, within a package, or by a name."""
    before = version(eye)
    with (tmp_path / "code" / file.format(eye)).open("a", encoding="utf-8") as changed:
        changed.write("\n# other\n")
    assert version(eye) != before


@pytest.mark.parametrize("file", ["{}_unused.py", "venv/lib/site-packages/installed_thing.py"])
def test_what_it_does_not_import_and_what_is_installed_are_no_part_of_it(eye: str, tmp_path: Path, file: str) -> None:
    """Neither a module that merely lies beside it, nor one of an environment below its folder."""
    before = version(eye)
    (tmp_path / "code" / file.format(eye)).write_text("other = 1\n", encoding="utf-8")
    __import__(file.format(eye).rpartition("/")[2].removesuffix(".py"))
    assert version(eye) == before


def test_it_is_the_same_wherever_the_folder_lies(eye: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that a run goes on on another machine."""
    before = version(eye)
    for one in [module for module in sys.modules if module.startswith((eye, "installed_thing"))]:
        del sys.modules[one]
    (tmp_path / "code").rename(tmp_path / "moved")
    monkeypatch.syspath_prepend(str(tmp_path / "moved" / "venv/lib/site-packages"))
    monkeypatch.syspath_prepend(str(tmp_path / "moved"))
    assert version(eye) == before


def planned(bank: FrameBank, eye: str, out: Path, shard: tuple[int, int] | None = None) -> battery.Battery:
    """Return the plan of a small run."""
    mode = RequestMode(f"python:{eye}:decide")
    return battery.plan(bank.root, [mode], out, conditions=["real", "blank"], extent=battery.BatterySelection(4, shard))


def test_shards_of_two_brains_are_not_merged(bank: FrameBank, eye: str, tmp_path: Path) -> None:
    """The file of the callable is the same, and what it imports is not; that file is named."""
    shards = [tmp_path / "one", tmp_path / "two"]
    for number, shard in enumerate(shards, 1):
        battery.run(planned(bank, eye, shard, (number, 2)))
        (tmp_path / "code" / f"{eye}_brain.py").write_text("word = 'LEFT'\n", encoding="utf-8")
    with pytest.raises(LedgerError, match=rf"is no part of the run.*\({eye}_brain.py is changed\)"):
        battery.merge(shards, tmp_path / "whole")


def test_a_run_is_not_resumed_with_another_file_which_is_named(bank: FrameBank, eye: str, tmp_path: Path) -> None:
    """Also one that is imported now or no more."""
    battery.run(planned(bank, eye, tmp_path / "run"))
    (tmp_path / "code" / f"{eye}_near" / "deep.py").write_text(f"import {eye}_unused\n", encoding="utf-8")
    del sys.modules[f"{eye}_near.deep"].made
    says = rf"{eye}_near/deep.py is changed, and {eye}_unused.py is imported now, and {eye}_by_name.py is imported no"
    with pytest.raises(LedgerError, match=says):
        planned(bank, eye, tmp_path / "run")


def _as_before(run: Path) -> None:
    """Have a run be as one that was made when the version was that of one file."""
    text = json.loads((run / RUN).read_text(encoding="utf-8"))
    for spec, facts in text["facts"].items():
        text["models"][spec] = facts["file_sha256"][:12]
        text["facts"][spec] = {"file_sha256": facts["file_sha256"]}
    (run / RUN).write_text(json.dumps(text), encoding="utf-8")


def test_a_run_that_was_made_before_goes_on_by_the_digest_of_one_file(
    bank: FrameBank, eye: str, tmp_path: Path
) -> None:
    """From then on it is held to all files; with another file of the callable it does not go on."""
    battery.run(planned(bank, eye, tmp_path / "run"))
    now = read_manifest(tmp_path / "run").models
    _as_before(tmp_path / "run")
    battery.run(planned(bank, eye, tmp_path / "run"))
    assert read_manifest(tmp_path / "run").models == now
    _as_before(tmp_path / "run")
    with (tmp_path / "code" / f"{eye}.py").open("a", encoding="utf-8") as changed:
        changed.write("\n# other\n")
    with pytest.raises(LedgerError, match=rf"\({eye}.py is changed\)"):
        planned(bank, eye, tmp_path / "run")


@pytest.mark.parametrize("older", [0, 1])
def test_shards_made_before_and_after_are_merged(bank: FrameBank, eye: str, tmp_path: Path, older: int) -> None:
    """In either order; the whole has the version by all files."""
    shards = [tmp_path / "one", tmp_path / "two"]
    for number, shard in enumerate(shards, 1):
        battery.run(planned(bank, eye, shard, (number, 2)))
    now = read_manifest(shards[0])
    _as_before(shards[older])
    battery.merge(shards, tmp_path / "whole")
    whole = read_manifest(tmp_path / "whole")
    assert (whole.models, whole.facts) == (now.models, now.facts)
    assert replace(whole, shard=now.shard).shard == (1, 2)


def test_a_callable_of_one_file_has_its_usual_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The head of the SHA-256 of its file."""
    name = f"alone_{abs(hash(tmp_path))}"
    (tmp_path / f"{name}.py").write_text("import os\ndef decide(prompt, image): return 'SLOW'\n", encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    model = open_model(f"python:{name}:decide")
    digest = hashlib.sha256((tmp_path / f"{name}.py").read_bytes()).hexdigest()
    assert (model.version, model.facts["file_sha256"]) == (digest[:12], digest)
    assert "formerly" not in model.facts
