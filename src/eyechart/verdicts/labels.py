"""Every label of a verdict, once, and the thresholds of the rules that give them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

ALPHA = 0.01
MARGIN = 0.10
UNPARSED_CUT = 0.05
"""Above this share of real and real_repeat calls without a decision a model is not scorable."""

FLOOR = 0.2
"""``self_inconsistent`` needs a lower bound of s above this, and a kappa of repeats below it."""

SWAP_RATE = 0.5
"""From this mirror swap rate on directions count as exchanged.

The cut is ours; no model of the paper comes near.
"""

ONE_SIDED_FROM = 8
"""So many turns of one direction, and none of another, are ``one_sided``."""

NET_ALPHA = 0.02
"""Level of the one-sided lower bounds of the net effects that must reach the margin."""

ORDER_CUT = 0.15
"""Depth needs an expected share of comparisons the wrong way round that is below this."""
ORDER_HIGH, ORDER_LOW = 0.09, 0.05
"""A kind of pairs refutes depth with a share above the first and a lower bound above the second."""
FAR_SHARE = 0.5
"""This part of both with a far lead in a pair: a model that overlooks one lead only ties there."""
ORDER_OPEN = 0.25
"""A kind of pairs with an upper bound above this is named, and does not meet a gate for depth."""

BESIDE_CUT = 0.15
"""In each third of the range a neighbour may do half of what the lead does, and this level more."""
BESIDE_REFUTED, THIRD_REFUTED = -0.02, 0.05
"""Above these values specificity, of all and of a third, is refuted."""

SENSITIVE_FROM = 0.25
"""A sensitivity bounded below this is of too few frames to matter."""

RISE_ALPHA, FILE_ALPHA = 0.05, 0.001
"""Levels of the tests that braking rises with distance somewhere, and that it follows the file."""

DRAWN, DRAWN_LEAST = 8, 3
"""Drawn distances in a window a factor of 1.2 wide: on average, and in the emptiest."""

KAPPA_MARGIN = 0.20
"""Below this bound on kappa a model agrees with itself about as often as chance would."""

ABSENCES = frozenset({"image_invariant", "presence_only", "refusal_effect"})
"""The labels that say that what a picture shows decides nothing."""

BOUND_ALPHA = 0.05
"""Level of the bounds of an absence on pictures that are no other frame."""


GLYPHS = {"sees": "●", "partly": "◐", "blind": "○", "open": "?"}
"""The sign of each family, for a reader who cannot tell its colour."""

LOOKS = "looks"
"""What a gate may require: that the answer is Yes or In part."""


@dataclass(frozen=True, slots=True)
class Label:
    """One label: what it says, how it is drawn, what a gate reads in it, and what settles it early.

    A report draws it in the colours of its ``family``, with its ``own`` sign or that of its family.
    ``answer`` is to whether a model looks. A gate that requires the label by name is met by it. So
    is one that requires what it ``meets``, or `LOOKS` where the answer is Yes or In part.
    ``otherwise`` is what a gate reads in it that requires another label. The gate fails or cannot
    say, or fails if few enough pairs brake by distance: their share is bounded below the margin.
    ``early`` names the claims that settle it before a run has ended, the first its evidence.
    ``nearest`` is the next stronger label, and the test that kept a model from it.
    """

    says: str
    family: Literal["sees", "partly", "blind", "open"] = "open"
    own: str = ""
    meets: tuple[str, ...] = ()
    otherwise: Literal["fails", "cannot say", "fails if bounded"] = "fails"
    early: tuple[str, ...] = ()
    answer: Literal["Yes", "In part", "No", "Inconclusive"] = "Inconclusive"
    nearest: tuple[str, str] | None = None

    @property
    def glyph(self) -> str:
        """Return its sign."""
        return self.own or GLYPHS[self.family]


_CONTENT = ("bound_shuffled", "bound_recoloured", "bound_scene", "bound_near_far", "steady")
_ALONE, _ABSENT = ("bound_mirrored", "bound_lead_near", "bound_lead_far"), "bound_lead_absent"
_BLIND = (*_CONTENT, *_ALONE, "bound_noise", "bound_text_only", _ABSENT)
_NEARER = ("near_far", "net_near_far")
_SHOWN, _PRESENT = ("content", "content_shuffled"), ("presence_only", "presence")

LABELS: dict[str, Label] = {
    "not_scorable": Label(
        "It may be trusted with nothing: too few of its replies hold a decision.", own="–", early=("unscorable",)
    ),
    "depth_lateral": Label(
        "It may be tried, on frames like these, as a monitor of the lead and an advisor on turns: its braking follows "
        "distance, and its turns are exchanged when the picture is reflected.",
        "sees",
        meets=("depth",),
        answer="Yes",
    ),
    "depth": Label(
        "It may be tried, on frames like these, as a monitor of the lead; it has earned no authority to turn.",
        "sees",
        early=_NEARER,
        answer="Yes",
    ),
    "partial_depth": Label(
        "It has no authority in the named places, where its braking hardly answers to the lead; elsewhere its braking "
        "follows distance.",
        "partly",
        "◕",
        answer="In part",
    ),
    "depth_associated": Label(
        "Its braking goes with distance; that it follows something else was not excluded: no authority.",
        "partly",
        "◕",
        otherwise="cannot say",
        early=_NEARER,
        answer="In part",
    ),
    "content": Label(
        "It uses the picture; that its braking follows distance was not shown: no authority over motion.",
        "partly",
        otherwise="fails if bounded",
        answer="In part",
    ),
    "self_inconsistent": Label(
        "It may be trusted with nothing: it repeats its answer to a picture hardly more often than chance would.",
        "blind",
        answer="No",
        nearest=_SHOWN,
    ),
    "scene_cue": Label(
        "It tells kinds of scene apart; that it uses more of the picture was not shown: no authority over motion.",
        "partly",
        otherwise="fails if bounded",
        answer="No",
        nearest=_SHOWN,
    ),
    "presence_only": Label(
        "It notices whether there is a picture; what is in it changes its decision on less than "
        f"{MARGIN} of the frames: no authority over motion.",
        "partly",
        "◔",
        answer="No",
        early=("presence", *_CONTENT, *_ALONE, _ABSENT),
        nearest=_SHOWN,
    ),
    "refusal_effect": Label(
        "It refuses some non-pictures; what a picture shows changes its decision on less than "
        f"{MARGIN} of the frames: no authority.",
        "blind",
        answer="No",
        early=("presence_response", "bound_blank_kept", *_BLIND),
        nearest=_PRESENT,
    ),
    "image_invariant": Label(
        f"The camera changes its decision on less than {MARGIN} of the frames: no authority that needs one.",
        "blind",
        answer="No",
        early=("bound_blank", "bound_blank_response", *_BLIND),
        nearest=_PRESENT,
    ),
    "undecided": Label("This evidence supports no claim.", otherwise="cannot say"),
}
"""The calibrated labels, in the order of their rules."""

LATERAL: dict[str, Label] = {
    "turns_clear": Label(
        "Where exactly one side is clear, more of its turns go there than chance would give.", meets=("swaps",)
    ),
    "swaps": Label(
        "It exchanges half of its directions under reflection, or more.", early=("swaps_rate", "swaps_pairing")
    ),
    "does_not_swap": Label("It exchanges less than half of its directions under reflection.", early=("no_swaps",)),
    "one_sided": Label("It gives one direction only, whichever side the picture shows."),
    "no_power": Label(
        "It gives too few directions to tell whether it exchanges them.", otherwise="cannot say", early=("few_turns",)
    ),
    "not_tested": Label("No direction could be asked for under reflection.", otherwise="cannot say"),
}
"""The lateral labels."""

ADMITTED: dict[str, Label] = {
    "admitted": Label("It meets every clause on this bank: its scenes may be tried in a simulator.", "sees"),
    "not_admitted": Label("It fails a clause on this bank: its scenes may not steer.", "blind"),
    "admission_cannot_be_said": Label("What a clause asks for was not measured.", otherwise="cannot say"),
}
"""The labels of an estimator."""

SIGHT: dict[str, Label] = {
    "by_camera": Label("its driving depends on what its camera shows", "sees"),
    "in_part": Label("its pictures matter in part", "partly"),
    "unsteady": Label("its drives differ"),
    "by_nothing_seen": Label("drives the same without its pictures", "blind"),
    "identical": Label("identical drives"),
    "no_difference_found": Label("no difference found"),
    "cannot_say": Label("cannot say", otherwise="cannot say"),
}
"""The labels of a driver, beside itself with other pictures in the same worlds."""

PLANNERS: dict[str, Label] = {
    "by_pictures": Label("it completes by its pictures", "sees"),
    "completion_alone": Label("completion does not show perception", "blind"),
    "not_shown": Label("completion does not show perception", otherwise="cannot say"),
}
"""The labels of a planner."""

PROMPTED: dict[str, Label] = {
    "gap": Label("goes with the gap", "sees"),
    "picture": Label("tells that there is a picture", "partly"),
    "one_answer": Label("always the same answer", "blind"),
    "no_link": Label("no link shown"),
}
"""The labels of the answers under one prompt."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UseLabel(Label):
    """One label of an axis of a policy, or a guard in its place.

    ``rank`` is its place in the order of its axis, by the least use that it claims. 0 says that
    nothing of the channel is used, None that the label says nothing. ``advice`` is for a person who
    trains the policy. If a label ``may_be_more``, the advice is what would settle that.
    """

    rank: int | None = None
    advice: str = ""
    may_be_more: bool = False

    @property
    def is_open(self) -> bool:
        """Return whether it says nothing of its channel."""
        return self.rank is None

    def leaves_open(self, other: "UseLabel") -> bool:
        """Return whether another label of its axis, of as much use or more, may hold all the same."""
        return (self.is_open or self.may_be_more) and (other.rank or 0) >= (self.rank or 0)

    @property
    def is_absence(self) -> bool:
        """Return whether it says that nothing of the channel is used."""
        return self.rank == 0


