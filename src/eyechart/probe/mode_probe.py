"""The probe: finds a model's best request mode by calls, and pins it with the measurements.

It trusts no claim of a server. It contradicts a schema, repeats a seed, raises a token budget until
replies are complete, and leaves a picture out to count its tokens.
"""

import datetime as dt
import statistics
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Unpack

from eyechart.calls import BLOCKED, REFUSED, Emptiness, Reply, is_cut
from eyechart.errors import EyechartError
from eyechart.event_loops import in_own_loop
from eyechart.limits import Usage
from eyechart.modes import ALONE, ModeMeasurements, RequestMode
from eyechart.probe.arrival import MOST_CALLS as OF_ARRIVAL
from eyechart.probe.arrival import apart, arrives, dropped, form_of, repeats, reuses
from eyechart.probe.asker import Asker, LimitReachedError, ProbeOptions
from eyechart.probe.causes import likely_causes
from eyechart.probe.picture_proof import SightAnswers, look
from eyechart.probe.sample import Sample, default_sample, is_served, json_binds, plain, schema_binds
from eyechart.records import to_json_fields
from eyechart.seeds import key_seed

MOST_CALLS = 60 + OF_ARRIVAL
MOST_TOKENS = 16_384
"""The largest token budget: a model that needs more is not pinned."""
MARGIN = 2
"""The ratio of the pinned budget to the longest complete reply."""

_FIRST_TOKENS = 64
_GROWTH = 4
_SAMPLES = 5
_LEAST_TOKENS = 256
"""The smallest pinned budget: a reply "I see no picture" may be longer than an action."""
_SENTENCE = "Write one sentence of about ten words about anything you like."


class ProbeError(EyechartError):
    """A model cannot be probed; ``spent`` counts the calls so far, ``limit``: a limit ended it."""

    def __init__(self, words: str, spent: Usage, *, limit: bool = False) -> None:
        super().__init__(words)
        self.spent, self.limit = spent, limit


@dataclass(frozen=True)
class ProbeResult:
    """A model's pinned mode with its measurements, its sight, likely causes and notes."""

    mode: RequestMode
    sight: SightAnswers
    causes: tuple[str, ...]
    notes: tuple[str, ...]
    spent: Usage

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return to_json_fields(self.sight, "outcome because") | to_json_fields(self, "mode causes notes spent")

    @property
    def measured(self) -> ModeMeasurements:
        """Return the measurements of the pinned mode."""
        assert self.mode.measured is not None
        return self.mode.measured


def probe(
    mode: RequestMode,
    *,
    fixed: Collection[str] = (),
    sample: Sample | None = None,
    seed: int = 0,
    sight: SightAnswers | None = None,
    **how: Unpack[ProbeOptions],
) -> ProbeResult:
    """Find a model's best request mode, starting with ``mode``; fields in ``fixed`` do not change.

    ``sample`` is a sample of the run's calls. It decides the token budget, the cost of a call, and
    the structured output, which is pinned only if it binds and the prompt asks for JSON. ``sight``
    is a doctor's result for this seed; its pictures are then not shown again. ``max_cost`` is in US
    dollars. ``spend`` gets the total spent before and after each call. Raises ProbeError, with the
    total spent, where no mode can be pinned, and SpecError where the model cannot be opened.
    """
    asker = Asker(mode, most=MOST_CALLS, fixed=fixed, **how)
    return in_own_loop(_Probe(asker, sample or default_sample(), fixed, seed, sight).find())


