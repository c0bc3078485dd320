"""Pictures are checked before they are shown: by a bank's import and by a guardian, in the same words."""

import asyncio
import base64
import random
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from aiohttp import web

import odd_pictures
import voters
from banks import build_bank
from eyechart.errors import BankError, SourceError
from eyechart.frames import decode, made_plain, media_type, require_plain
from eyechart.guardian import Guardian
from eyechart.importing import Choices, import_table
from eyechart.models import ADAPTERS
from eyechart.modes import RequestMode
from eyechart.studies import guardian as study


@pytest.mark.parametrize("name", odd_pictures.WHOLE)
def test_a_whole_picture_is_plain(name: str) -> None:
    """Whatever its format, its quality, and how its data are ordered; its media type is told."""
    picture = odd_pictures.WHOLE[name]()
    assert require_plain(picture, "a") == media_type(picture)


@pytest.mark.parametrize("name", odd_pictures.ODD)
def test_a_picture_that_programs_see_otherwise_is_told_by_its_fault(name: str) -> None:
    """By what its header says, and by what it holds where a decoder would fill up in silence."""
    make, said = odd_pictures.ODD[name]
    with pytest.raises(BankError, match=re.escape(said)):
        require_plain(make(), "a")


def test_a_picture_of_which_pixels_are_lost_is_made_plain_no_more() -> None:
    """What only stands behind its end can be left out."""
    for name in ("JPEG, cut and closed", "PNG of half its rows", "PNG with a wrong checksum"):
        with pytest.raises(BankError, match="is damaged"):
            made_plain(odd_pictures.ODD[name][0](), "a")
    pixels, done = made_plain(odd_pictures.ODD["PNG with something behind"][0](), "a")
    assert done == ["bytes behind it"]
    assert np.array_equal(pixels, np.asarray(odd_pictures.PIXELS))


def test_whatever_comes_is_plain_or_refused() -> None:
    """Changed, cut and lengthened at random: never another exception."""
    dice = random.Random(7)  # noqa: S311 - no secret
    seeds = [make() for make in (*odd_pictures.WHOLE.values(), *(make for make, _ in odd_pictures.ODD.values()))]
    refused = 0
    for _ in range(600):
        one = bytearray(dice.choice(seeds))
        for _ in range(dice.randint(1, 5)):
            place = dice.randrange(min(len(one), 300) + 1)
            one[place : place + dice.choice((0, 1, 1, 9))] = dice.randbytes(dice.choice((0, 1, 1, 9)))
        try:
            require_plain(bytes(one), "changed")
        except BankError:
            refused += 1
        else:
            assert decode(bytes(one), "changed").ndim == 3
    assert refused > 300


@pytest.mark.parametrize("name", [*odd_pictures.WHOLE, *odd_pictures.ODD])
def test_what_an_import_refuses_a_guardian_refuses_and_no_more(name: str, tmp_path: Path, guardian: Guardian) -> None:
    """In the same words; and what it takes, it takes."""
    picture, said = odd_pictures.ODD[name] if name in odd_pictures.ODD else (odd_pictures.WHOLE[name], "")
    (tmp_path / "p.png").write_bytes(picture())
    table = tmp_path / "table.csv"
    table.write_text("file\np.png\n")
    choices, out = Choices(columns={}), tmp_path / "bank"
    if not said:
        assert len(import_table(tmp_path, table, out, choices)) == 1
        assert not guardian.assess(picture()).why.startswith("no picture that can be shown")
        return
    with pytest.raises(SourceError) as refused:
        import_table(tmp_path, table, out, choices)
    found = guardian.assess(picture())
    assert said in str(refused.value)
    assert found.answer == "abstain"
    assert said in found.why
    assert found.why.startswith("no picture that can be shown: ")
    assert not out.exists()


@pytest.fixture(scope="module")
def guardian(tmp_path_factory: pytest.TempPathFactory) -> Guardian:
    """Return a guardian that is shown pictures as they are."""
    folder = tmp_path_factory.mktemp("guardian")
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(ADAPTERS, "voter", "voters")
        bank = build_bank(folder / "bank", scenarios=("merge",), episodes=3, steps=4, drawn=False)
        study.write_frozen(
            folder / "guardian.json", study.fit(voters.ask_all(bank.root, ("never", "sees"), folder / "run"))
        )
        return Guardian.load(folder / "guardian.json", deadline_s=20.0)


def test_the_picture_that_reaches_a_model_is_the_one_that_was_checked_under_its_own_media_type(
    tmp_path: Path, guardian: Guardian
) -> None:
    """Byte by byte where it is shown as it is; its reflection is drawn anew, as PNG."""
    urls: list[str] = []

    async def answer(request: web.Request) -> web.Response:
        asked = await request.json()
        urls.append(asked["messages"][-1]["content"][0]["image_url"]["url"])
        message = {"role": "assistant", "content": "no"}
        return web.json_response({"model": "m", "choices": [{"message": message, "finish_reason": "stop"}]})

    async def ask() -> None:
        app = web.Application(client_max_size=10_000_000)
        app.router.add_post("/v1/chat/completions", answer)
        runner = web.AppRunner(app, access_log=None)
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        url, spec = f"http://127.0.0.1:{runner.addresses[0][1]}/v1", "openai:m"
        about = replace(
            guardian.frozen.about,
            versions={spec: "as served"},
            served={},
            modes={spec: RequestMode(spec, base_url=url, timeout_s=20.0)},
        )
        frozen = replace(guardian.frozen, committee=(spec,), about=about, selection=None, chosen_as="x")
        study.write_frozen(tmp_path / "guardian.json", frozen)
        with Guardian.load(tmp_path / "guardian.json", deadline_s=20.0) as asked:
            for kind in ("PNG", "JPEG", "WEBP"):
                await asked.assess_async(odd_pictures.encoded(kind))
        await runner.cleanup()

    asyncio.run(ask())
    for number, kind in enumerate(("PNG", "JPEG", "WEBP")):
        picture = odd_pictures.encoded(kind)
        sent = {url.partition(",")[0]: base64.b64decode(url.partition(",")[2]) for url in urls[2 * number :][:2]}
        assert media_type(picture) == f"image/{kind.lower()}"
        assert picture in sent.values() or kind == "PNG"
        assert sent.get(f"data:image/{kind.lower()};base64") is not None
        assert all(require_plain(one, head) == head[5:-7] for head, one in sent.items())


def test_a_media_type_is_what_the_bytes_are() -> None:
    """And PNG's of what nobody knows, as it always was."""
    kinds = {"PNG": "image/png", "JPEG": "image/jpeg", "WEBP": "image/webp", "BMP": "image/bmp"}
    assert {kind: media_type(odd_pictures.encoded(kind)) for kind in kinds} == kinds
    assert media_type(b"") == "image/png"
