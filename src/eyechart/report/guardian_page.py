"""The guardian's page: operating points on the risk–coverage curve, every vote, and what was missed with its views."""

from collections.abc import Iterable, Sequence

from eyechart.conditions import flip
from eyechart.errors import EyechartError
from eyechart.frames import FrameBank, decode, encode
from eyechart.guardian import interface_of
from eyechart.report.drawing import BLUE, INK, MUTED, VERMILLION, Drawing, canvas, style
from eyechart.report.guardian import bound_lines, guardian_table, row_names, score_lines
from eyechart.report.page import Page, fill
from eyechart.report.pictures import view_uri
from eyechart.studies.guardian import VIEWS, GuardianScore

MOST_PICTURES = 24
MOST_ROWS = 3000
_SIGNS = {1: "●", 0: "○", -1: "×"}


def guardian_page(found: GuardianScore, bank: FrameBank | None) -> Page:
    """Return a score as a page; without a ``bank`` it shows no pictures, and says so.

    The same score gives the same bytes.
    """
    frozen, table = found.frozen, found.table
    pictures, note = _pictures(found, bank)
    votes = _votes(found)
    listed = sum(len(rows) for _, rows in votes)
    drawn = curve(found)
    html = fill(
        "guardian.html",
        styles=("guardian.css",),
        digest=frozen.digest,
        committee=frozen.committee,
        threshold=frozen.threshold,
        voters=frozen.voters,
        point=frozen.point,
        frames=len(table.frames),
        episodes=len(set(table.episodes)),
        bank=frozen.about.bank_name,
        warnings=found.warnings,
        points=guardian_table(found),
        lines=list(score_lines(found, bounds=False))[1:],
        curve=drawn,
        bound=[] if found.bound is None else list(bound_lines(found.bound)),
        missed=len(found.missed),
        hazards=int(table.hazard.sum()),
        note=note,
        pictures=pictures,
        votes=votes,
        left_out="" if listed == len(table.frames) else f"The first {listed} of {len(table.frames)} frames.",
    )
    return Page(html, {"curve": [drawn]})


def curve(found: GuardianScore) -> Drawing:
    """Draw the share of wrong answers against the share of frames answered, with the operating points on it."""
    with style():
        return _curve(found)


def _curve(found: GuardianScore) -> Drawing:
    figure, axes = canvas(6.4, 3.4, (0.7, 0.2, 0.55, 0.2))
    points = [(one.answered / one.frames, one.wrong / one.answered) for one in found.curve]
    axes.plot([x for x, _ in points], [y for _, y in points], color=BLUE, linewidth=1.6, marker="o", markersize=3)
    labels: dict[tuple[float, float], list[str]] = {}
    told, top = [], max([0.02, *(y for _, y in points)])
    for key, name in row_names(found.frozen).items():
        x, accuracy = found.rows[key]["coverage"].value, found.rows[key]["acc"].value
        if x is None or accuracy is None:
            continue
        top = max(top, 1 - accuracy)
        own = key == found.frozen.point
        axes.plot([x], [1 - accuracy], "s" if key == "single" else "o", color=VERMILLION if own else INK, markersize=7)
        word = "single model" if key == "single" else key.replace("_", "-")
        labels.setdefault((round(x, 2), round(1 - accuracy, 3)), []).append(word)
        told.append(f"{name}: coverage {x:.3f}, risk {1 - accuracy:.3f}")
    for place, words in labels.items():
        said = ", ".join(words)
        axes.annotate(said, place, xytext=(-8, 6), textcoords="offset points", ha="right", color=MUTED)
    axes.set_xlim(0, 1.03)
    axes.set_ylim(-0.04 * top, 1.25 * top)
    axes.set_xlabel("coverage: share of frames answered")
    axes.set_ylabel("risk: share of answers wrong")
    return Drawing("guardian-curve", "Risk by coverage", ". ".join(told), figure)


def _votes(found: GuardianScore) -> list[tuple[str, list[dict[str, object]]]]:
    """Return the frames episode by episode, each with its votes and what became of it."""
    table, own = found.table, found.table.of(found.frozen.committee)
    episodes: dict[str, list[dict[str, object]]] = {}
    for place, frame in enumerate(table.frames[:MOST_ROWS]):
        hazard, answer = bool(table.hazard[place]), found.answers[frame]
        wrong = {("clear", True): "missed", ("hazard", False): "alarm"}.get((answer, hazard), "right")
        episodes.setdefault(table.episodes[place], []).append(
            {
                "frame": frame,
                "truth": "hazard" if hazard else "clear",
                "votes": [" ".join(_SIGNS[int(vote)] for vote in model[place]) for model in own],
                "answer": answer,
                "kind": "handed" if answer == "abstain" else wrong,
            }
        )
    return sorted(episodes.items())


def _pictures(found: GuardianScore, bank: FrameBank | None) -> tuple[list[dict[str, object]], str]:
    """Return the views of the first frames that were missed, and what has to be said about them."""
    if not found.missed:
        return [], ""
    if bank is None:
        return [], "Their pictures are shown where the bank is given with --frames."
    table = found.table
    shown: list[dict[str, object]] = []
    for frame in found.missed[:MOST_PICTURES]:
        place = table.frames.index(frame)
        said = table.of(found.frozen.committee)[:, place]
        views = [
            (view, view_uri(picture), _said(found.frozen.committee, said[:, number_of].tolist()))
            for number_of, (view, picture) in enumerate(zip(VIEWS, _views(found, bank, frame), strict=False))
        ]
        shown.append({"frame": frame, "episode": table.episodes[place], "views": views})
    more = len(found.missed) - len(shown)
    return shown, f"The first {len(shown)} are shown; {more} more are in the table of votes." if more else ""


def _views(found: GuardianScore, bank: FrameBank, frame_id: str) -> Sequence[bytes]:
    """Return what the models were shown of a frame, or without a known view the picture and its reflection."""
    frame = bank.frame(frame_id)
    image = bank.recorded(frame)
    try:
        return interface_of(found.frozen).views(image)
    except EyechartError:
        if frame.mirror_axis == "none":
            return (image,)
        return (image, encode(flip(decode(image, frame_id), frame.mirror_axis)))


def _said(committee: Sequence[str], votes: Iterable[int]) -> str:
    words = {1: "hazard", 0: "clear", -1: "missing"}
    return ", ".join(f"{model} {words[int(vote)]}" for model, vote in zip(committee, votes, strict=True))
