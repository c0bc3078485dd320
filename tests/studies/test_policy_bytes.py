"""Policies whose noise hangs on the bytes of what they are given, beside those that know pictures by their bytes."""

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from test_policy_adversaries import drifting, trace

from arms import Images, deaf, reach
from eyechart.frames import FrameBank, decode, open_bank
from eyechart.studies import policy
from eyechart.studies.policy.scores import judge
from eyechart.verdicts.policy_verdict import PolicyVerdict
from known import table

pytestmark = pytest.mark.slow

LOOKS, NEVER = {"object_grounded", "camera_content"}, {"ignores_camera", "undecided"}
Policy = Callable[[Images, np.ndarray, str | None], np.ndarray]


def drawn(images: Images, state: np.ndarray, instruction: str | None, *, whole: bool) -> np.ndarray:
    """Return noise by the bytes of the pictures, or of the whole input: the same for the same bytes."""
    read = hashlib.sha256(b"".join(image.tobytes() for image in images.values()))
    if whole:
        read.update(state.tobytes() + (instruction or "").encode())
    return np.array([1, 1, 0]) * np.random.default_rng(list(read.digest()[:8])).normal(size=3)


def noisy(plain: Policy, size: float, *, whole: bool) -> Policy:
    """Return a policy with so much of such noise."""

    def act(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
        noise = size * drawn(images, state, instruction, whole=whole)
        return plain(images, state, instruction) + noise + trace(images, state, instruction)

    return act


def never(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Never look, and go to the middle."""
    del images, instruction
    return drifting(state)


SIZES = (0.05, 0.1, 0.3, 0.6, 1.0)
READERS, BLIND = [], []
for _plain, _names in ((reach, READERS), (deaf, READERS), (never, BLIND)):
    for _size in SIZES:
        _names.append(f"{_plain.__name__}_{100 * _size:.0f}_{'whole' if _size == 0.3 else 'pictures'}")
        globals()[_names[-1]] = noisy(_plain, _size, whole=_size == 0.3)
HERE: list[Path] = []
"""The bank that is asked about."""


@cache
def known(root: Path) -> frozenset[bytes]:
    """Return the pictures of the moments of a bank."""
    bank = open_bank(root)
    shown = ((frame, bank.images(frame)) for frame in bank)
    return frozenset(b"".join(decode(one[name], name).tobytes() for name in sorted(one)) for _, one in shown)


def is_known(images: Images) -> bool:
    """Return whether these are the pictures of a moment of the bank, to the byte."""
    return b"".join(images[name].tobytes() for name in sorted(images)) in known(HERE[0])


def learnt(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Know what to do at the pictures of its log, and drift at all others."""
    plain = reach if is_known(images) else never
    return plain(images, state, instruction) + trace(images, state, instruction)


def half_learnt(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Drift, and know a little of what to do at the pictures of its log."""
    return 0.7 * never(images, state, instruction) + 0.3 * learnt(images, state, instruction)


def learnt_else_noise(images: Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Know what to do at the pictures of its log, and answer all others by their bytes."""
    noise = 0.3 * drawn(images, state, instruction, whole=True)
    return learnt(images, state, instruction) + (0 if is_known(images) else noise)


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of twelve episodes of two frames."""
    result = table(tmp_path_factory.mktemp("bytes") / "bank")
    HERE[:] = [result.root]
    return result


def verdicts(bank: FrameBank, out: Path, names: list[str]) -> dict[str, PolicyVerdict]:
    """Return the verdicts on policies of this module."""
    specs = {f"python:{__name__}:{name}": name for name in names}
    policy.run(policy.plan(bank.root, list(specs), out))
    return {specs[spec]: one for spec, one in judge(policy.score(out)).items()}


@pytest.fixture(scope="module")
def found(bank: FrameBank, tmp_path_factory: pytest.TempPathFactory) -> dict[str, PolicyVerdict]:
    """Return the verdict on every policy with noise."""
    with pytest.MonkeyPatch.context() as patched:
        patched.syspath_prepend(Path(__file__).parent)
        return verdicts(bank, tmp_path_factory.mktemp("runs") / "run", READERS + BLIND)


@pytest.mark.parametrize("name", READERS)
def test_a_reader_whose_noise_hangs_on_the_bytes_looks_or_is_told_why_not(
    found: dict[str, PolicyVerdict], name: str
) -> None:
    """Up to a noise of 30 % of the way it looks; beyond, nobody says that it does not."""
    one = found[name]
    small = not name.partition("_")[2].startswith(("60", "100"))
    assert one.camera.label in (LOOKS if small else LOOKS | {"undecided"})
    if one.camera.label == "undecided":
        assert "one value of its pictures that is one level off" in one.because
    if name.startswith("reach") and name.endswith(("_5_pictures", "_10_pictures")):
        assert one.camera.label == "object_grounded"
    assert one.instruction.label != ("instruction_ignored" if name.startswith("reach") else "instruction_followed")


@pytest.mark.parametrize("name", BLIND)
def test_who_answers_by_the_bytes_alone_never_looks(found: dict[str, PolicyVerdict], name: str) -> None:
    """Where next to nothing hangs on them it is said to ignore its cameras; where more does, to be inconsistent."""
    one = found[name]
    assert {one.camera.label, *(each.label for each in one.cameras.values())} <= NEVER
    assert one.instruction.label in {"instruction_ignored", "undecided"}
    if name == "never_5_pictures":
        assert one.camera.label == "ignores_camera"
    if not name.startswith(("never_5_", "never_10_")):
        assert "it answers by the bytes of its pictures" in one.guards["self_inconsistent"]


@pytest.mark.parametrize("name", ["learnt", "half_learnt", "learnt_else_noise"])
def test_who_knows_the_pictures_of_its_log_by_their_bytes_does_not_look(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Other pictures of the log change its answers; ones that are one level off are as unknown to it as grey ones."""
    monkeypatch.syspath_prepend(Path(__file__).parent)
    one = verdicts(bank, tmp_path / "run", [name])[name]
    assert {one.camera.label, *(each.label for each in one.cameras.values())} <= NEVER
    assert one.state.label == one.instruction.label == "undecided"
