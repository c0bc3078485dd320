"""All conditions of a run leave in one encoding, so that no kind of file tells a condition."""

import io
import json
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, PngImagePlugin

import photographs
from eyechart import bundle, models
from eyechart.bundle import write_bundle
from eyechart.calls import Query, Reply
from eyechart.errors import LedgerError
from eyechart.frames import ENCODINGS, FrameBank, as_png, decode, encode, noises, open_bank
from eyechart.frames.plain_pictures import damages
from eyechart.importing import Choices, import_table
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, RUN
from eyechart.modes import RequestMode
from eyechart.simulators.rover import Rover
from eyechart.stimuli import Stimuli
from eyechart.studies import battery
from stand_ins import Held

KINDS = ("JPEG", "WEBP", "PNG")
ASKED = ("real", "real_repeat", "blank", "noise", "shuffled", "cross_scenario", "mirrored", "nudged")


class Kind(Held):
    """A model that tells which kind of file it was given, and nothing of what it shows."""

    async def answer(self, query: Query) -> Reply:
        """Brake for a JPEG, go for a PNG."""
        return Reply("STOP" if query.image is not None and query.image[:2] == b"\xff\xd8" else "STRAIGHT", "stop")


def open_model(name: str, mode: RequestMode) -> Kind:
    """Open the only one."""
    del name, mode
    return Kind()


