"""A bundle of policies holds until one number in it is changed, and then that is named."""

import base64
import hashlib
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bundles import Change, edited, in_results, opened_ledger, repacked
from eyechart.bundle import validate, write_bundle
from eyechart.studies import policy
from known import table

pytestmark = pytest.mark.slow

SPEC = "python:arms:reach"


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the bundle of a run of one policy."""
    folder = tmp_path_factory.mktemp("policies")
    bank = table(folder / "bank")
    policy.run(policy.plan(bank.root, [SPEC], folder / "run"))
    write_bundle(folder / "run", folder / "run.zip")
    return folder / "run.zip"


def _motion(folder: Path) -> None:
    """Turn a bit of an answer, whose digests are mended."""
    real = "SELECT r.attempt, r.text FROM replies r JOIN calls c ON c.id = r.call WHERE c.condition = 'real' LIMIT 1"
    with opened_ledger(folder) as ledger:
        attempt, text = ledger.execute(real).fetchone()
        said = json.loads(text)
        array = bytearray(base64.b64decode(said["motion"]["base64"]))
        array[6] ^= 0x10
        said["motion"] |= {"base64": base64.b64encode(array).decode(), "sha256": hashlib.sha256(array).hexdigest()}
        ledger.execute(
            "UPDATE replies SET text = ?, row_sha256 = NULL, payload_sha256 = NULL WHERE attempt = ?",
            (json.dumps(said), attempt),
        )


def _time(folder: Path) -> None:
    with opened_ledger(folder) as ledger:
        ledger.execute("UPDATE replies SET seconds = 9, row_sha256 = NULL WHERE rowid = 5")


def _statistic(change: Callable[[Any], None]) -> Change:
    return in_results(lambda raw: change(raw["score"]["policies"][SPEC]["statistics"]["T.swapped@cameras"]))


BANK, MANIFEST, STATISTIC = "run/bank/metadata.jsonl", "run/run.json", rf"^results\.json, policies, {SPEC}, "
TRUTH = r"^bank, ground truth of frame 'red-left-0-00': printed"
CHANGES: dict[str, tuple[Change, str]] = {
    "an answer": (_motion, rf"{STATISTIC}misfit, value: printed"),
    "a state": (edited(BANK, r'"state": \[[\d.]+', '"state": [0.5'), TRUTH),
    "a logged motion": (edited(BANK, r'"motion": \[\[-?[\d.]+', '"motion": [[0.123'), TRUTH),
    "an instruction": (edited(BANK, "reach the red", "reach the blue"), rf"^ledger, request of {SPEC} about frame "),
    "the seed": (edited(MANIFEST, '"seed": 0', '"seed": 1'), r"^results\.json, runs, run, seed: printed '0'"),
    "the day": (
        edited(MANIFEST, r'"created": "\d+', '"created": "1999'),
        r"^results\.json, runs, run, created: .*, recomputed '1999",
    ),
    "a manifest's layout": (
        edited(MANIFEST, r"\n \"study", '\n  "study'),
        r"^run/run\.json: printed 'written in another",
    ),
    "a share": (
        _statistic(lambda raw: raw.update(value=0.5)),
        rf"{STATISTIC}T\.swapped@cameras, value: printed '0\.5', recomputed '",
    ),
    "a bound": (
        _statistic(lambda raw: raw["ci"].__setitem__(0, 0.25)),
        rf"{STATISTIC}T\.swapped@cameras, ci, 0: printed '0\.25', recomputed '",
    ),
    "a table cell": (
        edited("tables/channels.csv", r"(?<=,)\d+\.\d{6,}", "0.5"),
        rf"^tables/channels\.csv, {SPEC}, cameras: printed '0\.5', recomputed '",
    ),
    "a figure": (
        edited("report.html", r'(?<=<path d="M )[\d.]+', "9"),
        r"^report\.html, .*path d: printed 'M 9",
    ),
    "a time": (
        _time,
        rf"^results\.json, accounting, {SPEC}, all, seconds: printed",
    ),
}


TOGETHER = (
    ("an answer", "a time", "a share", "a table cell", "a manifest's layout"),
    ("a state", "the day", "a bound", "a figure"),
    ("a logged motion", "the seed"),
    ("an instruction",),
)
"""Changes that have nothing to do with each other, and are made in one bundle."""


def test_every_change_is_made_in_one_bundle() -> None:
    """None is forgotten."""
    assert sorted(CHANGES) == sorted(what for together in TOGETHER for what in together)


def test_an_honest_bundle_holds_and_is_of_this_eyechart(packed: Path) -> None:
    """The rules of reading motions have a version of their own, by which a bundle is no other eyechart's."""
    found = validate(packed)
    assert (found.differences, found.uncompared, found.notes, found.holds) == ([], [], [], True)


@pytest.mark.parametrize("together", TOGETHER)
def test_one_changed_number_is_named(together: tuple[str, ...], packed: Path, tmp_path: Path) -> None:
    """Each of several; whoever changed it has mended the digests of all files."""

    def change(folder: Path) -> None:
        for what in together:
            CHANGES[what][0](folder)

    found = validate(repacked(packed, tmp_path, change))
    said = "\n".join(map(str, found.differences))
    for what in together:
        assert re.search(CHANGES[what][1], said, re.MULTILINE), said
    assert found.uncompared == []
