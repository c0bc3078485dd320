"""Real weights that fill scene estimates: through admission, a guardian, a stack and a server, by the real commands."""

import contextlib
import io
import json
import subprocess
import sys
import urllib.request
from pathlib import Path

import numpy as np
import pytest

from eyechart import cli
from eyechart.frames import encode, open_bank
from eyechart.guardian import Guardian
from eyechart.models.huggingface.organisms import ESTIMATORS
from eyechart.studies import structured

pytestmark = [pytest.mark.models, pytest.mark.filterwarnings("ignore")]

SEEING, BLIND = (f"hf:organism:{name}" for name in ESTIMATORS)
ACTING = ("hf:organism:grounded", "hf:organism:blind")


def command(*words: object) -> tuple[object, str, str]:
    """Run a command line; return its exit code and what it prints on both streams."""
    out, told = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(out), contextlib.redirect_stderr(told):
        patch.setattr(sys, "argv", ["eyechart", *map(str, words)])
        with pytest.raises(SystemExit) as left:
            cli.main()
    return left.value.code, out.getvalue(), " ".join(told.getvalue().split())


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a bank that no training saw, and the admission and structured runs of the organisms."""
    base = tmp_path_factory.mktemp("estimating")
    assert command("frames", "build", "highway", "--seeds", "5", "--steps", "12", "--out", base / "bank")[0] == 0
    for study, out, models, limit in (
        ("admission", "acting", ACTING, ()),
        ("admission", "calibration", (SEEING, BLIND), ()),
        ("structured", "votes", (SEEING, BLIND), ("--limit", "32")),
    ):
        asked = [*limit, *(word for model in models for word in ("--model", model))]
        given = command("run", study, *asked, "--frames", base / "bank", "--out", base / out, "--concurrency", "32")
        assert given[0] == 0, given
    return base


@pytest.fixture(scope="module")
def stack(base: Path) -> Path:
    """Return the guardian that the committee of two makes, as a stack has it."""
    assert command("guardian", "fit", base / "calibration", "--out", base / "guardian.json")[0] == 0
    assert command("guardian", "export", base / "guardian.json", "--out", base / "stack.json")[0] == 0
    return base / "stack.json"


def test_each_fails_the_clauses_that_it_was_trained_to_fail(base: Path) -> None:
    """Every reply is read and no syntax repaired; the blind one fails four clauses and no other.

    Sixteen pairs are few for the one that sees: by their draw it may fail an equivariance, and nothing else.
    """
    models = structured.score(base / "calibration").models
    assert all(model.answers.repairs == {} and model.answers.reasons == {} for model in models.values())
    assert models[BLIND].failed == ESTIMATORS["scene_blind"].fails
    assert models[SEEING].failed <= {"scene_equivariance", "action_equivariance"}


def test_the_seeing_one_sees(base: Path) -> None:
    """On 32 frames nine calls of close in ten are right, and gaps are within a step of the truth, on average."""
    figures = structured.score(base / "votes").models[SEEING].statistics
    assert figures["parse"].value == 1.0
    assert figures["balanced_accuracy"].value is not None
    assert figures["balanced_accuracy"].value >= 0.9
    assert figures["gap_mae_m"].value is not None
    assert figures["gap_mae_m"].value <= 4.0


def test_what_answers_with_actions_can_choose_no_guardian(base: Path) -> None:
    """No reply of the battery's organisms holds an estimate, so none votes, and the command says so."""
    models = structured.score(base / "acting").models
    assert [model.answers.reasons for model in models.values()] == [{"missing_field": 32}] * 2
    code, _, told = command("guardian", "fit", base / "acting", "--out", base / "none.json")
    assert code == 2
    assert "no vote by hf:organism:blind, hf:organism:grounded on any of 16 frames" in told
    assert not (base / "none.json").exists()


def test_a_committee_of_two_is_scored_on_what_it_never_saw(base: Path, stack: Path) -> None:
    """With a member that always says hazard it is the other one's votes that decide."""
    code, printed, _ = command(
        "guardian", "score", stack.with_name("guardian.json"), base / "votes", "--unseen", "--json"
    )
    assert code == 0
    chosen = json.loads(stack.with_name("guardian.json").read_text(encoding="utf-8"))
    assert chosen["committee"] == sorted((SEEING, BLIND))
    assert chosen["threshold"] in {3, 4}
    assert json.loads(printed)["rows"]["two_way"]["bal"]["value"] >= 0.9


def test_a_stack_says_hazard_clear_and_nothing_of_a_picture_without_a_road(base: Path, stack: Path) -> None:
    """Through ``Guardian.load`` and through ``eyechart serve``: the same answers, from real weights."""
    bank = open_bank(base / "bank")
    scored = structured.score(base / "votes").models[SEEING].answers
    votes = zip(scored.frames, scored.gap_m, scored.estimates("real"), scored.estimates("mirrored"), strict=True)
    right = [
        (gap_m, frame)
        for frame, gap_m, here, there in votes
        if here is not None and there is not None and here.close == there.close == (gap_m < 18.0)
    ]
    near = next(frame for gap_m, frame in right if gap_m < 15.0)
    far = next(frame for gap_m, frame in right if gap_m > 25.0)
    blank = encode(np.full((150, 600, 3), 128, np.uint8))
    pictures = {"hazard": bank.recorded(near), "clear": bank.recorded(far), "abstain": blank}
    with Guardian.load(stack, deadline_s=30.0) as guardian:
        assert {word: guardian.assess(picture).answer for word, picture in pictures.items()} == {
            word: word for word in pictures
        }
    program = "import sys; from eyechart.cli import main; sys.exit(main())"
    served = [sys.executable, "-c", program, "serve", str(stack), "--port", "0", "--deadline", "30"]
    with subprocess.Popen(served, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            url = next(line for line in process.stderr if " at http://" in line).split(" at ")[1].strip()
            for word, picture in pictures.items():
                asked = urllib.request.Request(f"{url}/assess", picture, {"Content-Type": "image/png"})  # noqa: S310
                with urllib.request.urlopen(asked, timeout=40) as answer:  # noqa: S310 - loopback
                    assert json.load(answer)["answer"] == word
        finally:
            process.terminate()
