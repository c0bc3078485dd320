"""A frozen guardian: a committee and its threshold, with the frames that chose it."""

import hashlib
import json
import math
import re
import unicodedata
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec

from eyechart import __version__
from eyechart.errors import EyechartError, GuardianError, OutputError, raising, read_at_most
from eyechart.frames import FrameBank, MirrorAxis
from eyechart.modes import RequestMode
from eyechart.prompts import Prompt
from eyechart.records import Name, build, parse_json, plain
from eyechart.stats.committee_votes import Costs, Point
from eyechart.studies.guardian.votes import VIEWS, VoteProvenance, VoteTable

FORMAT = "eyechart-guardian/1"
EXPORT_FORMAT = "eyechart-guardian-stack/1"

RULE = "highest balanced accuracy of the two-way point on the calibration frames, a frame without an answer being wrong"
COST_RULE = "lowest expected cost of a frame on the calibration frames"
_IN_ORDER = (
    "first committee in lexicographic order, then lowest threshold, then two_way before abstain before unanimous"
)
TIE_BREAKS = f"committees in which every model votes hazard on some frame, then {_IN_ORDER}"

_MOST_BYTES = 64_000_000
NAME, PICTURE, SPELLING = "is", "shows the very picture of", "has the name of"
"""How a frame matches one that chose the guardian, in words."""
_MORE = {PICTURE: "", SPELLING: ", but for its spelling or its ending"}
_LEFT = {
    NAME: "chose this guardian",
    PICTURE: "show the very picture of one that did",
    SPELLING: "have the name of one that did, but for its spelling or its ending",
}

_NAMES = {"single": "best_single_model"}
"""Names of a selection's fields in the file, if they differ."""
_ENDING = re.compile(r"\.(?:png|jpe?g|webp|bmp|gif|tiff?)$")


class Selection(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, rename=_NAMES):
    """The choice of a guardian: its frames and episodes, and their scores.

    ``worth`` is the balanced accuracy on those frames, or with ``costs`` minus the expected cost.
    ``candidates`` counts the committees with their thresholds and operating points. ``single`` is
    the best single model on the same frames, by its vote on the original picture. ``pictures`` are
    the digests of the frames' pictures, if the bank records them. ``tie_breaks`` is the rule for
    ties.
    """

    costs: Costs | None = None
    candidates: Annotated[int, msgspec.Meta(ge=1)]
    worth: float
    single: str
    frames: tuple[str, ...]
    episodes: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]
    pictures: tuple[str, ...] = ()
    tie_breaks: str = TIE_BREAKS

    def __post_init__(self) -> None:
        if self.tie_breaks not in {TIE_BREAKS, _IN_ORDER}:
            raise ValueError("its rule for ties is unknown to this eyechart")
        if len(set(self.frames)) != len(self.frames) or not self.frames:
            raise ValueError("the frames that chose it are missing or repeated")
        if self.pictures and len(self.pictures) != len(self.frames):
            raise ValueError(
                f"it remembers {len(self.pictures)} pictures of {len(self.frames)} frames, so that some would not be "
                "known again"
            )
        if not (self.worth <= 0 if self.costs else 0 <= self.worth <= 1) or not math.isfinite(self.worth):
            raise ValueError(f"its worth on the frames that chose it is {self.worth:g}, which is impossible")

    @property
    def rule(self) -> str:
        """Return the rule of selection in words."""
        return RULE if self.costs is None else COST_RULE


