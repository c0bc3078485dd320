"""The doctor: at most 28 calls that find whether a model sees, and whether its replies are usable.

It needs no bank. Its result holds for the request mode of the calls.
"""

import contextlib
from dataclasses import dataclass
from typing import Unpack

from eyechart.calls import Reply, is_cut
from eyechart.event_loops import in_own_loop
from eyechart.limits import Usage
from eyechart.modes import RequestMode
from eyechart.probe.acuity import MOST_CALLS as OF_ACUITY
from eyechart.probe.acuity import NOT_ASKED, Acuity, acuity
from eyechart.probe.asker import Asker, LimitReachedError, ProbeOptions
from eyechart.probe.causes import likely_causes
from eyechart.probe.picture_proof import Outcome, SightAnswers, look
from eyechart.probe.pictures import CHOICES
from eyechart.probe.sample import Sample, default_sample, is_served, schema_binds
from eyechart.records import plain, to_json_fields
from eyechart.stats.statistic import Statistic

MOST_CALLS = 20 + OF_ACUITY


@dataclass(frozen=True)
class Diagnosis:
    """The doctor's result. ``mode`` is the final request mode; ``notes`` list the changes to it.

    ``schema_binds`` and ``budget_enough`` are None where inconclusive, with the reason in
    ``schema_says`` and ``budget_says``. ``facts`` is what is known of the model without a call.
    """

    mode: RequestMode
    seed: int
    sight: SightAnswers
    causes: tuple[str, ...]
    schema_binds: bool | None
    schema_says: str
    budget_enough: bool | None
    budget_says: str
    spent: Usage
    facts: dict[str, str]
    notes: tuple[str, ...] = ()
    acuity: Acuity = NOT_ASKED
    unasked: str = ""
    """Why the call with the driving prompt failed; empty if it did not."""

    @property
    def outcome(self) -> Outcome:
        """Return "sees" (only if the driving prompt works too), "blind", or "cannot_say"."""
        return "cannot_say" if self.unasked and self.sight.outcome == "sees" else self.sight.outcome

    @property
    def because(self) -> str:
        """Return the reason for the outcome."""
        if self.outcome == self.sight.outcome:
            return self.sight.because
        if self.unasked.startswith("exception: not asked"):
            return f"it sees drawn pictures, but no call was left for the prompt 'baseline': {self.sight.because}"
        return f"it sees drawn pictures, but the call with the prompt 'baseline' fails: {self.unasked}"

    @property
    def exit_code(self) -> int:
        """Return 0 where it sees, 1 where it is blind, 2 where it is inconclusive."""
        codes: dict[Outcome, int] = {"sees": 0, "blind": 1, "cannot_say": 2}
        return codes[self.outcome]

    def scores(self) -> dict[str, Statistic]:
        """Return the shares of right answers: of all questions, of each kind, and of new words."""
        kinds: dict[str, Statistic] = {kind: self.sight.score(kind) for kind in CHOICES}
        return {"all questions": self.sight.score(), **kinds, "words never sent before": self.sight.score(fresh=True)}

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        same, of = self.sight.same
        return {
            "model": self.mode.spec,
            **to_json_fields(self, "outcome because causes spent facts notes mode seed", p=self.sight.p),
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
            "schema": {"binds": self.schema_binds, "because": self.schema_says},
            "budget": {"enough": self.budget_enough, "because": self.budget_says},
            "cache": {"by_words": self.sight.is_cached_by_words, "repeats_at_once": self.sight.is_sudden},
            "replies": [
                {"kind": shot.question.kind, "right": shot.question.answer, "said": shot.said}
                | {"text": shot.reply.text[:500], **to_json_fields(shot.reply, "error seconds")}
                for shot in self.sight.shots
            ],
        }


def doctor(
    mode: RequestMode,
    *,
    seed: int = 0,
    **how: Unpack[ProbeOptions],
) -> Diagnosis:
    """Call a model at most 28 times and return the diagnosis; raises SpecError if it does not open.

    ``seed`` draws the pictures. ``max_cost`` (US dollars) ends it early.
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


def _budget(sight: SightAnswers, sample: Sample, answer: Reply, mode: RequestMode) -> tuple[bool | None, str]:
    """Return whether the token budget sufficed, also for the prompt 'baseline', and why."""
    came = [reply for reply in (*sight.replies, answer) if reply.error is None]
    if not came:
        return None, "no reply came"
    cut = sum(map(is_cut, came))
    if cut:
        return False, f"{cut} of {len(came)} replies were cut off at {mode.max_tokens} tokens"
    tokens = [reply.completion_tokens for reply in came if reply.completion_tokens is not None]
    longest = f"the longest took {max(tokens)} of {mode.max_tokens}" if tokens else "none reports its tokens"
    if answer.error is not None:
        return None, f"{len(came)} replies complete, {longest}; none to the driving prompt"
    decision = "" if sample.is_decision(answer) else "; the one to the prompt 'baseline' holds no readable decision"
    return True, f"{len(came)} replies complete, {longest}{decision}"
