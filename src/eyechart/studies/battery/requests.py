"""Compares each call in a ledger, by its digest, with the call that bank, prompt and seed give."""

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eyechart.calls import CallKey
from eyechart.errors import EyechartError, LedgerError, printable
from eyechart.frames import FrameBank, is_bare
from eyechart.ledger import Attempts, hashed
from eyechart.manifest import BANK, RunManifest
from eyechart.perception.view import NONE, find_view
from eyechart.run import Plan
from eyechart.stimuli import Stimuli

FEW = 8
"""The frames compared per condition whose pictures are encoded per call, which is slow."""
MANY = 5_000
"""The most frames compared per condition."""
MOST_BYTES = 200_000_000
"""The most bytes of pictures to compare: making their digests then takes no longer than a score."""
_OF_BANK = "pictures of the bank"

RequestKeys = Mapping[int, CallKey]
"""The hashed digests of requests about one frame under one condition, each with its first call."""


def require_requests(ledger: Path, attempts: Attempts, manifest: RunManifest, plan: Plan) -> None:
    """Raise LedgerError for the first call in a ledger whose request differs from the ``plan``.

    Requests without pictures are compared first. Up to 200 MB of pictures follow: of 5000
    frames per condition if the bank's own are sent, and of a few frames if a call encodes them. The
    latter count only if this machine encodes as the run's did. A validation of the
    run's bundle compares them all. What cannot be known is passed over: a row without a digest,
    pictures that are gone or differ, and a view or condition that no longer exists.
    """
    held = _RequestComparison(ledger.parent, manifest, plan)
    for rows in sorted(_asked_in(attempts, plan), key=lambda rows: attempts.key(rows[0]).condition != "text_only"):
        keys = {int(attempts.request[row]): attempts.key(row) for row in rows}
        _, _, _, frame, condition, _ = next(iter(keys.values()))
        with suppress(EyechartError):
            held.compare(condition, frame, keys)
    if held.wrong:
        raise LedgerError(f"{ledger}: {_words(held.wrong)}")