@dataclass(frozen=True, slots=True)
class FrozenGuardian:
    """A committee of models, its threshold of hazard votes, its operating point, and its requests.

    ``selection`` is None in an exported guardian: that one may judge pictures, but scores nothing.
    ``chosen_as`` is then the digest of the guardian that it was exported from.
    """

    committee: tuple[str, ...]
    threshold: int
    point: Point
    about: VoteProvenance
    selection: Selection | None
    chosen_as: str = ""
    made_by: str = __version__

    @property
    def voters(self) -> int:
        """Return the number of votes of a full committee."""
        return len(self.committee) * len(VIEWS)

    @property
    def models(self) -> tuple[str, ...]:
        """Return the committee, and the best single model if it is no member."""
        single = [self.selection.single] if self.selection else []
        return tuple(dict.fromkeys((*self.committee, *single)))

    @property
    def digest(self) -> str:
        """Return the digest of the guardian's file without the digest."""
        return hashlib.sha256(json.dumps(self._content(), sort_keys=True).encode()).hexdigest()

    def as_dict(self) -> dict[str, object]:
        """Return the guardian as plain JSON values, its digest last."""
        return {**self._content(), "digest": self.digest}

    def exported(self) -> "FrozenGuardian":
        """Return the guardian for a stack: without its selection."""
        about = self.about.only(self.committee)
        return replace(self, about=about, selection=None, chosen_as=self.chosen_as or self.digest)

    def may_score(self, table: VoteTable) -> None:
        """Raise GuardianError if this guardian must not score a table, and say why.

        A frame that chose it is refused, also by its picture or its name in another spelling. So
        are another bank, prompt or view, and another version of a model.
        """
        if self.selection is None:
            raise GuardianError(
                "an exported guardian does not hold the frames that chose it, so it cannot score: give the "
                "guardian.json that it was made of"
            )
        self._require_same(table)
        shared = list(shared_frames(table, self.selection.frames, self.selection.pictures))
        if seen := [frame for frame, _, how in shared if how == NAME]:
            raise GuardianError(
                f"frame '{seen[0]}' is one of {len(seen)} in {table.name} that chose this guardian; a score on them "
                "says nothing: leave them out with --unseen"
            )
        for frame, known, how in shared:
            raise GuardianError(
                f"frame '{frame}' in {table.name} {how} '{known}', which chose this guardian{_MORE[how]}; a score on "
                "it says nothing: leave it out with --unseen"
            )

    def unseen(self, table: VoteTable) -> VoteTable:
        """Return a table without the frames that chose this guardian, by name or by picture."""
        if self.selection is None:
            return table
        shared = shared_frames(table, self.selection.frames, self.selection.pictures)
        return table.without([frame for frame, _, _ in shared])

    def scorable(self, table: VoteTable, *, unseen: bool) -> tuple[VoteTable, dict[str, object], list[str]]:
        """Return the frames of a table to score on, and what was left out, by reason and in words.

        Without ``unseen`` nothing is left out. Raises GuardianError if no frame is left.
        """
        if not unseen:
            return table, {}, []
        kept, left = self.unseen(table), self.left_out(table)
        if table.frames and not kept.frames:
            raise GuardianError(
                f"all {len(table.frames)} frames of {table.name} chose this guardian, so none is left to score: "
                "give votes on other frames, as 'eyechart run structured' makes them"
            )
        why = ", ".join(f"{count} {words}" for words, count in left.items())
        words = f"{sum(left.values())} of {len(table.frames)} frames are left out{why and f': {why}'}"
        return kept, {"left_out": left}, [words]

    def left_out(self, table: VoteTable) -> dict[str, int]:
        """Return how many frames of a table ``unseen`` leaves out, by reason."""
        if self.selection is None:
            return {}
        known = Counter(how for _, _, how in shared_frames(table, self.selection.frames, self.selection.pictures))
        return {words: known[how] for how, words in _LEFT.items() if known[how]}

    def may_show(self, bank: FrameBank) -> None:
        """Raise GuardianError if a bank's pictures differ from those of this guardian's votes."""
        if self.about.bank not in {None, bank.manifest.fingerprint}:
            raise GuardianError(
                f"the bank differs: this guardian is of {self.about.bank_name}, {bank.root} is {bank.name}"
            )

    def _require_same(self, table: VoteTable) -> None:
        for name in ("bank", "prompt", "view", "reader"):
            mine, theirs = getattr(self.about, name), getattr(table.about, name)
            if mine != theirs:
                raise GuardianError(
                    f"the {name} differs: this guardian was chosen with {_short(mine)}, {table.name} is of "
                    f"{_short(theirs)}; choose a guardian for this {name} with 'eyechart guardian fit'"
                )
        if None is not self.about.voting != table.about.voting is not None:
            raise GuardianError(
                f"the rules for votes differ: this guardian was chosen under version {self.about.voting}, {table.name} "
                f"is read under version {table.about.voting}; choose a guardian with 'eyechart guardian fit'"
            )
        for model in self.models:
            mine, theirs = (
                " served as ".join(filter(None, (one.versions.get(model), one.served.get(model))))
                for one in (self.about, table.about)
            )
            if mine != theirs:
                raise GuardianError(
                    f"the model '{model}' differs: this guardian was chosen with version {_short(mine)}, {table.name} "
                    f"has votes of {_short(theirs)}; choose a guardian for this version with 'eyechart guardian fit'"
                )
            chosen, here = self.about.modes.get(model), table.about.modes.get(model)
            if chosen is not None and here is not None and not chosen.differs_in_address_only(here):
                raise GuardianError(
                    f"the mode of '{model}' differs: {table.name} has votes from other requests than those that "
                    "chose this guardian; choose a guardian for this mode with 'eyechart guardian fit'"
                )

    def _content(self) -> dict[str, object]:
        about, chosen = self.about, self.selection
        return {
            "format": FORMAT if self.selection else EXPORT_FORMAT,
            "committee": list(self.committee),
            "views": list(VIEWS),
            "threshold": self.threshold,
            "operating_point": self.point,
            "models": {
                model: {"version": about.versions.get(model), "served": about.served.get(model)}
                | {"mode": plain(about.modes.get(model))}
                for model in self.models
            },
            "prompt": {"key": about.prompt, "wording": plain(about.wording)},
            "view": about.view,
            "mirror_axis": about.axis,
            "reader": about.reader,
            # 0.1.0 had one set of rules, and did not record it.
            **({} if about.voting is None else {"voting": about.voting}),
            "bank": {"name": about.bank_name, "fingerprint": about.bank},
            **(
                {"selection": {"rule": chosen.rule, **msgspec.to_builtins(chosen)}}
                if chosen
                else {"chosen_as": self.chosen_as}
            ),
            "eyechart": self.made_by,
        }


