"""An album of every distinct picture of a report, small enough to send the page by mail."""

import base64
import hashlib
import io
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from PIL import Image

from eyechart.conditions import OVER, is_available, show
from eyechart.errors import BankError
from eyechart.frames import ENCODINGS, NEWEST, RGB, Frame, FrameBank, beside, decode
from eyechart.report.page import evenly
from eyechart.studies import Tell
from eyechart.studies.battery.subjects import Evidence

NO_PICTURE = -1
"""The condition shows no picture."""
LEFT_OUT = -2
"""The picture is not in the album."""

BUDGET_BYTES = 7_500_000
"""The encoded bytes of an album at most; base64 adds a third."""
LEAST_BYTES = 2_000_000
"""The same at least, where the replies take nearly all room of the page."""

RUNGS: tuple[tuple[int, int], ...] = ((600, 82), (480, 75), (360, 65), (240, 55), (160, 45))
"""Largest width in pixels, and WebP quality; the first rung that fits the budget is used."""

_PLAIN = 1 / 16
"""Bits per pixel: a lossless code below this is kept without trying a lossy one."""

_LOSSLESS, _PALETTE = {"quality": 20, "method": 1}, 256
"""How hard the lossless code of WebP tries, and the most colours that it keeps in a table. Harder (60, 4) makes drawn
pictures a sixth smaller. A picture of more colours is longer in it than in the lossy code, by 1.2 to 60 times."""

_LOSSY, _LOSSY_NOISE = 2, 1
"""How hard the lossy code tries: 4 makes a picture 3 to 9 % smaller, and takes more than twice as long. Noise is no
smaller by it."""

_WIDEST_VIEW = 640

_NOISE = (240, 5)
_SAMPLE = 12
_FILL = 0.92
"""The share of the budget to fill, because the sample gives only an estimate."""
_LENT = ("real_repeat", "shuffled", "cross_scenario", "text_swapped")
"""Conditions whose pictures belong to other frames, or are the frame's own again."""


@dataclass(frozen=True)
class Album:
    """Pictures as data URIs; ``places[run][condition]`` has each frame's picture number or code."""

    uris: tuple[str, ...]
    places: tuple[dict[str, tuple[int, ...]], ...]
    notes: tuple[str, ...]


def make_album(
    evidence: Sequence[Evidence],
    shown: Sequence[Sequence[int]],
    *,
    budget: int = BUDGET_BYTES,
    tell: Tell = lambda _: None,
) -> Album:
    """Return the pictures of the ``shown`` frames under every condition, as large as fits.

    A sample of the frames decides their size. Where not even the smallest fit, only some frames,
    evenly taken, have pictures.
    """
    codes: dict[tuple[str, int, int], bytes] = {}
    for rung in RUNGS:
        cost = _cost(evidence, shown, rung, codes)
        room = int(_FILL * budget / cost) if cost else sum(map(len, shown))
        if room >= sum(map(len, shown)):
            break
    part = min(1.0, room / max(1, sum(map(len, shown))))
    taken = [evenly(places, round(part * len(places))) for places in shown]
    binder = _Binder(*rung, budget, codes, tell=tell)
    bound = tuple(binder.places(run, places) for run, places in zip(evidence, taken, strict=True))
    pictured = [run.pictures is not None for run in evidence]
    left = sum(len(a) - len(b) for a, b, held in zip(shown, taken, pictured, strict=True) if held)
    return Album(tuple(binder.uris), bound, binder.notes(left) if any(pictured) else ())


def _cost(
    evidence: Sequence[Evidence],
    shown: Sequence[Sequence[int]],
    rung: tuple[int, int],
    codes: dict[tuple[str, int, int], bytes],
) -> float:
    """Return the mean bytes of a frame's own pictures on a rung, over a sample of frames."""
    binder, frames = _Binder(*rung, budget=1 << 62, codes=codes), 0
    for run, places in zip(evidence, shown, strict=True):
        if run.pictures is not None:
            sample = evenly(places, _SAMPLE)
            binder.places(run, sample, own=True)
            frames += len(sample)
    return binder.spent / frames if frames else 0.0


