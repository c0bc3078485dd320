"""A film of one episode: the camera's pictures with the plan, and decision and gap below."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageColor, ImageDraw

from eyechart.destination import whole
from eyechart.episodes import Episode
from eyechart.errors import SpecError
from eyechart.frames import RGB
from eyechart.report.charts import font, plain
from eyechart.report.overlay import STROKES, over, pieces, plan_words
from eyechart.report.page import fill
from eyechart.simulators import Sketch
from eyechart.studies.battery.album import data_uri, webp
from eyechart.studies.closed_loop.drives import Drives
from eyechart.studies.closed_loop.replay import ReplayMoment, decided, episode_id, replay

WIDTH = 720
STRIP = 26
INK, PAPER, MUTED, RED, NOW = "#e9e7e2", "#14171b", "#a7aeba", "#f28d4f", "#6cbcf0"
TONES = {"brake": ("#e9e7e2", 12), "proceed": ("#6d7581", 6), "other": ("#a7aeba", 9)}
"""The colour and height (pixels) of an action in the strip, by role; red means a failure."""
LONGEST_REPLY = 4000
MOST_BYTES = 40_000_000
"""The most bytes of an HTML film's pictures; a longer drive needs an .mp4."""


@dataclass(frozen=True)
class Caption:
    """The words under a picture."""

    place: str
    decision: str
    executed: str
    state: str
    reply: str
    substituted: bool
    plan: str = ""


def lines(drives: Drives, episode: Episode) -> list[Caption]:
    """Return the words of every step; a model's reply is as in the ledger."""
    replies = drives.texts
    world, count = episode.key.world, len(episode.steps)
    tells = any(gap is not None for gap in drives.truth("lead_gap_m"))
    captions = [
        Caption(
            place=f"{world} · decision {number} of {count} · shown: {episode.key.condition}",
            decision=decided(step),
            executed=step.executed_action,
            state=_state(step.truth.get("lead_gap_m"), step.speed_mps, tells=tells, crashed=step.crashed),
            reply=replies.get(step.frame, "")[:LONGEST_REPLY],
            substituted=step.decision.action is None,
        )
        for number, step in enumerate(episode.steps, 1)
    ]
    ended = f"ended: {episode.ended} {episode.detail}".strip()
    return [*captions, Caption(f"{world} · end", "", "", ended, "", substituted=False)]


def _state(gap: object, speed_mps: float | None, *, tells: bool, crashed: bool) -> str:
    """Return a step's state in words; ``tells`` is whether the simulator gives gaps at all."""
    said = f"gap {gap:.1f} m" if isinstance(gap, int | float) else "nothing ahead" if tells else "gap —"
    parts = [said, f"then {'—' if speed_mps is None else f'{speed_mps:.1f}'} m/s", "CRASH" if crashed else ""]
    return " · ".join(part for part in parts if part)


def write_film(drives: Drives, episode: Episode, out: Path, *, fps: float = 2.0) -> int:
    """Write the film of an episode, as the suffix of ``out`` says; return its number of frames.

    Raises SpecError for another suffix, a useless rate, and for MP4 where PyAV is not installed
    (extra ``film``). Raises LedgerError where the episode cannot be replayed here, OutputError
    where ``out`` may not be written.
    """
    suffix = out.suffix.lower()
    if suffix not in WRITERS:
        raise SpecError(f"--out {out}: a film is written as {', '.join(WRITERS)}")
    if not 0.1 <= fps <= 60:
        raise SpecError(f"--fps {fps:g}: give 0.1 to 60 pictures per second")
    if suffix == ".mp4" and find_spec("av") is None:
        raise SpecError("MP4 needs PyAV: pip install 'eyechart[film]'; or write a .gif or .html")
    words = lines(drives, episode)
    with whole(out, "film") as partial:
        return WRITERS[suffix](partial, _Film(drives, episode, words, fps))


@dataclass(frozen=True)
class _Film:
    drives: Drives
    episode: Episode
    words: Sequence[Caption]
    fps: float

    def moments(self) -> Iterator[tuple[ReplayMoment, Caption]]:
        """Yield the steps of the replay with their words."""
        for shot, line in zip(replay(self.drives, self.episode), self.words, strict=True):
            yield shot, replace(line, plan=plan_words(shot.sketch, shot.step))

    def drawn(self) -> Iterator[Image.Image]:
        """Yield each step with its words under it."""
        roles = [self.drives.space.role(step.executed_action) for step in self.episode.steps]
        planning = False
        for number, (shot, line) in enumerate(self.moments()):
            planning = planning or shot.sketch is not None
            yield draw(shot, line, roles, number, planning=planning)