def write_frozen(path: Path, frozen: FrozenGuardian) -> None:
    """Write a guardian's file."""
    path.write_text(json.dumps(frozen.as_dict(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def require_own(out: Path, frozen: FrozenGuardian) -> None:
    """Raise OutputError if ``out`` holds another guardian; overwriting it would lose its frames."""
    if not out.exists() or not out.stat().st_size:
        return
    try:
        same = read_frozen(out).digest == frozen.digest
    except GuardianError:
        same = False
    if not same:
        raise OutputError(f"{out} holds another guardian, and is not overwritten: choose another place, or remove it")


def read_frozen(path: Path) -> FrozenGuardian:
    """Read a guardian's file, exported or not; GuardianError if it is none or was edited."""
    raw = _read(path)
    said = raw.pop("digest", None)
    if said != hashlib.sha256(json.dumps(raw, sort_keys=True).encode()).hexdigest():
        raise GuardianError(
            f"{path} was edited after it was frozen: its digest does not match; choose a guardian anew with "
            "'eyechart guardian fit'"
        )
    unlike = (ValueError, KeyError, TypeError, AttributeError, RecursionError, EyechartError)
    with raising(GuardianError, f"{path} is no guardian that this eyechart can read", of=unlike, words=_in_words):
        frozen = _frozen(raw)
    if frozen.digest != said:
        raise GuardianError(f"{path}: {_unlike(frozen, raw)}; choose a guardian anew with 'eyechart guardian fit'")
    return frozen


def _in_words(error: Exception) -> str:
    if isinstance(error, KeyError):
        return f"it has no '{error.args[0]}'"
    if isinstance(error, TypeError | AttributeError | RecursionError):
        return f"a value in it has the wrong type ({error})"
    return str(error)


def _unlike(frozen: FrozenGuardian, raw: Mapping[str, object]) -> str:
    """Return what differs from this version's format in a file whose digest is right."""
    if frozen.made_by != __version__:
        return f"it was written by eyechart {frozen.made_by}, whose guardians this one, {__version__}, cannot read"
    mine = json.loads(json.dumps(frozen.as_dict()))
    names = [name for name in sorted({*mine, *raw} - {"digest"}) if mine.get(name) != raw.get(name)]
    return f"it is not as eyechart {__version__} writes a guardian, though its digest is its own: {', '.join(names)}"


def _read(path: Path) -> dict[str, object]:
    text = read_at_most(path, _MOST_BYTES, GuardianError, "a guardian")
    with raising(GuardianError, f"{path} is no guardian", of=(ValueError, RecursionError)):
        raw = parse_json(text)
    if not isinstance(raw, dict) or raw.get("format") not in [FORMAT, EXPORT_FORMAT]:
        raise GuardianError(f"{path} is no guardian; 'eyechart guardian fit' writes one")
    return raw


class _Model(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    version: str | None
    served: str | None
    mode: dict[str, Any] | None


class _Prompt(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    key: str | None
    wording: dict[str, Any] | None


class _Bank(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    name: str
    fingerprint: str | None


class _File(msgspec.Struct, frozen=True):
    """The contents of a guardian's file, without the text of its rule."""

    format: str
    committee: tuple[Name, ...]
    views: tuple[str, ...]
    threshold: int
    operating_point: Point
    models: dict[str, _Model]
    prompt: _Prompt
    view: str | None
    mirror_axis: MirrorAxis | None
    reader: int | None
    bank: _Bank
    eyechart: str
    voting: int | None = None
    selection: Selection | None = None
    chosen_as: str = ""

    def __post_init__(self) -> None:
        if len(set(self.committee)) != len(self.committee) or not set(self.committee) <= set(self.models):
            raise ValueError(f"its committee is no list of different models: {', '.join(self.committee)[:200]}")
        if self.views != VIEWS:
            raise ValueError(f"its views are not {' and '.join(VIEWS)}")
        voters = len(self.committee) * len(VIEWS)
        if not 1 <= self.threshold <= voters:
            raise ValueError(f"its threshold is {self.threshold}, and no whole number from 1 to its {voters} votes")
        if self.selection is not None and self.selection.single not in self.models:
            raise ValueError(f"its best single model is none of its models: {self.selection.single[:80]}")


def _mode_of(model: str, said: Mapping[str, object]) -> RequestMode:
    mode = RequestMode.from_dict(said, model)
    if mode.spec != model:
        raise ValueError(f"the mode of '{model}' is that of '{mode.spec[:80]}'")
    return mode


def _frozen(raw: Mapping[str, object]) -> FrozenGuardian:
    # The digest covers the other fields.
    said = {name: raw[name] for name in _File.__struct_fields__ if name in raw}
    if isinstance(chosen := said.get("selection"), dict):
        # The rule is text for people.
        said["selection"] = {name: value for name, value in chosen.items() if name != "rule"}
    file = build(_File, said)
    about = VoteProvenance(
        bank=file.bank.fingerprint,
        bank_name=file.bank.name,
        prompt=file.prompt.key,
        view=file.view,
        versions={name: model.version for name, model in file.models.items() if model.version is not None},
        served={name: model.served for name, model in file.models.items() if model.served is not None},
        modes={name: _mode_of(name, model.mode) for name, model in file.models.items() if model.mode is not None},
        wording=None if file.prompt.wording is None else Prompt.from_dict(file.prompt.wording),
        axis=file.mirror_axis,
        reader=file.reader,
        voting=file.voting,
    )
    return FrozenGuardian(
        committee=file.committee,
        threshold=file.threshold,
        point=file.operating_point,
        about=about,
        selection=file.selection,
        chosen_as=file.chosen_as,
        made_by=file.eyechart,
    )


def shared_frames(table: VoteTable, frames: Sequence[str], pictures: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """Yield each frame of a table that is one of ``frames``, its counterpart, and the match.

    Frames match by name, by the same name in another spelling, or by the digest of the picture if
    ``pictures`` has those of ``frames``.
    """
    names, by_picture = set(frames), dict(zip(pictures, frames, strict=False))
    by_spelling = {_spelling(frame): frame for frame in frames}
    for frame, picture in zip(table.frames, table.pictures or (None,) * len(table.frames), strict=True):
        if frame in names:
            yield frame, frame, NAME
        elif picture is not None and picture in by_picture:
            yield frame, by_picture[picture], PICTURE
        elif (same := by_spelling.get(_spelling(frame))) is not None:
            yield frame, same, SPELLING


def _spelling(frame: str) -> str:
    """Return a frame's name without case, Unicode form and ending."""
    text = unicodedata.normalize("NFKC", frame).casefold().replace("\\", "/").removeprefix("./")
    return _ENDING.sub("", text)


def _short(value: str | int | None) -> str:
    text = str(value)
    return "none recorded" if value in {None, ""} else f"'{text}'" if len(text) <= 24 else f"'{text[:24]}…'"