@dataclass
class _Binder:
    """Encodes each distinct picture once on a rung, up to the budget; ``codes`` are shared."""

    width: int
    quality: int
    budget: int
    codes: dict[tuple[str, int, int], bytes]
    uris: list[str] = field(default_factory=list)
    seen: dict[str, int] = field(default_factory=dict)
    spent: int = 0
    left_out: int = 0
    scaled: int = 0
    noises: int = 0
    tell: Tell = lambda _: None

    def places(self, run: Evidence, taken: Sequence[int], *, own: bool = False) -> dict[str, tuple[int, ...]]:
        """Return each picture's place in the album; ``own`` leaves out pictures of other frames."""
        nothing = {name: [NO_PICTURE if name == "text_only" else LEFT_OUT] * len(run.frames) for name in run.conditions}
        # The album has their pixels in a code of its own; the fastest of the lossless codes brings them there.
        bank = run.pictures and replace(run.pictures, encoding=ENCODINGS[NEWEST])
        for name, column in nothing.items():
            if bank is None or (own and name in _LENT):
                continue
            self.tell(f"pictures of {run.name} under {name}")
            for place in taken:
                column[place] = self._one(name, run.frames[place], bank, run.score.manifest.seed)
        return {name: tuple(column) for name, column in nothing.items()}

    def _one(self, condition: str, frame: Frame, bank: FrameBank, seed: int) -> int:
        if not is_available(condition, frame):
            return LEFT_OUT
        try:
            seen = beside(show(condition, frame, bank, seed).images, frame.id)
            return NO_PICTURE if seen is None else self._keep(seen, noise=condition.partition(OVER)[0] == "noise")
        except BankError:
            return LEFT_OUT

    def _keep(self, picture: bytes, *, noise: bool) -> int:
        digest = hashlib.sha256(picture).hexdigest()
        if digest not in self.seen:
            rgb = decode(picture, "a picture of the report")
            wide, quality = _NOISE if noise else (self.width, self.quality)
            made = (digest, wide, quality)
            if made not in self.codes:
                self.codes[made] = encode_small(
                    rgb, wide, quality, lossless=not noise, effort=_LOSSY_NOISE if noise else _LOSSY
                )
            small = self.codes[made]
            if self.spent + len(small) > self.budget:
                self.left_out += 1
                return LEFT_OUT
            self.spent += len(small)
            self.noises += noise
            self.scaled += not noise and rgb.shape[1] > wide
            self.seen[digest] = len(self.uris)
            self.uris.append(data_uri(small))
        return self.seen[digest]

    def notes(self, frames_left: int) -> tuple[str, ...]:
        """Return in words what was changed or left out; ``frames_left`` frames have no picture."""
        found = {
            f"{len(self.uris)} distinct pictures, {self.spent / 1e6:.2f} MB before base64, as WebP.": 1,
            f"{self.scaled} pictures were scaled to at most {self.width} pixels wide; the models saw the originals.": (
                self.scaled
            ),
            f"{self.noises} noise pictures are shown at {_NOISE[0]} pixels and strongly compressed; the models saw "
            "every pixel.": self.noises,
            f"The pictures of {frames_left} frames do not fit into the page and were left out, evenly over the "
            "frames.": frames_left,
            f"{self.left_out} pictures do not fit into the page and were left out.": self.left_out,
        }
        return tuple(words for words, count in found.items() if count)


def encode_small(rgb: RGB, width: int, quality: int, *, lossless: bool, effort: int = _LOSSY) -> bytes:
    """Return a picture (h, w, 3) as WebP of at most ``width`` pixels.

    It is lossless if that is asked for, its colours are few, and it is smaller so. ``effort`` is the
    lossy code's, from 0 to 6.
    """
    image = Image.fromarray(rgb)
    if image.width > width:
        image = image.resize((width, max(1, round(image.height * width / image.width))), Image.Resampling.LANCZOS)
    exact = webp(image, lossless=True, **_LOSSLESS) if lossless and image.getcolors(_PALETTE) else None
    if exact is not None and 8 * len(exact) < _PLAIN * image.width * image.height:
        return exact
    lossy = webp(image, quality=quality, method=effort)
    return lossy if exact is None else min(exact, lossy, key=len)


def webp(image: Image.Image, **how: int) -> bytes:
    """Return a picture as WebP."""
    buffer = io.BytesIO()
    image.save(buffer, "WEBP", **how)
    return buffer.getvalue()


def data_uri(webp: bytes) -> str:
    """Return a WebP picture as a data URI."""
    return f"data:image/webp;base64,{base64.b64encode(webp).decode()}"


def view_uri(picture: bytes) -> str:
    """Return a picture as a data URI, at most 640 pixels wide; raises BankError for no picture."""
    image = Image.fromarray(decode(picture, "a view"))
    if image.width > _WIDEST_VIEW:
        image = image.resize((_WIDEST_VIEW, round(image.height * _WIDEST_VIEW / image.width)))
    return data_uri(webp(image, quality=80, method=_LOSSY))
