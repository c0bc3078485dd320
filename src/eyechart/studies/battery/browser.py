"""The data of a report's browser of frames: every call, its verbatim reply and its decision."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import starmap

from eyechart.calls import Reply
from eyechart.conditions import find_condition, seed_of, text_source_frame
from eyechart.frames import Frame, Scalar
from eyechart.records import to_json_fields
from eyechart.report.page import evenly, pack
from eyechart.run import spread
from eyechart.spaces.space import Decision, ending
from eyechart.studies.battery.album import Album
from eyechart.studies.battery.subjects import Evidence

LONGEST = 400_000
"""The most characters of one reply in the page; the ledger has all of it."""
BUDGET = 32_000_000
"""The most characters of all replies together in the page."""
PACKED_FROM = 1_500_000
"""From this many characters on, the page packs replies and calls, and unpacks them when viewed."""
_CALL, _CALL_PACKED = 20, 5
"""The characters of a call besides its reply."""
_SAMPLE = 2000

MOST_FRAMES = 3000
MOST_CALLS = 120_000
"""The most frames and calls in the page; further frames are left out, evenly over the episodes."""
MOST_COLUMNS = 30
_LONGEST_WORD = 100
_LONGEST_NOTE = 500
_NOTES = 1_000_000
"""The most characters of all notes on finish reasons and errors together."""


@dataclass(frozen=True)
class Texts:
    """Distinct replies, each cut to ``limit`` characters."""

    numbers: dict[str, int]
    limit: int

    @property
    def cut(self) -> int:
        """Return how many replies are cut."""
        return sum(len(text) > self.limit for text in self.numbers)

    @property
    def characters(self) -> int:
        """Return the number of characters of all replies as cut."""
        return sum(min(len(text), self.limit) for text in self.numbers)


def frames_shown(
    evidence: Sequence[Evidence], *, frames: int = MOST_FRAMES, calls: int = MOST_CALLS
) -> tuple[tuple[int, ...], ...]:
    """Return, run by run, the numbers of the frames that the page lists."""
    every = sum(len(run.frames) for run in evidence)
    planned = sum(len(run.frames) * len(run.conditions) * len(run.score.models) for run in evidence)
    part = min(1.0, frames / max(1, every), calls / max(1, planned))
    found = []
    for run in evidence:
        kept = {frame.id for frame in spread(run.frames, max(1, int(part * len(run.frames))))} if run.frames else set()
        found.append(tuple(place for place, frame in enumerate(run.frames) if frame.id in kept))
    return tuple(found)


def collect_texts(evidence: Sequence[Evidence], shown: Sequence[Sequence[int]], *, budget: int = BUDGET) -> Texts:
    """Return the distinct replies about the shown frames, and the length that fits the budget."""
    texts = dict.fromkeys(reply.text for reply, _ in _replies_shown(evidence, shown))
    numbers = {text: number for number, text in enumerate(texts)}
    return Texts(numbers, _fitting(numbers, LONGEST, budget))


def _calls_shown(evidence: Sequence[Evidence], shown: Sequence[Sequence[int]]) -> int:
    runs = zip(evidence, shown, strict=True)
    return sum(len(places) * len(run.conditions) * len(run.score.models) for run, places in runs)


def _is_heavy(evidence: Sequence[Evidence], shown: Sequence[Sequence[int]], texts: Texts) -> bool:
    """Return whether the replies about the shown frames are so long that the page packs them."""
    return texts.characters + _CALL * _calls_shown(evidence, shown) > PACKED_FROM


def about_packed(evidence: Sequence[Evidence], shown: Sequence[Sequence[int]], texts: Texts) -> int:
    """Return the estimated characters of the packed replies, by a sample; 0 if not packed."""
    if not _is_heavy(evidence, shown, texts):
        return 0
    sample = [text[: texts.limit] for text in evenly(list(texts.numbers), _SAMPLE)]
    each = len(pack(sample)) / max(1, sum(map(len, sample)))
    return int(each * texts.characters) + _CALL_PACKED * _calls_shown(evidence, shown)


def packed_data(
    evidence: Sequence[Evidence], album: Album, texts: Texts, shown: Sequence[Sequence[int]], room: int
) -> tuple[Texts, dict[str, object], str]:
    """Return the replies, cut to fit ``room``, and the page's data, plain and packed."""
    budget = BUDGET
    while True:
        data = browser_data(evidence, album, texts, shown)
        if not _is_heavy(evidence, shown, texts):
            return texts, data, ""
        packed = pack({name: values for name, values in data.items() if name != "pictures"})
        if len(packed) <= room or budget < PACKED_FROM:
            return texts, {"pictures": data["pictures"]}, packed
        budget = int(0.9 * texts.characters * room / len(packed))
        texts = collect_texts(evidence, shown, budget=budget)


