"""An album holds every distinct picture of a report once, small enough that the page can be sent by mail."""

import base64
import hashlib
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from PIL import Image

from eyechart.conditions import available, show
from eyechart.errors import BankError
from eyechart.frames import RGB, Frame, FrameBank, decode
from eyechart.report.evidence import Evidence

NO_PICTURE = -1
"""The condition shows none."""
LEFT_OUT = -2
"""The picture is not in the album."""

BUDGET_BYTES = 9_000_000
"""Of so many encoded bytes an album is made; base64 makes a third more of them."""

RUNGS: tuple[tuple[int, int], ...] = ((600, 82), (480, 75), (360, 65), (240, 55), (160, 45))
"""Largest width in pixels, and WebP quality: the first rung on which the album fits its budget is taken."""

_NOISE = (240, 5)


@dataclass(frozen=True)
class Album:
    """Pictures as data URIs; ``places[run][condition]`` holds, per frame, the picture's number or why there is none."""

    uris: tuple[str, ...]
    places: tuple[dict[str, tuple[int, ...]], ...]
    notes: tuple[str, ...]


def make_album(evidence: Sequence[Evidence], *, budget: int = BUDGET_BYTES) -> Album:
    """Return the pictures of every frame under every condition, as large as the budget (in bytes) allows."""
    if all(run.pictures is None for run in evidence):
        return Album((), tuple(_nothing(run) for run in evidence), ())
    for width, quality in RUNGS[:-1]:
        binder = _Binder(width, quality, budget)
        places = tuple(binder.places(run) for run in evidence)
        if not binder.left_out:
            return Album(tuple(binder.uris), places, binder.notes())
    binder = _Binder(*RUNGS[-1], budget)
    places = tuple(binder.places(run) for run in evidence)
    return Album(tuple(binder.uris), places, binder.notes())


def _nothing(run: Evidence) -> dict[str, tuple[int, ...]]:
    frames = next(iter(run.score.models.values())).answers.frames if run.score.models else ()
    return {name: (NO_PICTURE if name == "text_only" else LEFT_OUT,) * len(frames) for name in run.conditions}


@dataclass
class _Binder:
    """Encodes pictures on one rung, each distinct one once, until the budget is spent."""

    width: int
    quality: int
    budget: int
    uris: list[str] = field(default_factory=list)
    seen: dict[str, int] = field(default_factory=dict)
    spent: int = 0
    left_out: int = 0
    scaled: int = 0
    noises: int = 0

    def places(self, run: Evidence) -> dict[str, tuple[int, ...]]:
        """Return where each picture of a run stands in the album."""
        if run.pictures is None:
            return _nothing(run)
        frames = next(iter(run.score.models.values())).answers.frames
        return {name: tuple(self._along(name, frames, run.pictures, run)) for name in run.conditions}

    def _along(self, condition: str, frames: Sequence[Frame], bank: FrameBank, run: Evidence) -> Iterator[int]:
        for frame in frames:
            if not available(condition, frame) or self.left_out:
                self.left_out += bool(self.left_out)
                yield LEFT_OUT
                continue
            try:
                picture = show(condition, frame, bank, run.score.manifest.seed)
            except BankError:
                yield LEFT_OUT
                continue
            yield NO_PICTURE if picture is None else self._keep(picture, noise=condition == "noise")

    def _keep(self, picture: bytes, *, noise: bool) -> int:
        digest = hashlib.sha256(picture).hexdigest()
        if digest not in self.seen:
            rgb = decode(picture, "a picture of the report")
            wide, quality = _NOISE if noise else (self.width, self.quality)
            small = encode_small(rgb, wide, quality, lossless=not noise)
            if self.spent + len(small) > self.budget:
                self.left_out += 1
                return LEFT_OUT
            self.spent += len(small)
            self.noises += noise
            self.scaled += not noise and rgb.shape[1] > wide
            self.seen[digest] = len(self.uris)
            self.uris.append("data:image/webp;base64," + base64.b64encode(small).decode())
        return self.seen[digest]

    def notes(self) -> tuple[str, ...]:
        """Return in words what was changed or left out."""
        words = [f"{len(self.uris)} distinct pictures, {self.spent / 1e6:.2f} MB before base64, as WebP."]
        if self.scaled:
            words.append(
                f"{self.scaled} pictures were scaled to at most {self.width} pixels wide; the models saw the originals."
            )
        if self.noises:
            words.append(
                f"{self.noises} noise pictures are shown at {_NOISE[0]} pixels and strongly compressed; the models saw "
                "every pixel."
            )
        if self.left_out:
            words.append(f"{self.left_out} pictures do not fit into the page and were left out.")
        return tuple(words)


def encode_small(rgb: RGB, width: int, quality: int, *, lossless: bool) -> bytes:
    """Return a picture, shape (h, w, 3), as WebP of at most ``width`` pixels: the smaller of lossless and lossy."""
    image = Image.fromarray(rgb)
    if image.width > width:
        image = image.resize((width, max(1, round(image.height * width / image.width))), Image.Resampling.LANCZOS)
    made = [_webp(image, quality=quality, method=4)]
    if lossless:
        made.append(_webp(image, lossless=True, quality=60, method=4))
    return min(made, key=len)


def _webp(image: Image.Image, **how: int) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, "WEBP", **how)
    return buffer.getvalue()
