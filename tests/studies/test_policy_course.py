"""Checkpoints of a training are compared: how the share of a channel changes, and when a policy stopped looking."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import arms
from arm_logs import arm_bank
from eyechart.cli.app import app
from eyechart.errors import LedgerError, SpecError
from eyechart.frames import FrameBank
from eyechart.manifest import read_manifest
from eyechart.stats.statistic import Statistic
from eyechart.stats.total_effect import Pairs, share_difference
from eyechart.studies import ReadOptions, policy, study_of
from eyechart.studies.policy import PolicySelection
from eyechart.studies.policy.figures import training
from eyechart.studies.policy.training_curve import Change, TrainingCurve, course_of, step_of
from eyechart.studies.policy.training_curve import TrainingCheckpoint as OneCheckpoint
from known import table
from policies_by_hand import IGNORED, NOT_ONE_BIT, verdict
from policies_by_hand import OPEN as OPEN_SHARE

pytestmark = pytest.mark.slow

FEW = ("real", "real_repeat", "nudged", "swapped@cameras", "matched@cameras", "blank")


class Checkpoint:
    """A policy that goes by what it sees in part, and for the rest to the middle."""

    def __init__(self, step: int, looks: float) -> None:
        self.step, self.looks, self.version = step, looks, f"step {step}"
        self.channels = arms.reach.channels if looks else arms.middle.channels  # type: ignore[attr-defined]

    def __call__(self, images: arms.Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Return a mixture of two motions."""
        seen, blind = (one(images, state, instruction) for one in (arms.reach, arms.middle))
        return np.asarray(self.looks * seen + (1 - self.looks) * blind)


early, middle, late, again = (Checkpoint(*one) for one in ((100, 1.0), (200, 0.5), (300, 0.0), (400, 0.0)))
HERE = "python:test_policy_course"