def draw(shot: ReplayMoment, line: Caption, roles: Sequence[str], now: int, *, planning: bool = False) -> Image.Image:
    """Return one picture of a film, of even size: the camera's, words, and a strip of all steps.

    A film of a drive with a controller is ``planning`` from its first picture on: it has a line for
    the plan.
    """
    picture = shot.picture
    scale = max(1, round(WIDTH / picture.shape[1])) if picture.shape[1] < WIDTH else 1
    shown = Image.fromarray(picture).resize(
        (picture.shape[1] * scale, picture.shape[0] * scale), Image.Resampling.NEAREST
    )
    if shot.sketch is not None:
        shown = over(shown, shot.sketch, scale)
    width = max(shown.width, WIDTH) // 2 * 2
    height = (shown.height + (6 if planning else 4) * STRIP + 18) // 2 * 2
    page = Image.new("RGB", (width, height), PAPER)
    page.paste(shown, ((width - shown.width) // 2, 0))
    pen, y = ImageDraw.Draw(page), shown.height + 6
    small, large = font(13), font(16)
    pen.text((10, y), plain(line.place, 100), fill=MUTED, font=small)
    if line.decision:
        tone = RED if line.substituted else INK
        pen.text((10, y + STRIP), plain(f"decides {line.decision}", 60), fill=tone, font=large)
        pen.text((width // 2, y + STRIP), plain(f"executed {line.executed}", 40), fill=INK, font=large)
    pen.text((10, y + 2 * STRIP), plain(line.state, 100), fill=RED if "CRASH" in line.state else INK, font=small)
    if planning:
        pen.text((10, y + 3 * STRIP), plain(line.plan, 100), fill=RED if "failed" in line.plan else INK, font=small)
        _key(pen, 10, y + 4 * STRIP)
        y += 2 * STRIP
    each = (width - 20) / max(1, len(roles))
    for place, role in enumerate(roles):
        (tone, tall), left = TONES[role or "other"], 10 + place * each
        top = y + 3 * STRIP + (12 - tall if place <= now else 5)
        box = (left, top, max(left + 1, left + each - 1), y + 3 * STRIP + 12)
        pen.rectangle(box, fill=tone if place <= now else "#343b45", outline=NOW if place == now else None)
    return page


def _key(pen: ImageDraw.ImageDraw, x: float, y: float) -> None:
    """Draw the legend of the lines over the picture."""
    words = font(12)
    for stroke in reversed(STROKES):
        middle = y + 8
        for part in ((0, 9), (17, 26)) if stroke.dashed else ((0, 26),):
            pen.line((x + part[0], middle, x + part[1], middle), fill=stroke.colour, width=round(stroke.width))
        if stroke.dots:
            pen.ellipse((x + 9, middle - 4, x + 17, middle + 4), fill=stroke.colour)
        pen.text((x + 34, y), stroke.says, fill=MUTED, font=words)
        x += 34 + pen.textlength(stroke.says, font=words) + 26


def _write_gif(out: Path, film: _Film) -> int:
    pictures = [_reduced(page) for page in film.drawn()]
    held = [round(1000 / film.fps)] * (len(pictures) - 1) + [round(2500 / film.fps)]
    pictures[0].save(out, "GIF", save_all=True, append_images=pictures[1:], duration=held, loop=0, optimize=True)
    return len(pictures)


def _reduced(page: Image.Image) -> Image.Image:
    """Return a picture in 128 colours plus those of the sketch's thin lines, to keep these."""
    found = page.quantize(128, dither=Image.Dither.NONE)
    levels = [level for stroke in STROKES for level in ImageColor.getrgb(stroke.colour)]
    palette = Image.new("P", (1, 1))
    palette.putpalette([*(found.getpalette() or [])[: 3 * 128], *levels])
    return page.quantize(palette=palette, dither=Image.Dither.NONE)


def _write_mp4(out: Path, film: _Film) -> int:
    import av  # noqa: PLC0415 - an extra

    count = 0
    with av.open(str(out), "w", format="mp4") as container:
        stream: Any = None
        for page in film.drawn():
            if stream is None:
                stream = container.add_stream(_codec(av), rate=Fraction(film.fps).limit_denominator(1000))
                stream.width, stream.height, stream.pix_fmt = page.width, page.height, "yuv420p"
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.asarray(page), format="rgb24")))
            count += 1
        if stream is not None:
            container.mux(stream.encode())
    return count


def _codec(av: object) -> str:
    """Return the most widely playable codec that this PyAV can write."""
    known: set[str] = getattr(av, "codecs_available", set())
    return next(name for name in ("libx264", "libopenh264", "h264", "mpeg4") if name in known)


def _write_html(out: Path, film: _Film) -> int:
    moments = list(film.moments())
    uris = list(_encoded(shot.picture for shot, _ in moments))
    steps = [
        {
            "plan": line.plan,
            "lines": None if shot.sketch is None else lines_of(shot.sketch),
            **asdict(line),
        }
        for shot, line in moments
    ]
    html = fill(
        "film.html",
        styles=("film.css",),
        scripts=("film.js",),
        data={"pictures": uris, "steps": steps, "fps": film.fps, "size": moments[0][0].picture.shape[1::-1]},
        strokes=STROKES,
        planning=any(shot.sketch is not None for shot, _ in moments),
        title=episode_id(film.episode),
        ended=film.episode.ended,
        detail=film.episode.detail,
        count=len(uris),
    )
    out.write_bytes(html)
    return len(uris)


def lines_of(sketch: Sketch) -> dict[str, list[list[tuple[float, float]]]]:
    """Return the lines of a sketch by name, each in pieces of pixel positions."""
    return {stroke.name: pieces(getattr(sketch, stroke.name)) for stroke in STROKES}


def _encoded(pictures: Iterable[RGB]) -> Iterator[str]:
    """Yield each picture as a WebP data URI, lossless until a quarter of the limit is used."""
    spent = 0
    for picture in pictures:
        small = webp(Image.fromarray(picture), lossless=spent < MOST_BYTES // 4, quality=70)
        spent += len(small)
        if spent > MOST_BYTES:
            raise SpecError(f"the pictures of this drive take more than {MOST_BYTES} bytes: write an .mp4 instead")
        yield data_uri(small)


WRITERS: dict[str, Callable[[Path, _Film], int]] = {".mp4": _write_mp4, ".gif": _write_gif, ".html": _write_html}
"""The writer of each suffix."""