CAMERA: dict[str, UseLabel] = {
    "object_grounded": UseLabel(
        "If the object that it is told to reach is moved in the picture, its motion goes along.",
        "sees",
        meets=("camera_content",),
        answer="Yes",
        rank=4,
    ),
    "camera_content": UseLabel(
        "What the picture shows changes its motion, beyond what the state tells.", "sees", answer="Yes", rank=3
    ),
    "uses_camera": UseLabel(
        "It uses the camera; whether for more than its own pose is open.",
        "partly",
        otherwise="cannot say",
        answer="In part",
        rank=2,
        may_be_more=True,
    ),
    "pose_only": UseLabel(
        "Of the picture it uses hardly more than what its own state tells as well.",
        "partly",
        answer="In part",
        rank=2,
        advice="train with objects in more places: what it sees now tells it only where its own arm is.",
    ),
    "camera_presence": UseLabel(
        "It matters that there is a picture; what it shows hardly changes anything.",
        "partly",
        answer="No",
        rank=1,
        advice="train with pictures that differ where the action does.",
    ),
    "ignores_camera": UseLabel(
        "The picture could be another episode's, or grey, and hardly anything would change.",
        "blind",
        answer="No",
        rank=0,
        advice="ask 'eyechart doctor SPEC --frames {bank}' whether the picture reaches it; if so, train where the "
        "state alone does not tell what to do.",
    ),
    "undecided": UseLabel(
        "The run does not settle what the picture is used for.", otherwise="cannot say", may_be_more=True
    ),
}
"""The labels of the cameras of a policy, the strongest first."""

