import hashlib
import json
import math
import os
import shutil
import signal
import struct
import subprocess
import sys
import time
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image

import banks
from eyechart import cli
from eyechart.errors import BankError
from eyechart.frames import (
    MAIN,
    BankWriter,
    Camera,
    Frame,
    FrameBank,
    check,
    decode,
    encode,
    inside,
    open_bank,
    pictures,
    read_bounded,
    read_metadata,
    rounded_truth,
)
from eyechart.simulators import open_bank_simulator

PICTURE = "images/dense-0-2.png"


@pytest.fixture
def bank(tmp_path: Path) -> FrameBank:
    """Return a fresh bank that a test may damage."""
    return banks.build_bank(tmp_path / "bank")


def rows_of(root: Path) -> list[dict[str, object]]:
    """Return the rows of a bank's metadata."""
    return [json.loads(line) for line in (root / "metadata.jsonl").read_text(encoding="utf-8").splitlines()]


def put_rows(root: Path, rows: list[dict[str, object]]) -> None:
    """Write the rows of a bank's metadata."""
    text = "".join(json.dumps(row) + "\n" for row in rows)
    (root / "metadata.jsonl").write_text(text, encoding="utf-8")


def change_row(root: Path, **values: object) -> None:
    """Change values in the row of the frame dense-0-2."""
    put_rows(root, [row | values if row["frame_id"] == "dense-0-2" else row for row in rows_of(root)])


def change_manifest(root: Path, **values: object) -> None:
    """Change values in a bank's manifest."""
    path = root / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8")) | values), encoding="utf-8")


def huge_png(side: int) -> bytes:
    """Return a small, valid PNG of ``side`` × ``side`` pixels of one bit."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    rows = (b"\0" * (1 + (side + 7) // 8)) * side
    header = struct.pack(">IIBBBBB", side, side, 1, 0, 0, 0, 0)
    parts = (chunk(b"IHDR", header), chunk(b"IDAT", zlib.compress(rows, 9)), chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def changed_pixel(root: Path) -> None:
    """Change one pixel of a picture by one."""
    pixels = decode((root / PICTURE).read_bytes(), PICTURE).copy()
    pixels[8, 30, 1] += 1
    (root / PICTURE).write_bytes(encode(pixels))


def truncated(root: Path) -> None:
    """Cut the end of a picture."""
    picture = (root / PICTURE).read_bytes()
    (root / PICTURE).write_bytes(picture[: len(picture) // 2])


def megapixels(root: Path) -> None:
    """Put a picture of 100 megapixels in the place of another."""
    picture = huge_png(10_000)
    assert len(picture) < 50_000
    (root / PICTURE).write_bytes(picture)


def gigapixels(root: Path) -> None:
    """Patch a picture's header to declare 2 500 megapixels."""
    picture = bytearray((root / PICTURE).read_bytes())
    picture[16:24] = struct.pack(">II", 50_000, 50_000)
    picture[29:33] = struct.pack(">I", zlib.crc32(picture[12:29]))
    (root / PICTURE).write_bytes(picture)


def too_many_bytes(root: Path) -> None:
    """Let a picture's file be larger than any that is read."""
    with (root / PICTURE).open("r+b") as file:
        file.truncate(65_000_000)


def directory(root: Path) -> None:
    """Put a directory in the place of a picture."""
    (root / PICTURE).unlink()
    (root / PICTURE).mkdir()


def pipe(root: Path) -> None:
    """Put a named pipe, at which a reader would wait for ever, in the place of a picture."""
    (root / PICTURE).unlink()
    os.mkfifo(root / PICTURE)


def symlink(root: Path) -> None:
    """Let a picture be a link to a file outside the bank."""
    (root / PICTURE).rename(root.parent / "outside.png")
    (root / PICTURE).symlink_to(root.parent / "outside.png")


def loop(root: Path) -> None:
    """Let a picture be a link to itself."""
    (root / PICTURE).unlink()
    (root / PICTURE).symlink_to(root / PICTURE)


def swapped(root: Path) -> None:
    """Let two frames show each other's picture: every file is as recorded, and no frame is."""
    rows = rows_of(root)
    rows[0]["file_name"], rows[1]["file_name"] = rows[1]["file_name"], rows[0]["file_name"]
    put_rows(root, rows)


def swapped_counterfactuals(root: Path) -> None:
    """Let lead_near show the far lead, and the other way round."""
    near, far = f"lead_near/{Path(PICTURE).name}", f"lead_far/{Path(PICTURE).name}"
    change_row(root, lead_near_file_name=far, lead_far_file_name=near)