@dataclass
class _Probe:
    """The steps of one probe, in order."""

    asker: Asker
    sample: Sample
    fixed: Collection[str]
    seed: int
    sight: SightAnswers | None = None
    notes: list[str] = field(default_factory=list)

    async def find(self) -> ProbeResult:
        asker = self.asker
        try:
            facts = await asker.facts()
            return await self._find(facts)
        except LimitReachedError as limit:
            raise ProbeError(
                f"the probe of {asker.mode.spec} was not finished: {limit}", asker.spent, limit=True
            ) from None
        finally:
            await asker.close()

    async def _find(self, facts: dict[str, str]) -> ProbeResult:
        asker = self.asker
        if "max_tokens" not in self.fixed:
            asker.mode = replace(asker.mode, max_tokens=_FIRST_TOKENS)
        await self._first_answer(facts)
        binds = await self._structure()
        *came, bare = await self._samples()
        empty = Emptiness.of(came)
        if empty.is_whole:
            raise ProbeError(empty.words, asker.spent)
        self.notes += [empty.words] if empty.empty else []
        pinned = self._budget([*came, bare])
        roomy = asker.mode = replace(pinned, max_tokens=max(pinned.max_tokens, self._room()))
        matters = await self._draws(roomy, came[0].text)
        ignored = await self._unknown_field(roomy)
        sight = await self._look()
        alone = await self._require_arrival(sight, came, bare)
        changed = {
            name: getattr(asker.mode, name) for name in ("token_field", "temperature", "seed", "system", "stream")
        }
        pinned = replace(pinned, **changed)
        if matters[1] and pinned.temperature != 0 and "seed" not in self.fixed:
            pinned = replace(pinned, seed=True)
        causes = likely_causes(sight, pinned, facts)
        measured = replace(
            measured_of(came, bare),
            calls=asker.spent.calls,
            sees_image={"sees": True, "blind": False, "cannot_say": None}[sight.outcome],
            schema_binds=binds,
            temperature_matters=matters[0],
            seed_matters=matters[1],
            unknown_fields_ignored=ignored,
            facts={**names_of(facts, came, sight, causes), **alone, "seed of the pictures": str(self.seed)},
        )
        notes = (*asker.notes, *self.notes)
        return ProbeResult(replace(pinned, measured=measured), sight, causes, notes, asker.spent)

    async def _require_arrival(self, sight: SightAnswers, came: Sequence[Reply], bare: Reply) -> dict[str, str]:
        """Return the count of equal single repeats as a fact, for a model that sees.

        Raises ProbeError if its pictures do not arrive, or if a cache answers for another picture.
        """
        form = form_of(self.sample)
        if form is None or not is_served(self.asker.mode):
            return {}
        fault = None
        if sight.outcome == "blind":
            fault = await reuses(self.asker, sight, self.seed)
        elif sight.outcome == "sees":
            fault = dropped(sight, came, bare, form) or await arrives(self.asker, sight, self.sample, self.seed)
            if fault is None:
                fault, note = await apart(self.asker, sight, self.sample, self.seed)
                self.notes += [note] if note else []
        if fault is not None:
            words = f"guard '{fault.guard}' fails: {fault.because}, and probe again; --no-probe runs without a probe"
            raise ProbeError(words, self.asker.spent)
        same = await repeats(self.asker, sight, self.sample) if sight.outcome == "sees" else ""
        return {ALONE: same} if same else {}

    async def _first_answer(self, facts: dict[str, str]) -> None:
        """Raise the budget until a reply to the sample is complete, or raise ProbeError."""
        reply = await self.asker.ask(self.sample.query(0))
        for _ in self.sample.questions[1:]:
            if not _is_blocked(reply):
                break
            first, *others = self.sample.questions
            self.sample = replace(self.sample, questions=[*others, first])
            reply = await self.asker.ask(self.sample.query(0))
        while is_cut(reply):
            self._grow(reply)
            reply = await self.asker.ask(self.sample.query(0))
        if reply.error is not None:
            sight = await self._look()
            why = "; ".join(likely_causes(sight, self.asker.mode, facts)) or f"{reply.error}: {reply.error_detail}"
            raise ProbeError(why, self.asker.spent)

    async def _look(self) -> SightAnswers:
        """Show the drawn pictures, once; raises LimitReachedError where a limit ends that early."""
        sight = self.sight or await look(self.asker, self.seed)
        if sight.cut is not None:
            raise LimitReachedError(sight.cut)
        return sight

    def _grow(self, reply: Reply) -> None:
        budget = self.asker.mode.max_tokens
        spec = self.asker.mode.spec
        if "max_tokens" in self.fixed:
            raise ProbeError(
                f"replies of {spec} are cut off at {budget} tokens: raise --max-tokens, or leave it out, and the probe "
                "finds the budget",
                self.asker.spent,
            )
        if budget >= MOST_TOKENS:
            thinks = "; it thinks: switch that off, or give --max-tokens" if reply.reasoning else ""
            raise ProbeError(f"replies of {spec} are cut off even at {budget} tokens{thinks}", self.asker.spent)
        self.asker.mode = replace(self.asker.mode, max_tokens=min(MOST_TOKENS, budget * _GROWTH))

    def _room(self) -> int:
        """Return a token budget for questions other than the sample's."""
        now = self.asker.mode.max_tokens
        return now if "max_tokens" in self.fixed else min(MOST_TOKENS, max(now, 512))

    async def _structure(self) -> bool | None:
        """Return whether a schema binds; if the prompt asks for JSON, pin it, or else JSON mode."""
        asker = self.asker
        if not is_served(self.asker.mode):
            return None
        roomy = replace(asker.mode, max_tokens=self._room())
        binds, says = await schema_binds(asker, roomy)
        if "structured" in self.fixed:
            if asker.mode.structured == "json_schema" and not binds:
                self.notes.append(f"the mode has a schema, but the probe did not see it bind: {says}")
            return binds
        if self.sample.wants_json:
            if binds:
                asker.mode = replace(asker.mode, structured="json_schema")
            elif (await json_binds(asker, roomy))[0]:
                asker.mode = replace(asker.mode, structured="json_object")
        elif binds:
            self.notes.append(
                "a schema binds; the prompt asks for no JSON, so none is pinned (--json-mode json_schema)"
            )
        return binds

    async def _samples(self) -> list[Reply]:
        """Return complete replies to the run's own questions; the last one is without its picture.

        The budget grows until none is cut off. A picture that a filter blocks is left out.
        """
        came: list[Reply] = []
        left = list(range(max(_SAMPLES, len(self.sample.questions))))
        while len(came) <= len(left):
            number = left[len(came)] if len(came) < len(left) else None
            query = self.sample.query(0, picture=False) if number is None else self.sample.query(number)
            reply = await self.asker.ask(query)
            if number is not None and _is_blocked(reply) and len(left) > 1:
                left.remove(number)
                continue
            if reply.error is not None and query.image is not None:  # some endpoints need a picture
                words = f"a call of the probe failed with {reply.error}: {reply.error_detail}"
                raise ProbeError(words, self.asker.spent)
            came.append(reply)
            if is_cut(reply):
                self._grow(reply)
                came = []
        return came

    def _budget(self, came: Sequence[Reply]) -> RequestMode:
        """Return the mode with its budget: `MARGIN` times the longest reply, in steps of 64."""
        mode = self.asker.mode
        if "max_tokens" in self.fixed:
            return mode
        tokens = [reply.completion_tokens for reply in came if reply.completion_tokens is not None]
        longest = max(tokens) if tokens else mode.max_tokens
        if longest > mode.max_tokens:
            self.notes.append(f"the server ignores the budget: a reply has {longest} tokens of {mode.max_tokens}")
        return replace(mode, max_tokens=max(_LEAST_TOKENS, -(-MARGIN * longest // 64) * 64))

    async def _draws(self, roomy: RequestMode, usual: str) -> tuple[bool | None, bool | None]:
        """Return whether the temperature and the seed matter: both are varied, on a free sentence.

        If the model gives its ``usual`` reply to that too, the result for the temperature is None.
        """
        one, other = (plain(_SENTENCE, key_seed("sentence", number)) for number in (1, 2))
        free, served = replace(roomy, structured="none"), is_served(self.asker.mode)
        high = free if free.temperature is None else replace(free, temperature=1.0)
        drawn = [await self.asker.ask(query, replace(high, seed=served)) for query in (one, one, other)]
        seed_refused = any(reply.error in REFUSED for reply in drawn) and served
        if seed_refused:
            drawn = [await self.asker.ask(query, high) for query in (one, other)]
        seed = None if not served else False if seed_refused else _seed_matters(drawn)
        if free.temperature is None:
            return None, seed
        low = [await self.asker.ask(query, replace(free, temperature=0.0)) for query in (one, other)]
        says_one_thing = {reply.text for reply in (*low, *drawn)} == {usual}
        return None if says_one_thing else _temperature_matters(low, drawn), seed

    async def _unknown_field(self, roomy: RequestMode) -> bool | None:
        """Return whether the server ignores an unknown field; False if it refuses the field."""
        if not is_served(self.asker.mode):
            return None
        extended = replace(roomy, structured="none", body={**roomy.body, "eyechart_unknown": True})
        reply = await self.asker.ask(plain(_SENTENCE, key_seed("unknown")), extended)
        return True if reply.error is None else False if reply.error in REFUSED else None


def _is_blocked(reply: Reply) -> bool:
    """Return whether a filter may have removed the answer: a well-formed reply without one."""
    return reply.error == "unreadable" and reply.finish_reason == BLOCKED


def _seed_matters(drawn: Sequence[Reply]) -> bool | None:
    """Return whether equal seeds give equal replies; None if others do too, or a call failed."""
    if any(reply.error is not None for reply in drawn) or len({reply.text for reply in drawn}) == 1:
        return None
    return drawn[0].text == drawn[1].text


def _temperature_matters(low: Sequence[Reply], high: Sequence[Reply]) -> bool | None:
    """Return whether replies at temperature 0 are equal and at 1 differ; None on a failure."""
    if any(reply.error is not None for reply in (*low, *high)):
        return None
    return len({reply.text for reply in low}) == 1 < len({reply.text for reply in high})


def measured_of(came: Sequence[Reply], bare: Reply) -> ModeMeasurements:
    """Return the tokens and seconds of complete replies, and the tokens of the picture."""

    def known(name: str) -> list[float]:
        return [value for reply in came if (value := getattr(reply, name)) is not None]

    shown, tokens, thought, seconds = map(known, ("prompt_tokens", "completion_tokens", "reasoning_tokens", "seconds"))
    adds = None
    if shown and bare.prompt_tokens is not None and bare.error is None:
        adds = max(0, round(statistics.median(shown)) - bare.prompt_tokens)
    return ModeMeasurements(
        date=dt.datetime.now(dt.UTC).date().isoformat(),
        image_tokens=adds,
        prompt_tokens=round(statistics.median(shown)) if shown else None,
        completion_tokens=statistics.fmean(tokens) if tokens else None,
        completion_tokens_max=round(max(tokens)) if tokens else None,
        reasoning_tokens=statistics.fmean(thought) if thought else None,
        seconds=round(statistics.median(seconds), 4) if seconds else None,
        seconds_min=round(min(seconds), 4) if seconds else None,
    )


def names_of(
    facts: dict[str, str], came: Sequence[Reply], sight: SightAnswers, causes: Sequence[str]
) -> dict[str, str]:
    """Return the facts that name the model, and the result of its pictures in words."""
    found = {name: text for name, text in facts.items() if name not in {"template", "warning"}}
    for name in ("served", "provider"):
        values = sorted({value for reply in came if (value := getattr(reply, name)) is not None})
        found |= {name: ", ".join(values)} if values else {}
    return {**found, "picture": causes[0] if sight.outcome == "blind" and causes else sight.because}
