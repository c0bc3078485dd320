"""A film of one frame through its conditions, with each model's answers, as a GIF."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image, ImageDraw

from eyechart.conditions import CONDITIONS
from eyechart.destination import whole
from eyechart.errors import BankError, SpecError
from eyechart.frames import RGB, Frame, FrameBank, decode
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, read_run
from eyechart.perception.view import find_view
from eyechart.report.charts import font, plain
from eyechart.report.short_names import shortener
from eyechart.studies.battery.plans import plan_of
from eyechart.studies.battery.subjects import find_pictures

WIDTH = 720
MOST_MODELS = 8
INK, PAPER, MUTED = "#e9e7e2", "#14171b", "#a7aeba"
_LINE = 24
_BARE = 240
"""The height of the card where a condition shows no picture."""


@dataclass(frozen=True)
class Card:
    """One condition of the film: its question, its pictures, and each model's answer."""

    condition: str
    asks: str
    pictures: tuple[RGB, ...]
    answers: Mapping[str, str]


def cards(run: Path, frame: str | None = None, banks: Sequence[Path] = ()) -> tuple[str, list[Card]]:
    """Return a frame's id, and a card for each condition with an answer, in the run's order.

    Without ``frame`` it is the one whose answers vary the most. Raises SpecError for an unknown
    frame and for a run without answers, BankError where its pictures cannot be found.
    """
    manifest, bank = read_run(run)
    space = manifest.prompt.asks(bank.manifest.action_space)
    if space.who == "policy":
        raise SpecError(f"{run} is a run of policies, whose answers are no words: a film needs a battery or a drive")
    pictures, why = find_pictures(manifest, bank, run, banks)
    if pictures is None:
        raise BankError(f"the pictures of {run} were not found: {why}; give the bank with --frames")
    plan = plan_of(manifest, pictures, view=find_view(manifest.view))
    said: dict[str, dict[tuple[str, str], str]] = {}
    with Ledger(run / LEDGER) as ledger:
        for spec in manifest.models:
            for key, reply in ledger.replies(spec):
                found = plan.read(key, reply)
                words = f"no decision ({found.why or found.missing})"
                said.setdefault(key.frame, {})[spec, key.condition] = (
                    words if found.action is None else space.symbol(found.action)
                )
    shown = _frame(bank, said, frame, run)
    order = dict.fromkeys([*manifest.conditions, *CONDITIONS, *(condition for _, condition in said[shown.id])])
    made = []
    for condition in order:
        answers = {
            spec: said[shown.id][spec, condition] for spec in manifest.models if (spec, condition) in said[shown.id]
        }
        if answers:
            images = plan.seen(condition, pictures.frame(shown.id)).images.values()
            asks = CONDITIONS[condition].asks if condition in CONDITIONS else ""
            made.append(Card(condition, asks, tuple(decode(image, condition) for image in images), answers))
    return shown.id, made


def _frame(bank: FrameBank, said: Mapping[str, Mapping[tuple[str, str], str]], wanted: str | None, run: Path) -> Frame:
    if not said:
        raise SpecError(f"{run} holds no answer yet, so there is nothing for a film")
    if wanted is not None and wanted not in said:
        some = ", ".join(list(said)[:3])
        raise SpecError(f"--frame '{wanted}' names no frame with an answer in {run}; there are {some} …")
    if wanted is not None:
        return bank.frame(wanted)
    return max((one for one in bank if one.id in said), key=lambda one: _variety(said[one.id]))


def _variety(answers: Mapping[tuple[str, str], str]) -> tuple[int, int]:
    """Return how many different answers a frame has, and how many answers in all."""
    return len({(spec, answer) for (spec, _), answer in answers.items()}), len(answers)


def write_film(
    run: Path, out: Path, *, frame: str | None = None, banks: Sequence[Path] = (), seconds: float = 1.4
) -> int:
    """Write the film of a frame as a GIF; return its number of pictures, one per condition.

    Raises SpecError for another kind of file, and what `cards` raises.
    """
    if out.suffix.lower() != ".gif":
        raise SpecError(f"--out {out}: a film of a battery is written as .gif")
    if not 0.02 <= seconds <= 60:
        raise SpecError(f"--seconds {seconds:g}: each picture must stay for .02 to 60 seconds")
    shown, made = cards(run, frame, banks)
    specs = list(dict.fromkeys(spec for card in made for spec in card.answers))
    height = max(_height(card) for card in made)
    pages = [draw(card, shown, specs[:MOST_MODELS], height, number) for number, card in enumerate(made)]
    if (left := len(specs) - MOST_MODELS) > 0:
        where, more = (WIDTH - 10, pages[0].height - 20), f"and {left} more models"
        for page in pages:
            ImageDraw.Draw(page).text(where, more, fill=MUTED, font=font(13), anchor="ra")
    reduced = [page.quantize(128, dither=Image.Dither.NONE) for page in pages]
    with whole(out, "film") as partial:
        stays = round(1000 * seconds)
        reduced[0].save(partial, "GIF", save_all=True, append_images=reduced[1:], duration=stays, loop=0, optimize=True)
    return len(reduced)


def _height(card: Card) -> int:
    return max((round(picture.shape[0] * _scale(card)) for picture in card.pictures), default=_BARE)


def _scale(card: Card) -> float:
    return float(WIDTH / sum(picture.shape[1] for picture in card.pictures))


def draw(card: Card, frame: str, specs: Sequence[str], height: int, number: int) -> Image.Image:
    """Return one picture of the film: the frame, its condition, and every model's answer."""
    page = Image.new("RGB", (WIDTH, height + (3 + len(specs)) * _LINE + 12), PAPER)
    pen, left = ImageDraw.Draw(page), 0
    for pixels in card.pictures:
        size = round(pixels.shape[1] * _scale(card)), round(pixels.shape[0] * _scale(card))
        page.paste(Image.fromarray(pixels).resize(size, Image.Resampling.NEAREST), (left, 0))
        left += size[0]
    if not card.pictures:
        pen.text((WIDTH / 2, height / 2), "no picture is shown", fill=MUTED, font=font(18), anchor="mm")
    y = height + 8
    pen.text((10, y), plain(f"{number + 1}. {card.condition}", 60), fill=INK, font=font(17))
    pen.text((10, y + _LINE), plain(card.asks, 96), fill=MUTED, font=font(13))
    short = shortener(specs)
    for row, spec in enumerate(specs):
        top = y + (2 + row) * _LINE
        pen.text((10, top), plain(short(spec), 48), fill=MUTED, font=font(14))
        pen.text((WIDTH // 2, top), plain(card.answers.get(spec, "no call"), 44), fill=INK, font=font(15))
    pen.text((WIDTH - 10, y), plain(f"frame {frame}", 40), fill=MUTED, font=font(13), anchor="ra")
    return page