def unlisted(root: Path) -> None:
    """Take a picture out of the manifest's list."""
    images = json.loads((root / "manifest.json").read_text(encoding="utf-8"))["images"]
    change_manifest(root, images={file: digest for file, digest in images.items() if file != PICTURE})


def orphan(root: Path) -> None:
    """List a picture that belongs to no frame."""
    images = json.loads((root / "manifest.json").read_text(encoding="utf-8"))["images"]
    change_manifest(root, images=images | {"images/orphan.png": "0" * 64})


def twice(root: Path) -> None:
    """Let a frame stand twice in the metadata."""
    rows = rows_of(root)
    put_rows(root, [*rows, rows[4]])


def reordered(root: Path) -> None:
    """Write the frames in another order."""
    put_rows(root, rows_of(root)[::-1])


def binary(root: Path) -> None:
    """Write metadata that are no UTF-8."""
    (root / "metadata.jsonl").write_bytes((root / "metadata.jsonl").read_bytes().replace(b"merge", b"m\xffrge"))


def nested(root: Path) -> None:
    """Write a line that is nested deeper than a parser goes."""
    (root / "metadata.jsonl").write_text("[" * 100_000, encoding="utf-8")


def metadata_directory(root: Path) -> None:
    """Put a directory in the place of the metadata."""
    (root / "metadata.jsonl").unlink()
    (root / "metadata.jsonl").mkdir()


def manifest_directory(root: Path) -> None:
    """Put a directory in the place of the manifest."""
    (root / "manifest.json").unlink()
    (root / "manifest.json").mkdir()


Damage = Callable[[Path], object]
DAMAGED_PICTURES: dict[str, tuple[Damage, str]] = {
    "a changed pixel": (changed_pixel, f"'{PICTURE}' is not the picture"),
    "a truncated PNG": (truncated, f"'{PICTURE}' is damaged"),
    "100 megapixels": (megapixels, f"'{PICTURE}' has 10000×10000 pixels"),
    "2500 megapixels": (gigapixels, f"'{PICTURE}' has more than 25 megapixels"),
    "65 megabytes": (too_many_bytes, f"'{PICTURE}' has 65000000 bytes"),
    "an empty file": (lambda root: (root / PICTURE).write_bytes(b""), f"'{PICTURE}' is damaged or no picture"),
    "text": (lambda root: (root / PICTURE).write_text("x" * 99), f"'{PICTURE}' is damaged or no picture"),
    "a missing file": (lambda root: (root / PICTURE).unlink(), f"'{PICTURE}' of the bank"),
    "a directory": (directory, f"'{PICTURE}' of the bank"),
    "a pipe": (pipe, f"'{PICTURE}' of the bank"),
    "a link outside": (symlink, f"'{PICTURE}' leads outside the bank"),
    "a link to itself": (loop, f"'{PICTURE}'"),
    "a parent's file": (lambda root: change_row(root, file_name="../x.png"), "'../x.png' leads outside the bank"),
    "an absolute path": (lambda root: change_row(root, file_name="/etc/passwd"), "'/etc/passwd' leads outside"),
    "a far counterfactual": (
        lambda root: change_row(root, lead_far_file_name="images/../../x.png"),
        "'images/../../x.png' leads outside the bank",
    ),
    "a NUL in a name": (lambda root: change_row(root, file_name="a\0b.png"), "'a\\x00b.png' is not a file"),
    "a name too long": (lambda root: change_row(root, file_name="n" * 5000), "nnnn"),
    "swapped pictures": (swapped, "frame 'light-0-0' shows 'images/light-0-1.png'"),
    "swapped counterfactuals": (swapped_counterfactuals, "frame 'dense-0-2' shows 'lead_near/dense-0-2.png'"),
    "an unlisted picture": (unlisted, f"'{PICTURE}' is not in the manifest"),
    "an orphan": (orphan, "'images/orphan.png' of the manifest belongs to no frame"),
    "a changed gap": (lambda root: change_row(root, lead_gap_m=6.001), "ground truth of frame 'dense-0-2' differs"),
    "a gap turned into a word": (lambda root: change_row(root, lead_gap_m="6.000"), "frame 'dense-0-2' differs"),
    "a flag turned into a word": (lambda root: change_row(root, crashed="false"), "frame 'dense-0-2' differs"),
    "a new column": (lambda root: change_row(root, speed=3), "ground truth of frame 'dense-0-2' differs"),
    "another axis": (lambda root: change_row(root, mirror_axis="horizontal"), "frame 'dense-0-2' differs"),
    "another episode": (lambda root: change_row(root, episode="dense-9"), "frame 'dense-0-2' differs"),
    "a renamed frame": (lambda root: change_row(root, frame_id="new"), "frame 'new' is not in the manifest"),
    "a lost frame": (lambda root: put_rows(root, rows_of(root)[:-1]), "frame 'merge-1-2' of the manifest is missing"),
    "another order": (reordered, "the frames are in another order"),
}
"""Damage that ``check`` finds in a bank that it can read: exit 1."""