def _asked_in(attempts: Attempts, plan: Plan) -> Iterator[list[int]]:
    """Yield by frame and condition the first row of each request; a row without a digest is left out.

    They come in the order of the first calls, up to `MANY` frames of a condition.
    """
    each, many = (
        [rows[attempts.request[rows] >= 0] for rows in map(attempts.of, plan.models)],
        len(attempts.names["frame"]),
    )
    compared = np.zeros(len(attempts.names["condition"]) * many, dtype=np.bool_)
    left = np.full(len(attempts.names["condition"]), MANY)
    for rows in each:  # the first frames of each condition, a model at a time
        new = _shown(attempts, rows)
        new = new[~compared[new]]
        new = new[np.sort(np.unique(new, return_index=True)[1])]
        for code in np.flatnonzero(np.bincount(new // many)).tolist():
            chosen = new[new // many == code][: left[code]]
            compared[chosen] = True
            left[code] -= len(chosen)
    rows = np.concatenate([np.zeros(0, dtype=np.int64), *(one[compared[_shown(attempts, one)]] for one in each)])
    shown = _shown(attempts, rows)
    for code in np.flatnonzero(np.bincount(shown // many)).tolist():
        own = np.flatnonzero(shown // many == code)
        order = own[np.lexsort((own, attempts.request[rows[own]], shown[own]))]
        pairs = np.stack([shown[order], attempts.request[rows[order]]])
        new = np.concatenate([np.ones(min(1, len(order)), dtype=np.bool_), (pairs[:, 1:] != pairs[:, :-1]).any(axis=0)])
        order = np.sort(order[new])
        found: dict[int, list[int]] = {}
        for place in order.tolist():
            found.setdefault(int(shown[place]), []).append(int(rows[place]))
        yield from found.values()


def _shown(attempts: Attempts, rows: NDArray[np.integer[Any]]) -> NDArray[np.int64]:
    """Return a number of each row's condition and frame."""
    conditions, frames = (attempts.codes[name][rows].astype(np.int64) for name in ("condition", "frame"))
    shown: NDArray[np.int64] = conditions * len(attempts.names["frame"]) + frames
    return shown


def _words(wrong: list[CallKey]) -> str:
    _, model, _, frame, condition, _ = map(printable, map(str, wrong[0]))
    more = f", as do {len(wrong) - 1} other calls" if len(wrong) > 1 else ""
    return (
        f"the call of {model} about frame '{frame}' under {condition} asked something else than this run asks{more}. "
        "The ledger was made with another bank, prompt or seed than run.json says. Restore the ledger or run.json from "
        "a copy, or run anew with another --out"
    )


@dataclass
class _RequestComparison:
    """The requests of a run, compared frame by frame; ``wrong`` are the calls that differ."""

    run: Path
    manifest: RunManifest
    plan: Plan
    _wrong: list[CallKey] = field(default_factory=list)
    _alike: set[str] = field(default_factory=set)
    _unlike: dict[str, list[CallKey]] = field(default_factory=dict)
    _made: dict[str, bool] = field(default_factory=dict)
    _times: Counter[str] = field(default_factory=Counter)
    _bytes: int = 0

    @property
    def wrong(self) -> list[CallKey]:
        """Return the calls whose request differs.

        An encoded picture that differs counts only if another of its kind came out the same.
        """
        return [*self._wrong, *(key for kind in self._alike for key in self._unlike.get(kind, ()))]

    @cached_property
    def _bank(self) -> FrameBank:
        """Return the bank with its pictures as on disk: in the run, or at their recorded place."""
        own = self.run / BANK
        held = (own / self.plan.bank.frames[0].file).is_file()
        return replace(self.plan.bank, root=own if held else Path(self.manifest.bank_path), plain=False)

    @cached_property
    def _stored(self) -> Stimuli:
        return replace(self.plan, bank=self._bank, view=None).stimuli()

    @cached_property
    def _sent(self) -> Stimuli:
        bank = replace(self._bank, plain=self.plan.bank.plain)
        return replace(self.plan, bank=bank, view=find_view(self.manifest.view)).stimuli()

    def compare(self, condition: str, frame: str, requests: RequestKeys) -> None:
        """Compare the requests about a frame under a condition.

        Raises BankError where a picture cannot be read or is not the run's, so that nothing can be
        said.
        """
        if self._bytes > MOST_BYTES or self._times[condition] == FEW:
            return
        exact = self._leaves_as_it_is(condition, frame)
        self._times[condition] += not exact
        seen = (self._stored if exact else self._sent).show(condition, frame)
        self._bytes += sum(map(len, seen.pictures))
        key = CallKey(self.plan.study, "", self.plan.prompt.key, frame, condition)
        wrong = requests.keys() - {hashed(self.plan.query(key, seen).sha256())}
        kind = condition if self._made[condition] or self.manifest.view != NONE else _OF_BANK
        if not exact and len(wrong) < len(requests):
            self._alike.add(kind)
        if wrong:
            found = self._wrong if exact else self._unlike.setdefault(kind, [])
            found.extend(call for digest, call in requests.items() if digest in wrong)

    def _leaves_as_it_is(self, condition: str, frame: str) -> bool:
        """Return whether a call's pictures are the bank's files unchanged, or it has none."""
        if self._is_made(condition, frame):
            return False
        images = self._stored.show(condition, frame).pictures
        as_they_lie = not self.plan.bank.plain or all(map(is_bare, images))
        return not images or (as_they_lie and self.manifest.view == NONE)

    def _is_made(self, condition: str, frame: str) -> bool:
        """Return whether a condition makes its pictures; decided on the first frame."""
        if condition not in self._made:
            lying = [self._bank.read(file) for file in self.plan.sources(condition, self._bank.frame(frame))]
            images = self._stored.show(condition, frame).pictures
            self._made[condition] = not all(image in lying for image in images)
        return self._made[condition]