def _replies_shown(
    evidence: Sequence[Evidence], shown: Sequence[Sequence[int]]
) -> Iterator[tuple[Reply, Decision[str]]]:
    """Yield the replies about the shown frames, in an order independent of the ledger."""
    for run, places in zip(evidence, shown, strict=True):
        for spec, model in run.score.models.items():
            for condition in run.conditions:
                given = model.answers.decisions.get(condition, (None,) * len(run.frames))
                for place in places:
                    reply, decision = run.replies[spec].get((run.frames[place].id, condition)), given[place]
                    if reply is not None and decision is not None:
                        yield reply, decision


def _fitting(texts: Collection[str], longest: int, budget: int) -> int:
    """Return the length of cut at which all texts fit a budget; short ones stay whole."""
    left = budget
    for place, length in enumerate(sorted(map(len, texts))):
        share = left // (len(texts) - place)
        if length > share:
            return min(longest, share)
        left -= length
    return longest


def _note(reply: Reply, decision: Decision[str]) -> str:
    notes = (
        []
        if reply.finish_reason is None or ending(reply.finish_reason) == "normal"
        else [f"finish reason {reply.finish_reason}"]
    )
    if reply.error is not None:
        notes.append(f"error {reply.error}: {reply.error_detail}")
    if decision.why is not None:
        notes.append(f"unparsed: {decision.why.replace('_', ' ')}")
    return "; ".join(notes)


def browser_data(
    evidence: Sequence[Evidence], album: Album, texts: Texts, shown: Sequence[Sequence[int]]
) -> dict[str, object]:
    """Return plain JSON values: runs with their shown frames and calls, replies, pictures."""
    said = dict.fromkeys(filter(None, starmap(_note, _replies_shown(evidence, shown))))
    notes = Texts({note: number for number, note in enumerate(said)}, _fitting(said, _LONGEST_NOTE, _NOTES))
    return {
        "notes": [note[: notes.limit] for note in notes.numbers],
        "texts": [text[: texts.limit] for text in texts.numbers],
        "cut": {str(number): len(text) for text, number in texts.numbers.items() if len(text) > texts.limit},
        "pictures": list(album.uris),
        "runs": [
            _run(run, places, (texts, notes), taken)
            for run, places, taken in zip(evidence, album.places, shown, strict=True)
        ],
    }


def _run(
    run: Evidence, places: dict[str, tuple[int, ...]], texts: tuple[Texts, Texts], taken: Sequence[int]
) -> dict[str, object]:
    space = run.score.bank.manifest.action_space
    roles = dict.fromkeys(space.brake, "brake") | dict.fromkeys(space.proceed, "proceed")
    frames = [run.frames[place] for place in taken]
    return {
        "name": run.name,
        "conditions": [
            {"name": one.name, "image": one.image, "asks": one.asks} for one in map(find_condition, run.conditions)
        ],
        "actions": list(space.actions),
        "roles": roles,
        "asked": len(run.frames),
        "frames": [
            {**to_json_fields(frame, "id scenario episode step"), "truth": _words(frame.truth), **_said(run, frame)}
            for frame in frames
        ],
        "pictures": {name: [numbers[place] for place in taken] for name, numbers in places.items()},
        "models": [
            {"name": spec, "calls": {name: _calls(run, spec, name, taken, texts) for name in run.conditions}}
            for spec in run.score.models
        ],
    }


def _words(values: Mapping[str, Scalar]) -> list[list[str]]:
    shown = [[name, "none" if value is None else str(value)[:_LONGEST_WORD]] for name, value in values.items()]
    more = len(shown) - MOST_COLUMNS
    return shown if more <= 0 else [*shown[:MOST_COLUMNS], ["and more columns", str(more)]]


def _said(run: Evidence, frame: Frame) -> dict[str, object]:
    """Return the prompt's words on a frame, and the other frame's words under text_swapped."""
    fields = run.score.manifest.prompt.fields
    if not fields:
        return {}
    texts: dict[str, object] = {"said": _words({name: frame.fields[name] for name in fields})}
    for name in run.conditions:
        if "text" in find_condition(name).needs:
            other = text_source_frame(frame, run.score.bank, seed_of(name, frame, run.score.manifest.seed))
            texts["told"] = {name: [other.id, _words({field: other.fields[field] for field in fields})]}
    return texts


def _calls(
    run: Evidence, spec: str, condition: str, taken: Sequence[int], texts: tuple[Texts, Texts]
) -> list[list[int | str | bool] | None]:
    """Return per frame: reply number, action or reason, whether it is an action, note number."""
    given = run.score.models[spec].answers.decisions.get(condition, (None,) * len(run.frames))
    calls: list[list[int | str | bool] | None] = []
    for place in taken:
        reply, decision = run.replies[spec].get((run.frames[place].id, condition)), given[place]
        if reply is None or decision is None:
            calls.append(None)
            continue
        word, note = decision.action or str(decision.missing), _note(reply, decision)
        numbers = [texts[1].numbers[note]] if note else []
        calls.append([texts[0].numbers[reply.text], word, decision.action is not None, *numbers])
    return calls