NOT_A_BANK: dict[str, tuple[Damage, str]] = {
    "a frame twice": (twice, "frame 'light-1-1' occurs 2 times"),
    "a gap of NaN": (
        lambda root: change_row(root, lead_gap_m=math.nan),
        "line 9: frame 'dense-0-2': truth 'lead_gap_m'",
    ),
    "an infinite gap": (lambda root: change_row(root, lead_gap_m=-math.inf), "line 9: frame 'dense-0-2': truth"),
    "a gap of 400 digits": (lambda root: change_row(root, lead_gap_m=10**400), "line 9: frame 'dense-0-2': truth"),
    "a list for a gap": (lambda root: change_row(root, lead_gap_m=[1.0]), "line 9: frame 'dense-0-2': truth"),
    "an unknown axis": (lambda root: change_row(root, mirror_axis="diagonal"), "line 9"),
    "half a step": (lambda root: change_row(root, step=0.5), "line 9"),
    "a lone surrogate": (lambda root: change_row(root, demand="\ud800"), "line 9"),
    "no UTF-8": (binary, "metadata.jsonl, line 13"),
    "deep nesting": (nested, "metadata.jsonl, line 1"),
    "a list for a row": (lambda root: (root / "metadata.jsonl").write_text("[1]\n"), "metadata.jsonl, line 1"),
    "no JSON": (lambda root: (root / "metadata.jsonl").write_text("{}{\n"), "metadata.jsonl, line 1"),
    "no frame": (lambda root: (root / "metadata.jsonl").write_text(""), "metadata.jsonl has no frames"),
    "no metadata": (lambda root: (root / "metadata.jsonl").unlink(), "metadata.jsonl cannot be read"),
    "a directory for metadata": (metadata_directory, "metadata.jsonl cannot be read: Is a directory"),
    "a directory for a manifest": (manifest_directory, "manifest.json cannot be read: Is a directory"),
    "no manifest": (lambda root: (root / "manifest.json").unlink(), "manifest.json does not exist"),
    "a list for a manifest": (
        lambda root: (root / "manifest.json").write_text("[]"),
        "manifest.json is no bank manifest",
    ),
    "nesting": (lambda root: (root / "manifest.json").write_text("[" * 99_999), "manifest.json is no bank manifest"),
    "a binary manifest": (lambda root: (root / "manifest.json").write_bytes(b"\xff{}"), "manifest.json is no bank"),
    "another format": (lambda root: change_manifest(root, format="eyechart-bank/9"), "manifest.json has format"),
    "an edited fingerprint": (
        lambda root: change_manifest(root, fingerprint="0" * 64),
        "manifest.json: the fingerprint",
    ),
    "an edited geometry": (
        lambda root: change_manifest(root, geometry={"light-0-0": "0"}),
        "manifest.json: the finger",
    ),
    "a list for geometry": (lambda root: change_manifest(root, geometry=["x"]), "manifest.json is no bank manifest"),
    "numbers for digests": (lambda root: change_manifest(root, images={"a": 1}), "manifest.json is no bank manifest"),
    "an illegal space": (lambda root: change_manifest(root, action_space={"name": "x"}), "manifest.json is no bank"),
    "a wordy threshold": (
        lambda root: change_manifest(root, gap={"column": "lead_gap_m", "threshold": "near", "unit": "m"}),
        "manifest.json is no bank manifest",
    ),
    "a gap without a unit": (lambda root: change_manifest(root, gap={"column": "c", "threshold": 1}), "manifest.json"),
}
"""Damage that leaves no bank to check: an error, exit 2."""