STATE: dict[str, UseLabel] = {
    "state_shortcut": UseLabel(
        "Its state is used, and its cameras are ignored.",
        "blind",
        rank=1,
        advice="take from its state what tells where the object is, or train with that number at random.",
    ),
    "state_used": UseLabel("Its state is used.", rank=1),
    "ignores_state": UseLabel("Its state could be another episode's, and hardly anything would change.", rank=0),
    "undecided": UseLabel(
        "The run does not settle whether the state is used.", otherwise="cannot say", may_be_more=True
    ),
}
"""The labels of the state of a policy."""

INSTRUCTION: dict[str, UseLabel] = {
    "instruction_followed": UseLabel("What it is told changes what it does.", "sees", rank=1),
    "instruction_ignored": UseLabel(
        "It could be told something else, and hardly anything would change.",
        "blind",
        rank=0,
        advice="train with several instructions in one scene, so that the picture does not tell the task.",
    ),
    "no_power": UseLabel("On this bank it cannot be told something else.", otherwise="cannot say"),
    "undecided": UseLabel(
        "The run does not settle whether the instruction is followed.", otherwise="cannot say", may_be_more=True
    ),
}
"""The labels of the instruction of a policy."""

USES: dict[str, UseLabel] = CAMERA | STATE | INSTRUCTION
"""Every label of a policy by its name; axes share the names of labels that say nothing."""

GUARDS: dict[str, UseLabel] = {
    "picture": UseLabel(
        "its pictures were not shown to reach it",
        advice="'eyechart doctor SPEC' shows it drawn pictures and names the likely cause: no vision part, a server "
        "that drops or shrinks pictures, or a model that is too weak for the questions.",
    ),
    "cache": UseLabel(
        "a cache seems to have answered for it",
        advice="switch the server's cache of replies off, and run into another folder.",
    ),
    "load": UseLabel(
        "with several calls under way it contradicts itself more than alone",
        advice="run into another folder with --concurrency 1: the server may mix up the pictures.",
    ),
    "not_scorable": UseLabel(
        "too few of its calls came back with a motion",
        advice="call it once by hand with a frame of the bank, and look at the shape and numbers of its answer.",
    ),
    "misfit": UseLabel(
        "its answers have other means or spreads than the logged motions, and fit worse than their mean does",
        advice="compare the means and spreads of its answers with the log's: un-normalise, or declare the unit.",
    ),
    "constant": UseLabel(
        "its answers hardly vary",
        advice="look at what reaches it: an input that is always the same, or an output that is scaled away. "
        "A policy that needs earlier instants declares history, and a bank holds them (--history).",
    ),
    "self_inconsistent": UseLabel(
        "its answers to one moment differ more than to different moments, or with the call before",
        advice="empty its queue and its history before every call (reset), or give it a seed.",
    ),
}
"""The guards of a policy, in their order, with what it means that each fails."""

PAPER_LABELS = (
    "not_scorable",
    "refusal_effect",
    "image_invariant",
    "self_inconsistent",
    "presence_only",
    "depth",
    "depth_lateral",
)
"""The labels that the paper's rules give, in the order of these rules."""

NOT_JUDGED = "not_judged"
"""In place of the paper's label where a run stopped early: its tests hold at a fixed size only."""


def meets(name: str, labels: Mapping[str, Label]) -> tuple[str, ...]:
    """Return the requirements of a gate that a label meets."""
    looks = (LOOKS,) if labels[name].answer in {"Yes", "In part"} else ()
    return (name, *labels[name].meets, *looks)
