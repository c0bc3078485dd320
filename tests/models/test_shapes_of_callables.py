"""Each shape in which people bring a policy is handled, or named with the way to go on; they are counted.

HANDLED are read as the plain array. Every other shape has its exact sentence: at the opening, of a call that raises,
of an answer that is no motion of the bank, or of one check of the doctor.
"""

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from operator import attrgetter
from pathlib import Path

import pytest
from typer.testing import CliRunner

import shapes_of_callables as shapes
from eyechart.api import examine_policy
from eyechart.cli.app import app
from eyechart.errors import SpecError
from eyechart.frames import FrameBank
from eyechart.simulators import open_bank_simulator

HANDLED = (
    *("plain", "tensor", "actions_in_a_dict", "action_in_a_dict", "lists", "list_of_rows", "tuple_of_rows", "double"),
    *("fortran", "read_only", "nothing_masked", "own_buffer", "arm", "arm.act", "Arm.still", "bound", "partly"),
    *("nameless", "other_names", "further_options", "any_arguments", "writes", "keeps", "prints", "queue_with_reset"),
    *("batch_of_arrays", "one_array_of_a_batch"),
)

POSITION = "cannot be called: it must take the arguments (images, state, instruction) by position, and has"
WRAP = "Name a function that takes them and calls it"
MISSING = "module 'shapes_of_callables' has no callable"
OPENING = {
    "Arm": "cannot be called: it is a class: make an object of it in its module, as arm = Arm(), and name the object",
    "Arm.act": "cannot be called: 'act' is a method, and its owner is a class: make an object of it in its module, "
    "as arm = Arm(), and name the object",
    "policy": f"{MISSING} 'policy': it is a value of type _Policy; name one of its methods: "
    "python:shapes_of_callables:policy.select_action",
    "policy.select_action": f"{POSITION} (batch): too many positional arguments. {WRAP}",
    "one_batch": f"{POSITION} (batch): too many positional arguments. {WRAP}",
    "keywords": f"{POSITION} (*, images, state, instruction): too many positional arguments. {WRAP}",
    "without_words": f"{POSITION} (images, state): too many positional arguments. {WRAP}",
    "controller": "cannot be called: it takes (prompt, image), as a controller does: ask it with "
    "'eyechart run battery' and --model",
    "coroutine": "cannot be called: it is an async function; make it a plain one: each call runs in a thread of its "
    "own",
    "generator": "cannot be called: it yields; let it return the array (horizon, dimensions) instead",
    "plian": f"{MISSING} 'plian'; did you mean 'plain'?",
    "arm.atc": f"{MISSING} 'arm.atc'; did you mean 'act'?",
    "with_history": "declares history = 1, and the bank BANK holds 0 instants before each frame; make the bank with "
    "'eyechart frames import' and --history 1",
}

ARRAY = "return the array (horizon, dimensions)"
FIRST = "is no array; return the first alone, if it is the array (horizon, dimensions): [0]"
PARTS = f"{ARRAY}, alone or as 'actions'; join its parts by np.concatenate(…, -1)"
WHOLE = f"{ARRAY}, alone or as 'actions'; return x[\"actions\"] of it, if that is the array"
NAMES = (
    "is no array of numbers. A policy that answers with names is a controller: let it take (prompt, image), and ask it "
    "with 'eyechart run battery' as --model python:MODULE:FUNCTION, with the names in the [answer] of --prompt FILE"
)
RAISED = {
    "wrong_camera": "KeyError: 'cam_high'",
    "channels_first": "ValueError: expected 3 channels, got (32, 32, 3)",
    "leaves": "RuntimeError: SystemExit: 3",
    "cuda": "ValueError: a _Tensor is no array: can't convert cuda:0 device type tensor to numpy. Use Tensor.cpu() to "
    "copy the tensor to host memory first.",
    "with_gradient": "ValueError: a _Tensor is no array: Can't call numpy() on Tensor that requires grad. Use "
    "tensor.detach().numpy() instead.",
    "bfloat16": "ValueError: a _Tensor is no array: Got unsupported ScalarType BFloat16; numpy has no such numbers: "
    "return .float()",
    "parts": "ValueError: a dict is no array of numbers; its keys are 'action.arm', 'action.gripper': " + PARTS,
    "fails_in_lines": "RuntimeError: CUDA error: device-side assert in ndarray",
    "one_query": "TypeError: 'list' object is not a mapping",
    "two_arrays": f"ValueError: a dict is no array of numbers; its keys are 'actions', 'values': {WHOLE}",
    "actions_and_attention": f"ValueError: a dict is no array of numbers; its keys are 'actions', 'attn': {WHOLE}",
    "action_and_list": "ValueError: a dict is no array of numbers; its keys are 'action', 'info': "
    + WHOLE.replace('actions"]', 'action"]'),
    "many_parts": "ValueError: a dict is no array of numbers; its keys are "
    + ", ".join(f"'action.joint_position_{number}'" for number in range(7))
    + f", 'action.joi…: {PARTS}",
    "parts_and_info": f"ValueError: a list of 2 (dict, dict) {FIRST}",
    "answer_and_info": f"ValueError: a tuple of 2 (ndarray, dict) {FIRST}",
    "named_pair": f"ValueError: a _Pair of 2 (ndarray, dict) {FIRST}",
    "record": "ValueError: a _Chunk is no array of numbers; return its .actions",
    "ragged_rows": "ValueError: a list is no array: its rows differ in length: return as many numbers for each step",
    "nothing": f"ValueError: a NoneType is no array of numbers; {ARRAY}",
    "word": f"ValueError: a text {NAMES}",
    "word_in_a_dict": f"ValueError: a dict of texts {NAMES}",
    "numbers_as_text": "ValueError: numbers written as text are no array of numbers; return them by .astype(float)",
    "json_text": "ValueError: a text of JSON is no array of numbers; return json.loads of it",
    "raw_bytes": "ValueError: bytes are no array of numbers; return the array itself",
    "masked": "ValueError: a masked array hides 1 number, and the values below are no answer; return an array without "
    "a mask",
    "objects": "ValueError: an array of object has no numbers of up to 64 bits; return it as float32",
    "whether": "ValueError: an array of bool has no numbers of up to 64 bits; return it as float32",
    "returns_a_coroutine": f"ValueError: a coroutine is no array of numbers; {ARRAY} that it gives: let a plain "
    "function run it, as by asyncio.run",
    "returns_an_iterator": f"ValueError: an iterator is no array of numbers; {ARRAY} whole, not by yield",
}