def eyechart(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str]:
    """Run the command line in this process; return its exit code and what it wrote to standard error."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["eyechart", *map(str, words)])
        with pytest.raises(SystemExit) as left:
            cli.main()
    code = left.value.code
    assert isinstance(code, int)
    return code, capsys.readouterr().err


def test_a_written_bank_reads_back_as_it_was_given(bank: FrameBank) -> None:
    """Frames, truth, counterfactuals, pictures and manifest survive the disk, and check finds nothing."""
    given = banks.frames_of(banks.SCENARIOS, 2, 3, "vertical", drawn=True)
    assert list(bank) == given
    assert check(bank.root) == []
    for code, frame in enumerate(given):
        picture, drawn = banks.pictures_of(frame, code)
        assert bank.images(frame) == picture
        assert {name: bank.images(frame, name) for name in frame.counterfactuals} == drawn
    assert open_bank(bank.root).manifest == bank.manifest
    assert list(bank.manifest.geometry) == [frame.id for frame in given]


@pytest.mark.parametrize("what", DAMAGED_PICTURES)
def test_check_names_what_differs(bank: FrameBank, what: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Each kind of damage is found by check, and on the command line, with the name of what it befell."""
    damage, named = DAMAGED_PICTURES[what]
    damage(bank.root)
    problems = check(bank.root)
    assert any(named in problem for problem in problems), problems
    code, said = eyechart(capsys, "frames", "check", bank.root)
    assert code == 1
    assert named in said
    assert "Traceback" not in said


