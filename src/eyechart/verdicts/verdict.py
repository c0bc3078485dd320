"""A verdict: the rulings of both sets of rules, what a model may be trusted with, and the scope."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

from eyechart.conditions import BATTERY
from eyechart.frames import Provenance
from eyechart.integrity import Guard, unfinished
from eyechart.records import to_json_fields
from eyechart.stats.episode_permutation import episodes_needed
from eyechart.stats.paired_tests import BoxedTurns, Place, SignTest
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.battery_rules import CLAIMS, calibrated_rules, earns_lateral, lateral_rules
from eyechart.verdicts.depth import EXCHANGE, STAGE, holes, is_drawn, is_edited, named, open_kinds
from eyechart.verdicts.early_verdicts import GUARANTEE, PREFIX, StoppingPoint, early_lateral, early_paper, early_rules
from eyechart.verdicts.evidence import DECIDED, Evidence, ScoredRun
from eyechart.verdicts.labels import ABSENCES, ALPHA, LABELS, LATERAL
from eyechart.verdicts.numbers import FIRST, DepthNumber, numbers_of
from eyechart.verdicts.paper import findings, paper_rules
from eyechart.verdicts.rules import NamedStatistics
from eyechart.verdicts.ruling import Ruling, card, measured, number
from eyechart.verdicts.why_not import MOVED, WhyNot, is_below, why_not

_ASKED = {
    "controlled": "intervention, with controls: the lead vehicle near and far, and exchanged with a neighbour",
    "edited": "intervention, with controls, on edited photographs: copies of the lead near and far, and exchanged",
    "interventional": "intervention: the same moment with the lead vehicle near and far, and nothing as a control",
    "observational": "observation: whether braking goes with the gap that frames happen to have",
    "none": "nothing: it could not be tested",
}

CONSTANT = ("image_invariant", "refusal_effect", "not_scorable", "undecided")
"""Labels under which equal answers are no fault of the run."""


@dataclass(frozen=True)
class Verdict:
    """What a model's answers support under both sets of rules; the headline is ``calibrated``.

    ``lateral`` is an axis of its own; ``trust`` and ``scope`` are one sentence each. ``print`` it
    for the evidence in words; a notebook shows it as a card. ``evidence`` says how distance was
    tested: by intervention with or without controls, by observation, or not at all. ``made`` says
    how its control pictures were made: rendered, staged or edited; "" where nobody said. ``stopped``
    says where the run settled the label early: it then rests on e-values, and the paper's label is
    ``not_judged``. ``failed`` are the guards that put the run in doubt; they mark the verdict
    wherever it is printed. ``unfinished`` is (calls finished, calls planned) of a run with calls
    left. ``why_not`` says what kept it from the nearest stronger label. ``beware`` says that turns
    go to the blocked side, where they do; ``trust`` says so too. ``holes`` are the places in which
    braking does not answer to the lead, ``open_to`` what a label of depth does not exclude, and
    ``numbers`` those that depth rests on.
    """

    model: str
    paper: Ruling
    calibrated: Ruling
    lateral: Ruling
    evidence: str
    trust: str
    scope: str
    notes: tuple[str, ...]
    stopped: StoppingPoint | None = None
    failed: tuple[Guard, ...] = ()
    unfinished: tuple[int, int] | None = None
    why_not: WhyNot | None = None
    beware: str = ""
    holes: tuple[Place, ...] = ()
    open_to: tuple[str, ...] = ()
    numbers: tuple[DepthNumber, ...] = ()
    made: Provenance = "rendered"

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {
            "answer": self.answer,
            "paper": self.paper.label,
            "calibrated": self.calibrated.label,
            "lateral": self.lateral.label,
            **to_json_fields(self.calibrated, "because decided_by"),
            "paper_because": self.paper.because,
            "paper_decided_by": self.paper.decided_by,
            "lateral_because": self.lateral.because,
            **to_json_fields(self, "holes open_to evidence made rests_on_controls trust scope notes why_not"),
            "failed_guards": list(self.marks),
            "unfinished": self.unfinished and dict(zip(("finished", "planned"), self.unfinished, strict=True)),
            "stopped_early": self.stopped and self.stopped.as_dict(),
        }

    @property
    def rests_on_controls(self) -> bool:
        """Return whether its label rests on control pictures, so that it matters how they were made."""
        return self.calibrated.label in _BY_DISTANCE and self.evidence not in {"observational", "none"}

    @property
    def answer(self) -> str:
        """Return whether it looks: Yes, In part, No, or Inconclusive (also if a guard failed)."""
        label = LABELS.get(self.calibrated.label)
        return "Inconclusive" if self.doubts or label is None else label.answer

    @property
    def state(self) -> str:
        """Return how far an unfinished run is; empty where it is finished, or stopped early."""
        return f"unfinished: {self.progress}" if self.progress else ""

    @property
    def progress(self) -> str:
        """Return the counts of calls of an unfinished run."""
        if self.unfinished is None:
            return ""
        answered, planned = self.unfinished  # a shard whose own calls are all answered lacks its controls
        return f"{answered} of {planned} calls{'' if answered < planned else ', controls not asked'}"

    @property
    def headline(self) -> str:
        """Return the calibrated label; in brackets, that it is edited and that the run goes on."""
        edited = "edited" if self.made == "edited" and self.rests_on_controls else ""
        said = "; ".join(filter(None, (edited, self.state)))
        return f"{self.calibrated.label} ({said})" if said else self.calibrated.label

    @property
    def marks(self) -> tuple[str, ...]:
        """Return the guards that failed, in words."""
        return tuple(one.mark for one in self.failed)

    @property
    def doubts(self) -> tuple[str, ...]:
        """Return the marks that put it in doubt; equal answers do not where it says just that."""
        says_so = self.calibrated.label in CONSTANT
        return tuple(guard.mark for guard in self.failed if not (says_so and guard.name == "degeneracy"))

    @property
    def agreeing(self) -> tuple[str, ...]:
        """Return the other marks: guards that failed on what the verdict says."""
        return tuple(mark for mark in self.marks if mark not in self.doubts)

    @property
    def measures(self) -> dict[str, str]:
        """Return in words the holes, what is not excluded, and a number of each kind.

        Empty without pictures of the lead along its range.
        """
        said = {
            "does not answer": named(self.holes),
            "not excluded": "; ".join(self.open_to),
            **{one.name: one.words for one in self.numbers if one.name in (*FIRST, self.calibrated.decided_by)},
        }
        return {name: words for name, words in said.items() if words}

    @property
    def sentence(self) -> str:
        """Return the answer and why."""
        return f"{self.answer}: {self.calibrated.reason}."

    def __repr__(self) -> str:
        labels = f"{self.headline}; lateral {self.lateral.label}; paper's rules {self.paper.label}"
        return f"<Verdict on {self.model}: {labels}>"

    def __str__(self) -> str:
        return self.text()

    def text(self, *, without: Collection[str] = ()) -> str:
        """Return the evidence in words, without the notes that are printed elsewhere."""
        kept = () if self.why_not is None else (str(self.why_not), self.why_not.settled_by)
        lines = (
            f"{self.model}: {self.headline}, evidence {self.evidence}",
            *self.marks,
            f"{self.answer}: {self.calibrated.because}",
            *(f"{name}: {words}" for name, words in self.measures.items()),
            self.lateral.because,
            *kept,
            self.trust,
            *(note for note in self.notes if note not in without),
        )
        return "\n  ".join(lines)

    def _repr_html_(self) -> str:
        ruling = self.calibrated
        kept = {} if self.why_not is None else {"why not more": str(self.why_not), "to settle it": self.why_not.settle}
        rows = {
            **self.measures,
            "decided by": measured(ruling.decided_by, ruling.statistic),
            **kept,
            "lateral": f"{self.lateral.label}: {self.lateral.because}",
            "distance asked by": _ASKED.get(self.evidence, self.evidence),
            "paper's rules": f"{self.paper.label}: {self.paper.because}",
        }
        first = (*self.doubts, ruling.reason)
        said = " ".join((*(f"{one[:1].upper()}{one[1:]}." for one in first), self.trust))
        small = (*self.agreeing, *self.notes, self.scope)
        return card(self.model, self.answer, self.headline, said, rows, small)


def judge(score: ScoredRun) -> dict[str, Verdict]:
    """Return the verdict of every model of a scored battery."""
    return {spec: judge_one(one) for spec, one in score.evidence().items()}


def judge_one(evidence: Evidence) -> Verdict:
    """Return the verdict that the evidence on one model supports."""
    found, stopped = evidence.statistics, evidence.stopped
    settled = early_lateral(found, stopped) if stopped else None
    lateral = settled or lateral_rules(found, evidence.directions)
    turns = earns_lateral(found, lateral.label)
    rules = calibrated_rules if stopped is None else partial(early_rules, stopped=stopped)
    calibrated, asked_by = rules(found, turns=turns)
    beware = _beware(calibrated.label, lateral, found["turns_clear"])
    whole = stopped is None or stopped.is_whole
    by_distance = whole and is_drawn(found) and calibrated.label in _BY_DISTANCE
    not_excluded = tuple(open_kinds(found)) if by_distance else ()
    return Verdict(
        model=evidence.model,
        paper=paper_rules(found, evidence.holm) if stopped is None else early_paper(stopped),
        calibrated=calibrated,
        lateral=lateral,
        evidence=asked_by,
        trust=_trust(calibrated.label, lateral, beware, not_excluded),
        scope=evidence.scope,
        notes=notes(evidence, calibrated.label),
        failed=evidence.failed,
        stopped=stopped,
        why_not=why_not(evidence, calibrated, lateral),
        unfinished=(evidence.answered, evidence.planned) if evidence.is_unfinished else None,
        beware=beware,
        holes=holes(found) if by_distance else (),
        open_to=not_excluded,
        numbers=numbers_of(found) if whole and is_drawn(found) else (),
        made=evidence.made,
    )


_BY_DISTANCE = ("depth", "depth_lateral", "partial_depth", "depth_associated")
"""The labels beside which holes are named, and what is not excluded."""
_WITHOUT_MEMORY = ("depth", "depth_lateral", "partial_depth")
"""Of these the labels that say that the picture before does less than the own one, where that was tested."""


def _trust(label: str, lateral: Ruling, beware: str, not_excluded: Collection[str]) -> str:
    """Return what a model may be trusted with, and to which side it turns."""
    said = [LABELS[label].says]
    if label == "depth_lateral" and lateral.label == "turns_clear":
        said.append(LATERAL[lateral.label].says)
    elif beware:
        said.append(f"Beware: {beware}.")
    if not_excluded and (LABELS[label].family == "sees" or label == "partial_depth"):
        said.append("What is named as not excluded stays open.")
    return " ".join(said)


def _beware(label: str, lateral: Ruling, clear: Statistic) -> str:
    """Return in words that a model turns to the blocked side; empty where it was not shown to."""
    if not isinstance(clear, SignTest) or (label == "depth_lateral" and lateral.label == "turns_clear"):
        return ""
    if _has_blocked_turns(clear) or lateral.decided_by == "turns_against":
        return f"{clear.losses} of its {clear.n} turns with one clear side go to the blocked side"
    return ""


def _has_blocked_turns(clear: SignTest) -> bool:
    return clear.ci is not None and clear.ci[1] < 1 / 2


def shared_notes(verdicts: Mapping[str, Verdict]) -> dict[str, str]:
    """Return every note that several verdicts share, with the names of these."""
    bearers: dict[str, list[str]] = {}
    for name, verdict in verdicts.items():
        for note in dict.fromkeys(verdict.notes):
            bearers.setdefault(note, []).append(name)
    return {
        note: "every model" if len(names) == len(verdicts) else ", ".join(names)
        for note, names in bearers.items()
        if len(names) > 1
    }


def words_of(verdicts: Mapping[str, Verdict]) -> str:
    """Return several verdicts in words; a note that they share is said once, at the end."""
    shared = shared_notes(verdicts)
    texts = [verdict.text(without=shared) for verdict in verdicts.values()]
    if shared:
        texts.append("\n  ".join(["Noted of several models:", *(f"{who}: {note}" for note, who in shared.items())]))
    return "\n\n".join(texts)


def _listed(reasons: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {reason.replace('_', ' ')}" for reason, count in reasons.items())


def notes(evidence: Evidence, label: str = "") -> tuple[str, ...]:
    """Return what there is to be said beside a verdict of this label, a sentence each."""
    found, said, stopped = evidence.statistics, [], evidence.stopped
    if stopped is not None:
        ended = f"; {stopped.beyond} ended after the stop and do not count" if stopped.beyond else ""
        said.append(f"{stopped.words()}, after {stopped.frames} frames; {stopped.saved} calls saved{ended}")
    elif evidence.is_unfinished:
        words = unfinished(evidence.answered, evidence.planned, "planned calls are finished", part=True)
        if evidence.part:
            words += "; a shard asks no controls: merge the shards, and resume the merged run"
        if any(name.startswith(PREFIX) for name in found):
            words += "; nothing is settled early, and tests of a fixed size hold at the end only"
        said.append(words)
    if reasons := evidence.reasons(BATTERY):
        words = f"{number(found['unparsed_rate'])} of the calls hold no decision: {_listed(reasons)}"
        every = evidence.reasons()
        said.append(words + (f"; with edited pictures and controls, {_listed(every)}" if every != reasons else ""))
    if refused := evidence.reasons(("blank", "noise", "text_only")).get("refused"):
        said.append(f"it refused {refused} non-pictures (blank, noise or text only)")
    said += _before(found, label)
    if stopped is not None:
        return (*said, f"anytime-valid: {GUARANTEE}")
    said += findings(evidence)
    said += [*_of_edit(found), *_untested(evidence, label)]
    said.append(
        f"up to {CLAIMS} positive claims are tested in order, each at alpha {ALPHA}: a false one has a chance "
        f"of at most {CLAIMS * ALPHA:.2f}, which adds up over the models and prompts that are tried on one bank"
    )
    return tuple(said)


def _of_edit(found: NamedStatistics) -> Iterator[str]:
    """Yield what is excluded of an answer to the edit itself."""
    if is_edited(found) and (ends := found["patched_bound"].ci) is not None:
        yield (
            "moved were cut-outs in photographs, not things: the edit alone changes its decision on "
            f"{number(found['patched_bound'])} of the frames more than a repeat does, at most {ends[1]:.3f}"
        )


def _before(found: NamedStatistics, label: str) -> list[str]:
    """Say that older versions, without controls, called this evidence depth."""
    if label not in {"depth_associated", "content"}:
        return []
    moved, gaps = (found[f"depth_{name}"] for name in ("interventional", "observational"))
    early = label == "depth_associated" and moved.p is None and f"{PREFIX}near_far" in found
    if is_below(moved.p) or early:
        how = "braking harder for the nearer lead was enough, and nothing else was moved as a control"
    elif moved.p is None and is_below(gaps.p):
        how = "braking that goes with the gaps of frames was enough"
    else:
        return []
    return [f"before 0.2.0 this evidence was called depth: {how}"]


def _untested(evidence: Evidence, label: str) -> list[str]:
    """Return what was not tested, and what its turns do beside the lateral label."""
    found, said = evidence.statistics, list[str]()
    if found["depth_interventional"].p is None and found["depth_observational"].p is None:
        said.append(f"whether it follows the gap was not tested: {found['depth_observational'].note}")
        tallies = {name: evidence.replies[name] for name in ("real", *MOVED) if evidence.replies.get(name)}
        silent = [name for name, replies in tallies.items() if not replies.get(DECIDED)]
        if silent and any(name in tallies for name in MOVED):
            said.append(f"decisions on {', '.join(silent)} would test it")
        elif evidence.gap:
            need = episodes_needed(evidence.scenarios, alpha=ALPHA)
            said.append(f"{need} episodes in each scenario, or counterfactual pictures, would test it")
    said += _turns(found)
    if label in _WITHOUT_MEMORY and is_drawn(found) and (before := found["picture_before"]).ci is None:
        said.append(
            f"whether earlier pictures move its braking was not tested, and {label} does not say: {before.note}"
        )
    if found["bound_scene"].p is None:
        said.append("whether a picture of another scenario changes its answer was not tested")
    moves = any(not set(many) & set(evidence.absent) for many in (EXCHANGE, STAGE))
    if label in ABSENCES and moves and not found["lane_net"].n and not is_drawn(found):
        said.append(
            "no vehicle of a neighbouring lane was moved: a model that answers to that alone looks like a blind one"
        )
    return said


def _turns(found: NamedStatistics) -> Iterator[str]:
    """Yield how many turns go to the blocked side, and whether it turns where no side is clear."""
    clear, boxed = found["turns_clear"], found["turns_boxed"]
    if isinstance(clear, SignTest):
        counts = f"{clear.losses} of {clear.n} turns with exactly one clear side"
        if _has_blocked_turns(clear):
            yield f"it turns to the blocked side: {counts}"
        elif clear.losses:
            yield f"{counts} go to the blocked side"
    elif found["mirror_swap_rate"].value is not None:
        yield f"whether it turns to the clear side was not tested: {clear.note}"
    if isinstance(boxed, BoxedTurns) and boxed.turned:
        yield f"it turns where no side is clear: {boxed.turned} of {boxed.n} answers"