FINITE = "some of its values are not numbers (NaN, infinite, or beyond 1e+30), those of"
CHUNK = "return the chunk alone, without the axis of the batch: [0]"
PADDED = "a step of the bank has 3 numbers: dx, dy, grip; if the others pad them, return [:, :3]"
NO_MOTION = {
    "not_a_number": f"{FINITE} dy; its normalisation may lack its statistics",
    "infinite": f"{FINITE} grip; its normalisation may lack its statistics",
    "batch_axis": f"its shape is (1, 8, 3), and that of the bank's motions (8, 3): {CHUNK}",
    "batch_axis_in_a_dict": f"its shape is (1, 8, 3), and that of the bank's motions (8, 3): {CHUNK}",
    "one_step": "its shape is (3,), and that of the bank's motions (8, 3): return all 8 steps of the chunk, not one of "
    "them",
    "queue": "its shape is (3,), and that of the bank's motions (8, 3): return all 8 steps of the chunk, not one of "
    "them",
    "one_step_batch": "its shape is (1, 3), and that of the bank's motions (8, 3): return 8 steps, or import the bank "
    "with --horizon 1",
    "longer": "its shape is (16, 3), and that of the bank's motions (8, 3): return 8 steps, or import the bank with "
    "--horizon 16",
    "padded": f"its shape is (8, 32), and that of the bank's motions (8, 3): {PADDED}",
    "padded_batch": f"its shape is (1, 8, 32), and that of the bank's motions (8, 3): {CHUNK}; then {PADDED}",
    "flat": "its shape is (24,), and that of the bank's motions (8, 3): return it as .reshape(8, 3)",
    "transposed": "its shape is (3, 8), and that of the bank's motions (8, 3): return it with the steps first: .T",
    "no_steps": "its shape is (0, 3), and that of the bank's motions (8, 3): return an array of 8 steps of 3 numbers",
    "number": "its shape is (), and that of the bank's motions (8, 3): return an array of 8 steps of 3 numbers",
}

CHECKS: Mapping[str, tuple[str, str, str]] = {
    "ragged": (
        "motions",
        "amiss",
        (
            "5 of 13 calls hold no motion: its shape is (5, 3), and that of the bank's motions (8, 3): return 8 "
            "steps, or import the bank with --horizon 5. No more were made: the last 3 failed in the same way"
        ),
    ),
    "normalised": (
        "unit",
        "amiss",
        "'dx' is 46 times as large as in the log: is its normalisation skipped, or its unit different?",
    ),
    "recurrent": (
        "same",
        "amiss",
        "the same frame gets a different answer after another frame: it keeps a memory; declare reset",
    ),
    "queue_tiled": (
        "same",
        "cannot say",
        "the same frame gets two answers: it draws them at random, or keeps a memory; for a memory, declare reset",
    ),
    "two_observations": (
        "constant",
        "cannot say",
        (
            "frames of different episodes get the same answer. It declares reset, and each call gives it one instant: "
            "if it needs earlier ones, let it declare history"
        ),
    ),
    "blind_to_grey": ("grey", "cannot say", "no motion: error. A run judges it by its other answers"),
    "first_of_a_batch": (
        "batch",
        "amiss",
        (
            "two frames in a batch fail, so each was asked alone, as a run does: ValueError: 2 queries got 1 answers; "
            "a callable with 'batch' returns a list of arrays, one for each"
        ),
    ),
    "reversed_batch": (
        "batch",
        "amiss",
        (
            "in a batch its answers differ from those alone by 1 of what two frames differ by: are they in the order "
            "of the queries, and without regard to others?"
        ),
    ),
}