@pytest.mark.parametrize("what", NOT_A_BANK)
def test_a_folder_that_is_no_bank_is_refused_by_name(
    bank: FrameBank, what: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Opening, checking and the command line refuse it in one line that names the file and the line at fault."""
    damage, named = NOT_A_BANK[what]
    damage(bank.root)
    for read in (check, open_bank):
        with pytest.raises(BankError) as refused:
            read(bank.root)
        assert named in str(refused.value)
    code, said = eyechart(capsys, "frames", "check", bank.root)
    assert code == 2
    assert named in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("name", ["../x.png", "/etc/passwd", "images/../../x.png", "images/a\0.png"])
def test_a_path_outside_the_bank_is_never_opened(bank: FrameBank, name: str) -> None:
    """The path is refused before any file is touched, on opening and on reading."""
    change_row(bank.root, file_name=name)
    for read in (open_bank, lambda root: inside(root, name), lambda root: read_bounded(root, name)):
        with pytest.raises(BankError, match="bank"):
            read(bank.root)


@pytest.mark.parametrize("sides", [(0, 7), (7, 0), (50_000, 50_000), (2**31 - 1, 1)])
def test_a_header_that_declares_no_pixels_or_far_too_many_gives_no_size(sides: tuple[int, int]) -> None:
    """With its checksum, in the form of a picture that a run makes."""
    picture = bytearray(pictures.packed(np.zeros((4, 6, 3), dtype=np.uint8)))
    assert pictures.size_of(bytes(picture), "a.png") == (6, 4)
    picture[16:24] = struct.pack(">II", *sides)
    picture[29:33] = struct.pack(">I", zlib.crc32(picture[12:29]))
    with pytest.raises(BankError, match=r"'a\.png'"):
        pictures.size_of(bytes(picture), "a.png")


def test_a_file_is_read_to_its_end(bank: FrameBank, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also one that is longer than the system said."""
    whole = (bank.root / PICTURE).read_bytes()
    stat = Path.stat
    monkeypatch.setattr(Path, "stat", lambda path: os.stat_result((*stat(path)[:6], len(whole) // 2, 0, 0, 0)))
    assert read_bounded(bank.root, PICTURE) == whole


def test_a_link_inside_the_bank_is_a_file_of_the_bank(bank: FrameBank) -> None:
    """Banks on deduplicating stores hold links; only those that lead outside are refused."""
    (bank.root / PICTURE).rename(bank.root / "stored")
    (bank.root / PICTURE).symlink_to(bank.root / "stored")
    assert check(bank.root) == []


def test_a_missing_frame_or_counterfactual_is_named(bank: FrameBank) -> None:
    """What a bank does not hold is an error that says so."""
    with pytest.raises(BankError, match="no frame 'f9'"):
        bank.frame("f9")
    with pytest.raises(BankError, match=r"frame 'light-0-0' has no counterfactual picture 'snow'"):
        bank.image(bank.frame("light-0-0"), "snow")


@given(hnp.arrays(np.uint8, st.tuples(st.integers(1, 9), st.integers(1, 9), st.just(3))))
def test_encoding_loses_no_pixel(pixels: np.ndarray) -> None:
    """A PNG gives back the very pixels, also those of a flipped view."""
    assert np.array_equal(decode(encode(pixels), "drawn"), pixels)
    assert np.array_equal(decode(encode(pixels[::-1, ::-1]), "drawn"), pixels[::-1, ::-1])


@given(st.binary(max_size=60), st.integers(0, 200), st.sampled_from(["PNG", "JPEG", "WEBP", "BMP"]))
def test_a_damaged_picture_is_decoded_or_refused_by_name(noise: bytes, at: int, kind: str) -> None:
    """No bytes raise anything but a BankError that names the picture."""
    import io  # noqa: PLC0415 - nowhere else needed

    buffer = io.BytesIO()
    Image.fromarray(banks.draw(20.0, 5)).save(buffer, kind)
    picture = buffer.getvalue()
    try:
        shape = decode(picture[:at] + noise + picture[at + len(noise) :], "the picture").shape
    except BankError as error:
        assert "'the picture'" in str(error)  # noqa: PT017 - either outcome is right
    else:
        assert len(shape) == 3


def test_a_bank_that_was_checked_is_decoded_once_and_still_watched(
    bank: FrameBank, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is decoded again in a process is what changed since, even where the manifest was changed with it."""
    decoded = []
    opened = pictures.open_picture
    monkeypatch.setattr(pictures, "open_picture", lambda *words: decoded.append(words[1]) or opened(*words))
    assert check(bank.root) == []
    decoded.clear()
    assert check(bank.root) == []
    assert decoded == []
    cut = (bank.root / PICTURE).read_bytes()[:60]
    (bank.root / PICTURE).write_bytes(cut)
    raw = json.loads((bank.root / "manifest.json").read_text(encoding="utf-8"))
    raw["images"][PICTURE] = hashlib.sha256(cut).hexdigest()
    (bank.root / "manifest.json").write_text(json.dumps(raw), encoding="utf-8")
    for _ in range(2):
        (problem,) = check(bank.root)
        assert f"'{PICTURE}' is damaged or no picture" in problem
    assert decoded == [PICTURE, PICTURE]


def test_a_bank_that_this_process_drew_is_not_decoded_to_be_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its pictures are sound as they were encoded; one that changed on the disk since is found."""
    root = open_bank_simulator("highway").build(tmp_path / "bank", seeds=[0], steps=4).root
    monkeypatch.setattr(pictures, "open_picture", lambda *words: pytest.fail(f"{words[1]} was decoded"))
    assert check(root) == []
    monkeypatch.undo()
    file = next(iter(open_bank(root).frames[0].pictures.values()))
    (root / file).write_bytes((root / file).read_bytes()[:-30])
    (problem,) = check(root)
    assert file in problem


def plain_frame(**truth: object) -> Frame:
    """Return a frame with this ground truth."""
    return banks.one("f", ("s", "e", 0), "vertical", "f.png", truth=truth)


def test_minus_zero_is_zero() -> None:
    """The sign of a zero, and what rounding takes away, have no part in the fingerprint."""
    assert plain_frame(x=-0.0).geometry() == plain_frame(x=0.0).geometry() == plain_frame(x=-0.0004).geometry()
    assert str(rounded_truth({"x": -0.0001}, "f")["x"]) == "0.0"
    assert plain_frame(x=5).geometry() == plain_frame(x=5.0).geometry()


def test_different_truths_have_different_geometry() -> None:
    """None, flags, numbers and words that are written alike are kept apart; so are a name and its value."""
    truths = [{"x": one} for one in (None, "none", "null", True, "true", 1, "1.000", "1", 0, False, "", 0.001)]
    truths += [{}, {"y": None}, {"x": "1", "y": "2"}, {"x": '1","y":"2'}, {"x": "1\x1fy=2"}]
    assert len({plain_frame(**truth).geometry() for truth in truths}) == len(truths)


@given(st.dictionaries(st.text(), st.none() | st.booleans() | st.integers(-9, 9) | st.text()))
def test_the_order_of_columns_has_no_part_in_the_geometry(truth: dict[str, object]) -> None:
    """A dict's order is no fact about the world."""
    assert plain_frame(**truth).geometry() == plain_frame(**dict(reversed(truth.items()))).geometry()


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_numbers_share_a_geometry_exactly_where_they_round_alike(one: float, other: float) -> None:
    """The fingerprint sees 3 decimals."""
    same = round(one, 3) == round(other, 3)
    assert (plain_frame(x=one).geometry() == plain_frame(x=other).geometry()) is same


def test_the_fingerprint_is_of_the_geometry_and_not_of_the_pixels(tmp_path: Path) -> None:
    """Other pixels, the same fingerprint; another gap or another order, another one."""
    frames = banks.frames_of(["light"], 1, 3, "vertical", drawn=False)

    def fingerprint(name: str, given: list[Frame], code: int) -> str:
        with BankWriter(tmp_path / name, banks.manifest()) as writer:
            for frame in given:
                writer.add(frame, *banks.pictures_of(frame, code))
        assert check(tmp_path / name) == []
        return open_bank(tmp_path / name).manifest.fingerprint

    first = fingerprint("first", frames, 0)
    assert fingerprint("other pixels", frames, 99) == first
    assert fingerprint("other order", frames[::-1], 0) != first
    moved = [replace(frame, truth=frame.truth | {"lead_gap_m": 7.0}) for frame in frames[:1]]
    assert fingerprint("other gap", moved + frames[1:], 0) != first


def test_a_bank_has_the_same_fingerprint_in_every_process(bank: FrameBank, tmp_path: Path) -> None:
    """Neither the seed of the hash function nor the process has a say."""
    program = (
        "import banks, pathlib, sys; print(banks.build_bank(pathlib.Path(sys.argv[1])).manifest.fingerprint)",
        str(tmp_path / "again"),
    )
    env = os.environ | {"PYTHONHASHSEED": "123", "PYTHONPATH": str(Path(__file__).parent)}
    again = subprocess.run([sys.executable, "-c", *program], env=env, check=True, capture_output=True, text=True)
    assert again.stdout.strip() == bank.manifest.fingerprint
    assert check(tmp_path / "again") == []


def write(out: Path, *frames: Frame, then: Callable[[], None] = lambda: None) -> None:
    """Write a bank of these frames, without counterfactuals, and call ``then`` before it is finished."""
    with BankWriter(out, banks.manifest()) as writer:
        for frame in frames:
            writer.add(frame, {MAIN: encode(banks.draw(5.0, 0))}, {})
        then()


def test_a_bank_of_several_cameras_and_a_state_reads_back_as_it_was_given(tmp_path: Path) -> None:
    """Its pictures are columns of their own, its geometry tells cameras and state, and check finds nothing."""
    rig = banks.build_rig(tmp_path / "rig")
    assert rig.manifest.cameras == banks.WRISTS
    assert rig.frames[3].state == {"joints": (0.3, 0.25, -3 / 7)}
    assert check(rig.root) == []
    row = json.loads((rig.root / "metadata.jsonl").read_text().splitlines()[3])
    assert (row["file_name"], row["right_file_name"]) == ("images/left/3.png", "images/right/3.png")
    moved = {replace(rig.frames[3], state={"joints": (0.3, 0.25, angle)}).geometry() for angle in (0.0, 0.001, 0.0011)}
    assert len(moved) == 2
    assert replace(rig.frames[3], cameras=rig.frames[3].cameras[:1]).geometry() != rig.frames[3].geometry()


def test_where_controls_were_drawn_is_truth_of_the_pictures_and_not_of_the_moment(tmp_path: Path) -> None:
    """It is read back as ground truth, but stands in the manifest and has no part in fingerprint or table."""
    truth = {"lead_gap_m": 12.5, "lead_mid_near_m": 13.00049, "lead_mid_far_m": None}
    write(tmp_path / "bank", replace(plain_frame(), truth=truth))
    write(tmp_path / "plain", replace(plain_frame(), truth={"lead_gap_m": 12.5}))
    bank, plain = open_bank(tmp_path / "bank"), open_bank(tmp_path / "plain")
    assert bank.frames[0].truth == {"lead_gap_m": 12.5, "lead_mid_near_m": 13.0}
    assert bank.manifest.fingerprint == plain.manifest.fingerprint
    assert (bank.root / "metadata.jsonl").read_text() == (plain.root / "metadata.jsonl").read_text()
    assert "controls" not in json.loads((plain.root / "manifest.json").read_text())
    recorded = json.loads((bank.root / "manifest.json").read_text())
    for distances, named in (
        ({bank.frames[0].id: {"lead_gap_m": 3.0}}, "ground truth of frame"),
        ({bank.frames[0].id: {"lead_mid_near_m": math.inf}}, "is Infinity"),
        ({bank.frames[0].id: {"lead_mid_near_m": "near"}}, "no bank manifest"),
        ({"another": {"lead_mid_near_m": 3.0}}, "'another' of the manifest is missing"),
    ):
        changed = recorded | {"controls": {"seed": 0, "distances": distances}}
        (bank.root / "manifest.json").write_text(json.dumps(changed))
        with pytest.raises(BankError, match=named):
            open_bank(bank.root)


@pytest.mark.parametrize(
    ("cameras", "named"),
    [
        ((Camera("a"), Camera("a")), "two cameras have the same name"),
        ((Camera("a", mirrors="b"), Camera("b")), "camera 'a' mirrors 'b', which must exist and mirror it too"),
    ],
)
def test_cameras_that_cannot_be_are_refused(cameras: tuple[Camera, ...], named: str, tmp_path: Path) -> None:
    """Whoever declares them; a name is one that a column and a condition can have."""
    with pytest.raises(BankError, match=named):
        banks.build_rig(tmp_path / "rig", cameras=cameras)
    with pytest.raises(BankError, match="a camera's name has letters"):
        Camera("left@wrist")
    assert list(tmp_path.iterdir()) == []


def test_a_failed_writer_leaves_nothing(tmp_path: Path) -> None:
    """Whatever raises in its body, neither the bank nor its working folder stays."""

    def interrupted() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write(tmp_path / "bank", plain_frame(), then=interrupted)
    assert list(tmp_path.iterdir()) == []


REFUSED_BY_THE_WRITER: dict[str, tuple[dict[str, object], str]] = {
    "NaN": ({"truth": {"gap": math.nan}}, "truth 'gap' is nan"),
    "infinity": ({"truth": {"gap": np.float64("inf")}}, "truth 'gap' is inf"),
    "an array": ({"truth": {"gap": np.zeros(2)}}, "truth 'gap' is a ndarray"),
    "a reserved name": ({"truth": {"episode": 1}}, "reserved names"),
    "the name of a picture": ({"truth": {"lead_file_name": "x"}}, "reserved names"),
    "a file outside": ({"pictures": {MAIN: "../f.png"}}, "'../f.png' leads outside"),
    "an axis that cannot be read": ({"cameras": (Camera(MAIN, "diagonal"),)}, "diagonal"),  # type: ignore[arg-type]
    "a camera that the manifest lacks": ({"cameras": (Camera("wrist"),)}, "the manifest declares"),
    "a state that the manifest lacks": ({"state": {"joints": (1.0,)}}, "the manifest declares"),
    "a distance that is none": ({"truth": {"lead_mid_far_m": "far"}}, "'lead_mid_far_m' is 'far', not a distance"),
    "a surrogate": ({"scenario": "\udc80"}, "surrogate"),
    "a picture that was not given": ({"counterfactuals": {"lead_near": {MAIN: "n.png"}}}, "counterfactuals"),
}


@pytest.mark.parametrize("what", REFUSED_BY_THE_WRITER)
def test_the_writer_refuses_what_it_could_not_read_back(tmp_path: Path, what: str) -> None:
    """A frame that no reader would take is refused, and nothing stays."""
    values, named = REFUSED_BY_THE_WRITER[what]
    frame = replace(plain_frame(), **values)  # type: ignore[arg-type]
    with pytest.raises((BankError, UnicodeEncodeError), match=named):
        write(tmp_path / "bank", frame)
    assert list(tmp_path.iterdir()) == []


def test_the_writer_takes_a_frame_and_a_file_once(tmp_path: Path) -> None:
    """A second frame of one name, or a second picture for one file, would hide the first."""
    with pytest.raises(BankError, match="'f' was added twice"):
        write(tmp_path / "bank", plain_frame(), plain_frame())
    with pytest.raises(BankError, match=r"'f\.png' is already written"):
        write(tmp_path / "bank", plain_frame(), replace(plain_frame(), id="g"))
    assert list(tmp_path.iterdir()) == []


def test_a_bank_is_not_written_over_anything(bank: FrameBank, tmp_path: Path) -> None:
    """A folder with something in it, and one that fills while the bank is drawn, are left as they are."""
    before = sorted(bank.root.rglob("*"))
    with pytest.raises(BankError, match="exists already"):
        BankWriter(bank.root, banks.manifest())
    late = tmp_path / "late"

    def another_writes() -> None:
        late.mkdir()
        (late / "theirs").touch()

    with pytest.raises(BankError, match="exists already"):
        write(late, plain_frame(), then=another_writes)
    assert sorted(bank.root.rglob("*")) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bank", "late"]
    assert [path.name for path in late.iterdir()] == ["theirs"]


def test_an_empty_folder_may_become_a_bank(tmp_path: Path) -> None:
    """Mkdir before build is no mistake."""
    (tmp_path / "bank").mkdir()
    assert check(banks.build_bank(tmp_path / "bank").root) == []


def test_a_killed_writer_leaves_only_a_hidden_folder(tmp_path: Path) -> None:
    """A bank is there whole or not at all; what a kill leaves has a dot before its name and is cleared by the next."""
    program = f"""
import pathlib, time, banks
from eyechart.frames import BankWriter
with BankWriter(pathlib.Path({str(tmp_path / "bank")!r}), banks.manifest()) as writer:
    for code, frame in enumerate(banks.frames_of(["light"], 1, 9, "vertical", drawn=True)):
        writer.add(frame, *banks.pictures_of(frame, code))
        print(flush=True)
        time.sleep(code)
"""
    env = os.environ | {"PYTHONPATH": str(Path(__file__).parent)}
    with subprocess.Popen([sys.executable, "-c", program], env=env, stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None
        writer.stdout.readline()
        writer.stdout.readline()
        writer.send_signal(signal.SIGKILL)
    assert writer.returncode == -signal.SIGKILL
    left = [path.name for path in tmp_path.iterdir()]
    assert left == [".bank.part"]
    assert check(banks.build_bank(tmp_path / "bank").root) == []
    assert [path.name for path in tmp_path.iterdir()] == ["bank"], "the next writer clears it"


def test_checking_changes_nothing(bank: FrameBank) -> None:
    """A bank on a read-only medium can be checked: nothing in it is touched."""
    stamp = {path: path.stat().st_mtime_ns for path in bank.root.rglob("*")}
    time.sleep(0.01)
    check(bank.root)
    open_bank(bank.root)
    assert {path: path.stat().st_mtime_ns for path in bank.root.rglob("*")} == stamp


def test_a_copy_elsewhere_is_the_same_bank(bank: FrameBank, tmp_path: Path) -> None:
    """No path of this machine stands in a bank."""
    shutil.copytree(bank.root, tmp_path / "far" / "away")
    shutil.rmtree(bank.root)
    assert check(tmp_path / "far" / "away") == []
    assert open_bank(tmp_path / "far" / "away").name == f"boxes-tiny@{bank.manifest.fingerprint[:8]}"


def test_metadata_written_on_windows_are_read(bank: FrameBank) -> None:
    """Line ends do not matter."""
    text = (bank.root / "metadata.jsonl").read_bytes()
    (bank.root / "metadata.jsonl").write_bytes(text.replace(b"\n", b"\r\n"))
    assert read_metadata(bank.root / "metadata.jsonl", bank.manifest) == bank.frames


@pytest.mark.parametrize(
    ("words", "instead"),
    [('"threshold": 18.0', '"threshold": 40.0'), ("boxes on grey", "a photograph"), ('"SLOW"', '"SLOWER"')],
)
def test_what_a_bank_declares_cannot_be_edited(tmp_path: Path, words: str, instead: str) -> None:
    """A changed threshold, kind of picture or action name would change verdicts and their scope."""
    bank = banks.build_bank(tmp_path / "bank")
    file = bank.root / "manifest.json"
    text = file.read_text(encoding="utf-8")
    assert words in text
    file.write_text(text.replace(words, instead), encoding="utf-8")
    with pytest.raises(BankError, match=r"manifest\.json: the bank's declaration"):
        open_bank(bank.root)


def test_a_logged_motion_is_read_back_and_one_of_another_shape_is_refused(tmp_path: Path) -> None:
    """The geometry knows it: a changed number is found out; a bank that declares no motions has none."""
    made = open_bank_simulator("tabletop").build(tmp_path / "bank", seeds=(0,), steps=4)
    assert np.shape(open_bank(made.root).frames[0].motion) == (8, 3)
    text = (made.root / "metadata.jsonl").read_text(encoding="utf-8")
    rows = [json.loads(line) for line in text.splitlines()]
    for changed, words in (([[9.0, 9.0, 9.0]] * 8, "fingerprint"), ([[0.0] * 3] * 7, "shape"), (3.0, "not a list")):
        rows[0]["motion"] = changed
        (made.root / "metadata.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
        with pytest.raises(BankError, match=words):
            open_bank(made.root)
    with (
        pytest.raises(BankError, match=r"frame 'red-left-0-00': the logged motion has the shape"),
        BankWriter(tmp_path / "other", made.manifest) as writer,
    ):
        writer.add(replace(made.frames[0], motion=((0.0, 0.0, 0.0),)), {}, {})
