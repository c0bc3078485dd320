"""The doctor: at most 28 calls that say whether a model sees, how much, and whether its replies may be used.

It needs no bank. What it finds holds for the way in which the model was asked.
"""

import contextlib
from dataclasses import dataclass
from typing import Unpack

from eyechart.calls import Reply, is_cut
from eyechart.limits import Spent
from eyechart.loops import in_own_loop
from eyechart.modes import RequestMode
from eyechart.probe.acuity import MOST_CALLS as OF_ACUITY
from eyechart.probe.acuity import NOT_ASKED, Acuity, acuity
from eyechart.probe.asking import Asker, Asking, LimitReachedError
from eyechart.probe.causes import likely_causes
from eyechart.probe.pictures import CHOICES
from eyechart.probe.sample import Sample, default_sample, is_served, schema_binds
from eyechart.probe.sight import Outcome, Sight, look
from eyechart.records import picked, plain
from eyechart.stats.statistic import Statistic

MOST_CALLS = 20 + OF_ACUITY


@dataclass(frozen=True)
class Diagnosis:
    """What the doctor found. ``mode`` is how the model was asked in the end, ``notes`` say what was changed for that.

    ``schema_binds`` and ``budget_enough`` are None where that cannot be said, with the reason in ``schema_says`` and
    ``budget_says``. ``facts`` is what is known of the model without asking.
    """

    mode: RequestMode
    seed: int
    sight: Sight
    causes: tuple[str, ...]
    schema_binds: bool | None
    schema_says: str
    budget_enough: bool | None
    budget_says: str
    spent: Spent
    facts: dict[str, str]
    notes: tuple[str, ...] = ()
    acuity: Acuity = NOT_ASKED
    unasked: str = ""
    """Why the driving prompt could not be asked; empty where it was."""

    @property
    def outcome(self) -> Outcome:
        """Return whether it sees, is blind, or nobody can say; one that cannot be asked to drive does not pass."""
        return "cannot_say" if self.unasked and self.sight.outcome == "sees" else self.sight.outcome

    @property
    def because(self) -> str:
        """Return in words what decided the outcome."""
        if self.outcome == self.sight.outcome:
            return self.sight.because
        if self.unasked.startswith("exception: not asked"):
            return f"it sees drawn pictures, and no call was left for the prompt 'baseline': {self.sight.because}"
        return f"it sees drawn pictures, and the prompt 'baseline' cannot be asked: {self.unasked}"

    @property
    def exit_code(self) -> int:
        """Return 0 where it sees, 1 where it is blind, 2 where nobody can say."""
        codes: dict[Outcome, int] = {"sees": 0, "blind": 1, "cannot_say": 2}
        return codes[self.outcome]

    def scores(self) -> dict[str, Statistic]:
        """Return how often it was right: in all questions, by kind, and in words that were sent for the first time."""
        kinds: dict[str, Statistic] = {kind: self.sight.score(kind) for kind in CHOICES}
        return {"all questions": self.sight.score(), **kinds, "words never sent before": self.sight.score(fresh=True)}

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        same, of = self.sight.same
        return {
            **picked(self, "model=mode.spec outcome because causes sight.p"),
            "bound": self.sight.bound().as_dict(),
            "scores": plain(self.scores()),
            "says_no_picture": self.sight.says_none,
            "without_a_picture": [reply.text for _, reply in self.sight.bare],
            "image_tokens": self.sight.image_tokens,
            "acuity": {
                "smallest_px": self.acuity.smallest,
                "by_gap": [dict(zip(("gap_px", "right", "of"), one, strict=True)) for one in self.acuity.by_gap],
            },
            "same_reply": {"same": same, "of": of},
            "schema": picked(self, "binds=schema_binds because=schema_says"),
            "budget": picked(self, "enough=budget_enough because=budget_says"),
            "cache": picked(self.sight, "by_words=cached_by_words repeats_at_once=sudden"),
            "replies": [
                picked(one, "question.kind right=question.answer said")
                | {"text": one.reply.text[:500]}
                | picked(one, "reply.error reply.seconds")
                for one in self.sight.shots
            ],
            **picked(self, "spent facts notes mode seed"),
        }


def doctor(
    mode: RequestMode,
    *,
    seed: int = 0,
    **how: Unpack[Asking],
) -> Diagnosis:
    """Ask a model at most 28 questions and return the diagnosis; raises SpecError where it cannot be opened.

    ``seed`` deals the pictures. With ``max_cost`` (US dollars) it ends before it would be passed.
    """
    asker = Asker(mode, most=MOST_CALLS, **how)
    return in_own_loop(_examine(asker, seed))


async def _examine(asker: Asker, seed: int) -> Diagnosis:
    facts = await asker.facts()
    try:
        sight = await look(asker, seed, spare=2 + OF_ACUITY)
        sample, answer = default_sample(), Reply(error="exception", error_detail="not asked")
        binds, schema_says = None, "not asked"
        if len(sight.shots) > 2:
            with contextlib.suppress(LimitReachedError):
                answer = await asker.ask(sample.query(seed))
                if is_served(asker.mode):
                    binds, schema_says = await schema_binds(asker, asker.mode)
                else:
                    schema_says = "this adapter binds no schema"
        detail = await acuity(asker, seed) if sight.outcome == "sees" else NOT_ASKED
    finally:
        await asker.close()
    enough, budget_says = _budget(sight, sample, answer, asker.mode)
    return Diagnosis(
        mode=asker.mode,
        seed=seed,
        sight=sight,
        causes=likely_causes(sight, asker.mode, facts),
        schema_binds=binds,
        schema_says=schema_says,
        budget_enough=enough,
        budget_says=budget_says,
        spent=asker.spent,
        facts=facts,
        notes=tuple(asker.notes),
        acuity=detail,
        unasked="" if answer.error is None else f"{answer.error}: {answer.error_detail}",
    )


def _budget(sight: Sight, sample: Sample, answer: Reply, mode: RequestMode) -> tuple[bool | None, str]:
    """Return whether replies had room to end, the prompt 'baseline' among them, and the longest of them in words."""
    came = [reply for reply in (*sight.replies, answer) if reply.error is None]
    if not came:
        return None, "no reply came"
    cut = sum(map(is_cut, came))
    if cut:
        return False, f"{cut} of {len(came)} replies were cut off at {mode.max_tokens} tokens"
    tokens = [reply.completion_tokens for reply in came if reply.completion_tokens is not None]
    longest = f"the longest took {max(tokens)} of {mode.max_tokens}" if tokens else "none tells its tokens"
    if answer.error is not None:
        return None, f"{len(came)} replies complete, {longest}; no driving prompt asked"
    decision = "" if sample.decided(answer) else "; that to the prompt 'baseline' holds no decision that can be read"
    return True, f"{len(came)} replies complete, {longest}{decision}"