class Halted(Checkpoint):
    """One that stays where it is."""

    def __call__(self, images: arms.Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Return nothing but its last bits."""
        return 1e-9 * super().__call__(images, state, instruction)


halted = Halted(150, 0.5)


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of twelve episodes of two frames."""
    return table(tmp_path_factory.mktemp("course") / "bank")


@pytest.fixture
def _here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(Path(__file__).parent)


@pytest.mark.usefixtures("_here")
def test_the_step_at_which_a_policy_stopped_looking_is_named(bank: FrameBank, tmp_path: Path) -> None:
    """In the order of the steps, whatever the order of the runs; JSON, sentences, and exit 1 where anything changed."""
    for name, specs in {"one": ["late", "early"], "two": ["middle", "again"]}.items():
        policy.run(policy.plan(bank.root, [f"{HERE}:{spec}" for spec in specs], tmp_path / name))
    result = CliRunner().invoke(app, ["compare", str(tmp_path / "one"), str(tmp_path / "two"), "--json"])
    assert result.exit_code == 1, result.output
    said = json.loads(result.stdout)
    assert [one["step"] for one in said["policies"]] == [100, 200, 300, 400]
    shares = [one["channels"]["cameras"]["T"] for one in said["policies"]]
    assert shares[0] > shares[1] > shares[2] == shares[3] == 0
    assert said["policies"][0]["camera"] != "ignores_camera"
    first, _, last = said["changes"]
    assert first["channels"]["cameras"]["value"] == pytest.approx(shares[1] - shares[0])
    assert (last["labels"], last["changed"]) == ({}, [])
    assert f"from {HERE}:late, step 300 on it ignores its cameras" in said["says"]
    printed = CliRunner().invoke(app, ["compare", str(tmp_path / "one"), str(tmp_path / "two")])
    assert "on it ignores its cameras" in printed.stdout.replace("\n", " ")


@pytest.mark.usefixtures("_here")
def test_a_checkpoint_whose_guard_failed_is_not_compared(bank: FrameBank, tmp_path: Path) -> None:
    """It neither looks nor stops looking; its guard is named, and no share of it stands in a table or a figure."""
    specs = [f"{HERE}:{name}" for name in ("early", "halted", "late")]
    policy.run(policy.plan(bank.root, specs, tmp_path / "run", conditions=FEW))
    course = course_of([policy.score(tmp_path / "run")])
    said = list(course.says())
    assert said[0].endswith(f"not compared: guard constant of {specs[1]}, step 150")
    assert said[1].endswith(f"not compared: guard constant of {specs[1]}, step 150")
    assert not any("on it" in one for one in said)
    assert course.changes[0].labels["guards"] == ("", "constant")
    assert not course.is_replicated
    shares, _ = course.tables()
    row = next(row for row in shares.rows if row[0] == specs[1])
    assert row[2].text == "constant"
    assert set(row[3:]) == {None}
    assert " at 150" not in training(course).description


def _checkpoint(name: str, step: int | None, **changed: Statistic | None) -> OneCheckpoint:
    return OneCheckpoint(SimpleNamespace(model=name, version="1"), verdict(**changed), step)  # type: ignore[arg-type]


IGNORING = {"swap": IGNORED, "matched": IGNORED, "blank": IGNORED}


@pytest.mark.parametrize(
    ("first", "second", "steps", "said"),
    [
        ({}, IGNORING, (1, 2), ["from b, step 2 on it ignores its cameras"]),
        (IGNORING, {}, (1, 2), ["from b, step 2 on it no longer ignores its cameras"]),
        ({"matched": None}, IGNORING, (1, 2), ["from b, step 2 on it ignores its cameras"]),
        (IGNORING, {"swap": OPEN_SHARE}, (1, 2), []),
        (IGNORING, IGNORING | {"swap": NOT_ONE_BIT}, (1, 2), []),
        ({}, IGNORING, (None, None), []),
    ],
)
def test_that_it_stopped_looking_is_said_between_what_is_settled(
    first: dict[str, Statistic | None],
    second: dict[str, Statistic | None],
    steps: tuple[int | None, int | None],
    said: list[str],
) -> None:
    """And only of checkpoints that have steps: others are no training."""
    pair = _checkpoint("a", steps[0], **first), _checkpoint("b", steps[1], **second)
    assert list(TrainingCurve(pair, (pair,), ()).says()) == said


def test_a_difference_that_is_rounding_is_none() -> None:
    """However small its p: where every frame rounds alike, no test takes it for chance."""

    def change(apart: float) -> Change:
        return Change("a", "b", {}, {"cameras": Statistic(apart, 72, p=1e-4)}, {"cameras": 2e-4})

    assert change(-1e-11).changed == ()
    assert change(-1e-11).says() == "no share differs (Holm)"
    assert change(-0.01).changed == ("cameras",)


@pytest.mark.usefixtures("_here")
def test_a_run_of_the_same_again_changes_nothing(bank: FrameBank, tmp_path: Path) -> None:
    """Exit 0; what was not asked about the same frames is refused, and so is one policy alone."""
    for name, limit in {"one": None, "two": None, "part": 15}.items():
        planned = policy.plan(
            bank.root, [f"{HERE}:early"], tmp_path / name, conditions=FEW, extent=PolicySelection(limit=limit)
        )
        policy.run(planned)
    runs = [str(tmp_path / name) for name in ("one", "two", "part")]
    assert CliRunner().invoke(app, ["compare", *runs[:2]]).exit_code == 0
    scores = [study_of(Path(run)).score(Path(run), ReadOptions()) for run in runs]
    with pytest.raises(SpecError, match="have different frames"):
        course_of(scores)
    with pytest.raises(SpecError, match="there is one policy, and nothing to compare it with"):
        course_of(scores[:1])


@pytest.mark.usefixtures("_here")
def test_runs_whose_motions_mean_something_else_are_neither_compared_nor_resumed(tmp_path: Path) -> None:
    """Banks of one fingerprint that say otherwise what a motion is: named is what differs, and both banks."""
    banks = {kind: arm_bank(tmp_path / kind, kind=kind, horizon=2) for kind in ("delta", "absolute")}
    assert len({one.manifest.fingerprint for one in banks.values()}) == 1
    for kind, one in banks.items():
        policy.run(
            policy.plan(
                one.root,
                ["python:arm_logs:by_front"],
                tmp_path / f"run-{kind}",
                conditions=["real", "real_repeat", "swapped@cameras"],
            )
        )
    scores = [policy.score(tmp_path / f"run-{kind}") for kind in banks]
    with pytest.raises(SpecError, match=r"answer with different motions, .*: kind: delta and absolute; .*use one bank"):
        course_of(scores)
    result = CliRunner().invoke(app, ["compare", *(str(tmp_path / f"run-{kind}") for kind in banks)])
    assert result.exit_code != 0
    with pytest.raises(LedgerError, match=r"has motion with kind delta, .*now motion with kind absolute, .* was"):
        policy.plan(banks["absolute"].root, ["python:arm_logs:by_front"], tmp_path / "run-delta")
    longer = arm_bank(tmp_path / "longer", kind="delta", horizon=3)
    with pytest.raises(LedgerError, match="this run has motion with horizon 2, now motion with horizon 3 was"):
        policy.plan(longer.root, ["python:arm_logs:by_front"], tmp_path / "run-delta")
    other = arm_bank(tmp_path / "other", kind="delta", horizon=2, episodes=7)
    with pytest.raises(
        LedgerError, match=r"has the bank .*delta/bank \(fingerprint .*\), now the bank .*other/bank \("
    ):
        policy.plan(other.root, ["python:arm_logs:by_front"], tmp_path / "run-delta")


@pytest.mark.usefixtures("_here")
def test_a_replication_of_several_policies_compares_each_with_itself(bank: FrameBank, tmp_path: Path) -> None:
    """Not with whoever was asked after it: those two may well differ, and say nothing of the replication."""
    specs = [f"{HERE}:{one}" for one in ("stepless", "sightless")]
    for name, order in {"one": specs, "two": specs[::-1]}.items():
        policy.run(policy.plan(bank.root, order, tmp_path / name, conditions=FEW))
    result = CliRunner().invoke(app, ["compare", str(tmp_path / "one"), str(tmp_path / "two"), "--json"])
    assert result.exit_code == 0, result.output
    said = json.loads(result.stdout)
    assert [(one["before"], one["after"]) for one in said["changes"]] == [(spec, spec) for spec in specs]
    assert said["replicated"]
    assert CliRunner().invoke(app, ["compare", str(tmp_path / "one")]).exit_code == 1


class Named:
    """A checkpoint that says in its version how far its training had come."""

    def __init__(self, version: str, looks: float) -> None:
        self.version, self._looks = version, looks
        self.channels = Checkpoint(0, looks).channels

    def __call__(self, images: arms.Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        """Answer as the checkpoint that looks as much does."""
        return Checkpoint(0, self._looks)(images, state, instruction)


first, last, nameless = Named("act-step_010000.pt", 1.0), Named("ckpt 30k", 0.0), Named("of June", 0.5)


stepless, sightless = Named("of May", 1.0), Named("of July", 0.0)


@pytest.fixture(scope="module")
def named(bank: FrameBank) -> Path:
    """Return a run of policies whose versions tell their steps, but one's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(Path(__file__).parent)
        specs = [f"{HERE}:{name}" for name in ("last", "nameless", "first")]
        out = bank.root.parent / "named"
        policy.run(policy.plan(bank.root, specs, out))
    return out


def test_the_page_draws_the_shares_over_the_training(named: Path, tmp_path: Path) -> None:
    """By the versions and by what is given; a page without all steps has no such part, and says nothing of it."""
    words = ["report", str(named), "--out"]
    given = ["--step", f"{HERE}:nameless=20000", "--tables", str(tmp_path / "tables"), "--figures", str(tmp_path)]
    result = CliRunner().invoke(app, [*words, str(tmp_path / "page.html"), *given])
    assert result.exit_code == 0, result.output
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "Over the training" in page
    assert "When did it stop looking?" in page
    assert f"from {HERE}:last, step 30000 on it ignores its cameras" in page
    described = re.search(r"by step\. cameras ([\d.]+) at 10000, ([\d.]+) at 20000, ([\d.]+) at 30000", page)
    assert described
    shares = [float(group) for group in described.groups()]
    assert shares[0] > shares[1] > shares[2] == 0
    assert (tmp_path / "training.pdf").stat().st_size > 1000
    rows = (tmp_path / "tables" / "course.csv").read_text(encoding="utf-8").splitlines()
    assert [row.split(",")[1] for row in rows[1:]] == ["10000", "20000", "30000"]
    assert CliRunner().invoke(app, [*words, str(tmp_path / "other.html")]).exit_code == 0
    assert "Over the training" not in (tmp_path / "other.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("step", "said"),
    [
        ("nameless", "--step is SPEC=N with a whole number, as python:my:act=20000, not 'nameless'"),
        (f"{HERE}:nameless=-1", "--step is SPEC=N"),
        ("python:my:act=1", "--step names 'python:my:act', but the policies of these runs are"),
        (f"{HERE}:first=1", f"--step gives no order, since {HERE}:nameless has no step"),
    ],
)
def test_a_step_that_cannot_be_is_refused_in_words(named: Path, tmp_path: Path, step: str, said: str) -> None:
    """One line, exit 2, and no page."""
    result = CliRunner().invoke(app, ["report", str(named), "--out", str(tmp_path / "page.html"), "--step", step])
    assert isinstance(result.exception, SpecError)
    assert said in str(result.exception)
    assert not (tmp_path / "page.html").exists()


@pytest.mark.parametrize(
    ("version", "step"),
    [
        ("step 20000", 20_000),
        ("pi0_checkpoint-020000", 20_000),
        ("ckpt_20k.safetensors", 20_000),
        ("iter=1_500", 1500),
        ("run3-epoch2", 2),
        ("epoch 1.5", None),
        ("3", None),
        ("missteps 4", None),
        ("1f2e3d4c5b6a", None),
    ],
)
def test_a_step_is_read_from_a_version_that_names_it(named: Path, version: str, step: int | None) -> None:
    """A number without a word for it is no step; what is declared comes before, and what is given before that."""
    manifest = replace(read_manifest(named), models={"it": version}, facts={"it": {}})
    assert step_of(manifest, "it", {}) == step
    declared = replace(manifest, facts={"it": {"step": "7"}})
    assert (step_of(declared, "it", {}), step_of(declared, "it", {"it": 8})) == (7, 8)


def test_a_difference_of_shares_is_found_as_often_as_it_says() -> None:
    """Of two policies with one share, at .02 in about two of a hundred data sets; of .1 and .4 in nearly all."""

    def pairs(share: float, rng: np.random.Generator) -> Pairs:
        owner = np.repeat(np.arange(12), 6)
        episode, frame = rng.normal(size=(12, 9)), rng.normal(size=(72, 9))
        values = share * ((0.8 * episode[owner] + 0.6 * frame) ** 2).mean(axis=1)
        return Pairs(values, owner, np.roll(owner, 6))

    def p(shares: tuple[float, float], seed: int) -> float:
        rng = np.random.default_rng(seed)
        whole = pairs(1.0, rng)
        statistic = share_difference(*((pairs(share, rng), whole) for share in shares))
        assert statistic.p is not None
        return statistic.p

    assert np.mean([p((0.3, 0.3), seed) < 0.02 for seed in range(400)]) < 0.04
    assert np.mean([p((0.1, 0.4), seed) < 0.02 for seed in range(100)]) > 0.5
    one = pairs(0.3, np.random.default_rng(0))
    assert share_difference((one, one), (one, one)).p == 1