@pytest.fixture(autouse=True)
def _kind(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make ``kind:of`` a SPEC."""
    monkeypatch.setitem(models.ADAPTERS, "kind", "test_encoding")


@pytest.fixture
def mixed(tmp_path: Path) -> FrameBank:
    """Return a bank of photographs, a third of them JPEGs, a third WebPs, a third PNGs of another program."""
    rows = photographs.rows(drives=4, ticks=6)
    photographs.take(tmp_path / "photos", rows)
    named = []
    for number, row in enumerate(rows):
        kind, path = KINDS[number % 3], tmp_path / "photos" / str(row["photo"])
        note = PngImagePlugin.PngInfo()
        note.add_text("condition", "real")
        Image.open(path).save(
            path.with_suffix(f".{kind.lower()}"), kind, **({"pnginfo": note} if kind == "PNG" else {})
        )
        named.append({**row, "photo": str(row["photo"]).replace(".jpg", f".{kind.lower()}")})
    (tmp_path / "t.csv").write_text(photographs.as_csv(named))
    choices = Choices(mirror="horizontal", columns={"gap": "lidar_m"}, threshold=18.0)
    return import_table(tmp_path / "photos", tmp_path / "t.csv", tmp_path / "bank", choices)


def chunks(picture: bytes) -> list[bytes]:
    """Return the kinds of a PNG's chunks."""
    result, at = [], 8
    while at < len(picture):
        result.append(picture[at + 4 : at + 8])
        at += 12 + int.from_bytes(picture[at : at + 4], "big")
    return result


def test_every_condition_leaves_as_a_png_of_pixels_alone(mixed: FrameBank, tmp_path: Path) -> None:
    """Whatever the files of the bank are; the true picture keeps its pixels, and a bank's own reading stays."""
    plan = battery.plan(mixed.root, ["kind:of"], tmp_path / "run", conditions=ASKED).plan
    stimuli = Stimuli(plan.bank, plan.seed, plan.view)
    for frame in mixed:
        for condition in ASKED:
            picture = stimuli.show(condition, frame.id).images["main"]
            assert {*chunks(picture)} == {b"IHDR", b"IDAT", b"IEND"}
            assert picture[24:29] == bytes([8, 2, 0, 0, 0])
        stored = mixed.image(frame)
        shown = stimuli.show("real", frame.id).images["main"]
        assert np.array_equal(decode(shown, "shown"), decode(stored, "stored"))
        assert mixed.recorded(frame) == plan.bank.recorded(plan.bank.frame(frame.id)) == stored


def test_a_model_that_looks_at_the_kind_of_file_alone_is_found_blind(mixed: FrameBank, tmp_path: Path) -> None:
    """It told blank from real; now it answers all alike."""
    battery.run(battery.plan(mixed.root, ["kind:of"], tmp_path / "run", conditions=ASKED))
    statistics = battery.score(tmp_path / "run", resamples=100).models["kind:of"].statistics
    assert (statistics["agree.blank"].value, statistics["agree.mirrored"].value) == (1.0, 1.0)


def test_a_run_of_an_older_eyechart_goes_on_as_it_began(mixed: FrameBank, tmp_path: Path) -> None:
    """Its manifest names no encoding: its pictures leave as the bank holds them, in all its calls."""
    planned = battery.plan(mixed.root, ["kind:of"], tmp_path / "run", conditions=("real", "blank"))
    battery.run(
        replace(planned, plan=replace(planned.plan, bank=mixed), manifest=replace(planned.manifest, encoding="stored"))
    )
    raw = json.loads((tmp_path / "run" / RUN).read_text())
    del raw["encoding"]
    (tmp_path / "run" / RUN).write_text(json.dumps(raw))
    more = battery.plan(mixed.root, ["kind:of"], tmp_path / "run", conditions=("real", "blank", "mirrored"))
    assert (more.manifest.encoding, more.plan.bank.plain) == ("stored", False)
    battery.run(more)
    answers = battery.score(tmp_path / "run", resamples=100).models["kind:of"].answers
    kinds = [one is not None and one.action for one in answers.decisions["real"]]
    assert kinds[:3] == ["STOP", "STRAIGHT", "STRAIGHT"]


def test_shards_that_left_in_two_ways_are_no_one_run(mixed: FrameBank, tmp_path: Path) -> None:
    """The sentence names both."""
    for shard, encoding in ((1, "png"), (2, "stored")):
        extent = battery.BatterySelection(shard=(shard, 2))
        planned = battery.plan(
            mixed.root, ["kind:of"], tmp_path / str(shard), conditions=("real", "blank"), extent=extent
        )
        battery.run(replace(planned, manifest=replace(planned.manifest, encoding=encoding)))
    with pytest.raises(LedgerError, match="this run has encoding png, now encoding stored"):
        battery.merge([tmp_path / "1", tmp_path / "2"], tmp_path / "whole")


def test_a_bundle_of_photographs_gives_the_requests_that_were_sent(mixed: FrameBank, tmp_path: Path) -> None:
    """Every digest of the ledger is computed again from the bundle's own pictures."""
    battery.run(battery.plan(mixed.root, ["kind:of"], tmp_path / "run", conditions=ASKED))
    write_bundle(tmp_path / "run", tmp_path / "run.zip", resamples=100)
    found = bundle.validate(tmp_path / "run.zip")
    assert (found.holds, list(found.differences)) == (True, [])


def test_the_pictures_of_simulators_stay_byte_for_byte(tmp_path: Path) -> None:
    """They are such PNGs already, so that runs on them send what they always did."""
    bank = Rover().build(tmp_path / "bank", seeds=(0,), steps=4)
    for frame in open_bank(bank.root):
        for picture in (bank.image(frame), *(bank.image(frame, name) for name in frame.counterfactuals)):
            assert as_png(picture, frame.id, encode) == picture


@pytest.mark.parametrize("change", ["interlaced", "palette", "cut", "more"])
def test_any_other_png_is_written_anew(change: str) -> None:
    """Interlaced, of another kind of colour, with something behind its end; a torn one is refused as ever."""
    picture, file = Image.fromarray(photographs.draw(9.0)), io.BytesIO()
    if change == "palette":
        picture = picture.convert("P")
    picture.save(file, "PNG")
    made = file.getvalue()
    if change == "interlaced":  # of one pixel there is one pass, whose bytes are the same
        made = encode(photographs.draw(9.0)[:1, :1])
        head = made[12:28] + b"\1"
        made = made[:12] + head + zlib.crc32(head).to_bytes(4, "big") + made[33:]
    made = {"cut": made[:-12], "more": made + b"condition: real"}.get(change, made)
    found = as_png(made, "a picture", encode)
    assert found == encode(decode(made, "a picture"))
    assert {*chunks(found)} == {b"IHDR", b"IDAT", b"IEND"}


def test_a_digest_is_that_of_what_left(mixed: FrameBank, tmp_path: Path) -> None:
    """The ledger's column is of the query with the PNG."""
    planned = battery.plan(mixed.root, ["kind:of"], tmp_path / "run", conditions=("real", "blank"))
    battery.run(planned)
    stimuli = Stimuli(planned.plan.bank, planned.plan.seed)
    with Ledger(tmp_path / "run" / LEDGER) as ledger:
        for sent in ledger.attempts("kind:of"):
            seen = stimuli.show(sent.key.condition, sent.key.frame)
            assert sent.request_sha256 == planned.plan.query(sent.key, seen).sha256()


def test_a_run_that_was_begun_with_another_encoding_goes_on_in_its_own_way(tmp_path: Path) -> None:
    """The same pixels in all; which encoding a run sends stands in its manifest."""
    bank = Rover().build(tmp_path / "bank", seeds=(0,), steps=4)
    asked, made = ("real", "noise", "mirrored"), dict[str, dict[str, bytes]]()
    for encoding in ("png", "png-2", "png-3", "png-4"):
        out = tmp_path / encoding
        planned = battery.plan(bank.root, ["scripted:constant"], out, conditions=asked)
        assert planned.manifest.encoding == "png-4"
        plan = replace(planned.plan, bank=replace(planned.plan.bank, encoding=ENCODINGS[encoding]))
        battery.run(replace(planned, plan=plan, manifest=replace(planned.manifest, encoding=encoding)))
        more = battery.plan(bank.root, ["scripted:constant"], out, conditions=(*asked, "blank"))
        assert more.manifest.encoding == encoding
        stimuli = Stimuli(more.plan.bank, more.plan.seed)
        made[encoding] = {name: stimuli.show(name, bank.frames[0].id).images["main"] for name in asked}
        battery.run(more)
        write_bundle(out, tmp_path / f"{encoding}.zip", resamples=100)
        assert bundle.validate(tmp_path / f"{encoding}.zip").holds
    first, second, third, fourth = made.values()
    for name in asked:
        pixels = [decode(one[name], name) for one in made.values()]
        assert all(np.array_equal(pixels[0], one) for one in pixels[1:])
    assert first["mirrored"] == second["mirrored"]
    assert len({one["mirrored"] for one in made.values()}) == 3
    assert third["noise"] == fourth["noise"]
    assert len({one["noise"] for one in made.values()}) == 3
    for name, picture in [*third.items(), *fourth.items()]:
        assert {*chunks(picture)} == {b"IHDR", b"IDAT", b"IEND"}
        assert as_png(picture, name, encode) == picture


@pytest.mark.parametrize("seed", range(20))
def test_rows_that_equal_those_above_are_written_from_a_stock_and_the_picture_is_whole(seed: int) -> None:
    """Bands of every height, at the top, within and at the end, and checksums that hold."""
    rng = np.random.default_rng(seed)
    high, wide = (int(side) for side in rng.integers(1, 40, 2))
    rows = np.sort(rng.integers(0, max(1, high // 5), high))
    pixels = rng.integers(0, 3, (high, wide, 3), dtype=np.uint8)[rows]
    picture = ENCODINGS["png-4"].picture(pixels)
    assert np.array_equal(decode(picture, "banded"), pixels)
    assert list(damages(picture, "PNG", pixels)) == []
    assert as_png(picture, "banded", encode) == picture


@pytest.mark.parametrize("shapes", [[(150, 600, 3)], [(7, 5, 3), (3, 3, 3), (1, 1, 3)], [(2, 2, 3), (5, 5, 3)]])
def test_noise_is_that_of_the_generator_s_whole_numbers(shapes: list[tuple[int, int, int]]) -> None:
    """As older runs drew it, one picture after another from one seed."""
    for seed in range(9):
        rng = np.random.default_rng(seed)
        for shape, drawn in zip(shapes, noises(seed, shapes), strict=True):
            assert np.array_equal(drawn, rng.integers(0, 256, shape, dtype=np.uint8))


@pytest.mark.parametrize("shape", [(1, 1, 3), (1, 7, 3), (9, 1, 3), (33, 41, 3), (1, 21845, 3), (3, 7281, 3)])
def test_every_encoding_keeps_every_pixel(shape: tuple[int, int, int]) -> None:
    """Of pictures of any size, also of views that are not contiguous."""
    pixels = np.random.default_rng(3).integers(0, 256, shape, dtype=np.uint8)
    for one in (pixels, pixels[::-1], pixels[:, ::-1]):
        for write in {write for encoding in ENCODINGS.values() for write in encoding}:
            assert np.array_equal(decode(write(one), "written"), one)