GUARDED = {
    "queue_tiled": "self_inconsistent",
    "recurrent": "self_inconsistent",
    "reversed_batch": "self_inconsistent",
    "normalised": "misfit",
    "ragged": "not_scorable",
    "two_observations": "constant",
}
"""The guards by which a run gives no verdict."""

FIRST_TRIED = (
    *("cuda", "tensor", "bfloat16", "batch_axis", "actions_in_a_dict", "batch_axis_in_a_dict", "parts"),
    *("answer_and_info", "lists", "one_step", "one_step_batch", "longer", "padded", "flat", "channels_first"),
    *("one_batch", "wrong_camera", "queue", "queue_tiled", "recurrent", "normalised", "arm", "arm.act", "ragged"),
    *("coroutine", "generator", "without_words", "keywords"),
)
"""The 28 shapes that were tried first, of which seven were neither handled nor named well."""

INPUTS = (
    "(its inputs are the pictures top: (32, 32, 3) uint8, wrist: (32, 32, 3) uint8; a state of 3 numbers (state); "
    "an instruction)"
)
IN_LISTS = (
    "its inputs come in lists of up to 4, as it declares batch: let it take lists and answer a list of arrays, or "
    "take 'batch' away; each is"
)
FEW = ("--conditions", "real,real_repeat,swapped@cameras,blank")
ENDED = "No more were made: the last 3 failed in the same way"


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a small tabletop, whose motions are 8 steps of 3 numbers."""
    return open_bank_simulator("tabletop").build(tmp_path_factory.mktemp("shapes") / "bank", seeds=(0,), steps=4)


@pytest.fixture(autouse=True)
def _forgotten() -> None:
    """Let no shape keep what another test asked of it."""
    shapes.forget()


def spec(name: str) -> str:
    """Return the SPEC of a shape."""
    return f"python:shapes_of_callables:{name}"


def doctor(bank: FrameBank, name: str) -> tuple[int, dict[str, tuple[str, str]]]:
    """Return how the command ends, and each finding that it prints, by its check."""
    done = CliRunner().invoke(app, ["doctor", spec(name), "--frames", str(bank.root), "--json"])
    found = json.loads(done.stdout)["findings"]
    return done.exit_code, {one["check"]: (one["outcome"], one["says"]) for one in found}


def run(bank: FrameBank, out: Path, names: Sequence[str], *more: str) -> tuple[int, str]:
    """Return how a run of several shapes ends, and all that it prints, in one line."""
    asked = [word for name in names for word in ("--policy", spec(name))]
    done = CliRunner().invoke(app, ["run", "policy", *asked, "--frames", str(bank.root), "--out", str(out), *more])
    return done.exit_code, " ".join(done.output.split())


def test_all_shapes_are_handled_or_named_and_none_is_counted_twice() -> None:
    """Those that were tried first are among them, and so is all that shapes_of_callables.py holds."""
    tables = (HANDLED, OPENING, RAISED, NO_MOTION, CHECKS)
    shown = [name for one in tables for name in one]
    assert [len(one) for one in tables] == [27, 13, 29, 14, 8]
    assert len(set(shown)) == len(shown) == 91
    assert len(set(FIRST_TRIED)) == 28
    assert set(FIRST_TRIED) <= set(shown)
    here = {name for name, one in vars(shapes).items() if _is_of(one) and name[0] != "_"}
    assert here - {"network"} <= set(shown)
    assert set(GUARDED) < set(CHECKS)


def _is_of(one: object) -> bool:
    return any(one is known for known in (shapes.partly, shapes.policy)) or (
        callable(one) and one.__module__ == "shapes_of_callables" and one is not shapes.forget
    )


@pytest.mark.parametrize("name", HANDLED)
def test_the_doctor_finds_what_it_finds_of_the_plain_array(bank: FrameBank, name: str) -> None:
    """Nothing is amiss, by its name and as an object."""
    code, found = doctor(bank, name)
    batch = found.pop("batch", ("fine", ""))
    assert (code, found) == doctor(bank, "plain")
    assert {outcome for outcome, _ in (*found.values(), batch)} == {"fine"}
    findings = examine_policy(bank, attrgetter(name)(shapes)).findings
    assert {one.name: one.says for one in findings if one.name != "batch"} == {
        check: says for check, (_, says) in found.items()
    }


@pytest.mark.parametrize("name", OPENING)
def test_what_cannot_be_called_is_refused_before_the_first_call(bank: FrameBank, tmp_path: Path, name: str) -> None:
    """By the doctor and by a run, which leaves nothing behind."""
    between = ": " if OPENING[name].startswith("module") else " "
    words = f"'{spec(name)}'{between}{OPENING[name].replace('BANK', str(bank.root))}"
    for more in (["doctor", spec(name)], ["run", "policy", "--policy", spec(name), "--out", str(tmp_path / "run")]):
        done = CliRunner().invoke(app, [*more, "--frames", str(bank.root)])
        assert isinstance(done.exception, SpecError)
        assert str(done.exception) == words
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("name", [*RAISED, *NO_MOTION])
def test_the_doctor_names_what_came_and_the_way_on(bank: FrameBank, name: str) -> None:
    """After three calls, in one sentence, by its name and as an object."""
    inputs = INPUTS.replace("its inputs are", IN_LISTS) if name == "one_query" else INPUTS
    words = f"it fails: {RAISED[name]} {inputs}" if name in RAISED else NO_MOTION[name]
    says = f"3 of 3 calls hold no motion: {words}. {ENDED}"
    assert doctor(bank, name) == (1, {"motions": ("amiss", says)})
    assert [one.says for one in examine_policy(bank, attrgetter(name)(shapes)).findings] == [says]


@pytest.mark.parametrize("name", CHECKS)
def test_the_doctor_names_what_only_several_calls_show(bank: FrameBank, name: str) -> None:
    """And nothing else but what follows from it."""
    code, found = doctor(bank, name)
    check, outcome, says = CHECKS[name]
    also = ["unit"] if name == "queue_tiled" else []  # a first step eight times goes farther
    assert found[check] == (outcome, says)
    assert [one for one, (result, _) in found.items() if result == "amiss" and one != check] == also
    assert code == (1 if outcome == "amiss" or also else 0)


def test_a_run_computes_the_same_of_each_handled_shape(bank: FrameBank, tmp_path: Path) -> None:
    """Every statistic and every label, to the last digit."""
    code, said = run(bank, tmp_path / "run", HANDLED, *FEW)
    assert (code, "set aside" in said) == (0, False), said
    scored = json.loads(CliRunner().invoke(app, ["score", str(tmp_path / "run"), "--json"]).stdout)
    found = {name: json.dumps(scored["policies"][spec(name)], sort_keys=True) for name in HANDLED}
    assert "T.swapped@cameras" in found["plain"]
    assert {one.replace(spec(name), "") for name, one in found.items()} == {found["plain"].replace(spec("plain"), "")}


def test_a_run_sets_each_other_shape_aside_with_the_same_words(bank: FrameBank, tmp_path: Path) -> None:
    """After ten calls."""
    code, said = run(bank, tmp_path / "run", [*RAISED, *NO_MOTION])
    assert code == 1
    failed = "10 calls in a row failed, the last one with"
    for kind, words in (("exception", RAISED), ("no motion", NO_MOTION)):
        for name, one in words.items():
            assert f"set aside: {spec(name)}: {failed} {kind}: {one}" in said


def test_a_run_gives_no_verdict_on_what_a_guard_finds(bank: FrameBank, tmp_path: Path) -> None:
    """What fails on grey alone, or only in batches, is judged as the plain array."""
    code, printed = run(bank, tmp_path / "run", ["plain", *CHECKS], *FEW)
    assert code == 0, printed
    said = json.loads(CliRunner().invoke(app, ["verdict", str(tmp_path / "run"), "--json"]).stdout)["policies"]
    for name, guard in GUARDED.items():
        assert guard in said[spec(name)]["guards"], (name, said[spec(name)])
    for name in set(CHECKS) - set(GUARDED):
        assert said[spec(name)]["axes"] == said[spec("plain")]["axes"]


def test_what_a_policy_prints_stays_out_of_the_json(bank: FrameBank) -> None:
    """As in a shell, where it may print from any thread."""
    command = [sys.executable, "-m", "eyechart", "doctor", spec("prints"), "--frames", str(bank.root), "--json"]
    done = subprocess.run(command, cwd=Path(shapes.__file__).parent, capture_output=True, text=True, check=False)
    assert json.loads(done.stdout)["policy"] == spec("prints")
    assert (done.returncode, "INFO step" in done.stderr) == (0, True)
