"""Statistics of controllers, written down by hand, and what is said of verdicts on them, word for word.

    python tests/by_hand.py > tests/verdict_words.json

writes down what is said today; what changed is then to be read in the difference, and meant.
"""

import json
from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import drawn
import policies_by_hand
from eyechart.conditions import RANGED
from eyechart.integrity import Guard
from eyechart.stats.agreement import SwapRate
from eyechart.stats.association import Association
from eyechart.stats.evalues import EValue
from eyechart.stats.order import Rise
from eyechart.stats.paired_tests import DiscordantPairs, Places, SignTest
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.depth import NAMES as DEPTH
from eyechart.verdicts import Evidence, StoppingPoint, judge, judge_one, shared_notes, words_of
from eyechart.verdicts.admission import hold

JUST_BELOW = 0.0099999
Found = dict[str, Statistic]

SILENT = Statistic(None, 0, note="not made")
LOW, HIGH = 0.001, 0.9

NAMES = (
    "unparsed_reference",
    "unparsed_controls",
    "depth_interventional",
    "depth_observational",
    "depth_net",
    "lane_net",
    *DEPTH,
    "repeat_over_nudged",
    "repeats_together",
    "content_shuffled",
    "content_recoloured",
    "content_lead_absent",
    "content_nudged_shuffled",
    "content_nudged_recoloured",
    "content_nudged_lead_absent",
    "self_disagreement",
    "kappa",
    "kappa_pooled",
    "bound_kappa",
    "scene_cue",
    "presence",
    "presence_response",
    "bound_content_shuffled",
    "bound_content_recoloured",
    "bound_scene",
    "bound_blank",
    "bound_mirrored",
    "bound_lead_near",
    "bound_lead_far",
    "bound_lead_absent",
    "bound_noise",
    "bound_text_only",
    "turns_clear",
    "turns_clear_within",
    "turns_against",
    "turns_boxed",
)


def p(value: float) -> Statistic:
    """Return a test with this p."""
    return Statistic(0.5, 144, p=value)


def share(value: float) -> Statistic:
    """Return a share."""
    return Statistic(value, 144)


def least(bound: float) -> Statistic:
    """Return a value whose interval begins here."""
    return Statistic(0.5, 144, (bound, 0.99))


def nothing_known() -> Found:
    """Return the statistics of a model that answered its real pictures, of which no test was made."""
    return {**dict.fromkeys(NAMES, SILENT), "unparsed_reference": share(0.0)}


def reader(**changes: Statistic) -> Found:
    """Return the statistics of a reader of distance for which every condition holds, some of them replaced."""
    held = drawn.by_hand() | {
        "depth_interventional": p(LOW),
        "depth_net": least(0.5),
        "repeat_over_nudged": p(HIGH),
        "unparsed_controls": Statistic(0.0, 144, (0.0, 0.02)),
    }
    return nothing_known() | held | changes


def blind(**changes: Statistic) -> Found:
    """Return the statistics of a constant, whose effects are all bounded, some of them replaced."""
    bounds = {name: p(LOW) for name in NAMES if name.startswith("bound_") and name != "bound_kappa"}
    tests = {
        name: p(HIGH)
        for name in (
            *(f"content_{kind}" for kind in ("shuffled", "recoloured", "lead_absent")),
            "scene_cue",
            "presence",
            "presence_response",
            "repeats_together",
            "repeat_over_nudged",
        )
    }
    return nothing_known() | bounds | tests | changes


def coin(**changes: Statistic) -> Found:
    """Return the statistics of a coin, some of them replaced."""
    held = {
        "self_disagreement": least(0.6),
        "kappa": Statistic(0.0, 144, (-0.1, 0.1)),
        "kappa_pooled": p(LOW),
        "bound_kappa": p(LOW),
    }
    return nothing_known() | held | changes


def signs(wins: int, losses: int, ties: int, p_of: float) -> SignTest:
    """Return a sign test with these counts."""
    n = wins + losses
    ends = (max(0.0, wins / n - 0.1), min(1.0, wins / n + 0.1))
    return SignTest(wins / n, n, ends, p_of, "sign test", note="by hand", wins=wins, losses=losses, ties=ties)


def net(b: int, c: int, n: int, low: float) -> DiscordantPairs:
    """Return a net effect with its lower bound."""
    return DiscordantPairs((b - c) / n, n, (low, 0.9), 0.2, b=b, c=c)


PAPER: Found = {
    "unparsed_rate": Statistic(0.0, 1152),
    "cramers_v": Association(0.5, 1152, p=LOW, groups=2),
    "cramers_v.decision": p(LOW),
    "cramers_v_real_blank": Statistic(0.4, 288, p=0.02),
    "cramers_v_real_blank.decision": Statistic(0.1, 288, p=0.3),
    "refusal_effect": share(0.0),
    "clears_floor": share(1.0),
    "idi": share(0.5),
    "idi_adj": share(0.4),
    "noise_floor": share(0.1),
    "obstacle.decision": p(LOW),
    "mutual_information.decision": p(LOW),
    "gap_order": Statistic(10.0, 144, unit="m"),
    "mirror_swap_rate": Statistic(None, 0, note="nothing was reflected"),
    "image_token.decision": Statistic(0.05, 144, (-0.02, 0.1), 0.3),
    "agree.blank.decision": share(0.6),
    "agree.text_only.decision": share(0.3),
}
ASKED: Mapping[str, Mapping[str, int]] = {
    name: {"decision": 144} for name in ("real", "real_repeat", "blank", "shuffled", "lead_near", "lead_far")
}


def evidence(found: Found, **changes: object) -> Evidence:
    """Return the evidence on a model with these statistics."""
    given = Evidence(
        "by-hand",
        PAPER | found,
        planned=1152,
        answered=1152,
        replies=ASKED,
        holm={"cramers_v": LOW, "cramers_v.decision": LOW},
        directions={"LEFT": 10, "RIGHT": 12},
        gap=True,
        scenarios=4,
        max_tokens=64,
        scope="This bank, these frames.",
    )
    return replace(given, **changes)


def moved(**changes: Statistic) -> Found:
    """Return a reader of distance whose effects are counted, some statistics replaced."""
    counted = {"depth_interventional": signs(100, 4, 40, LOW), "depth_net": net(100, 4, 144, 0.58)}
    return reader(**counted) | changes


def older(**changes: Statistic) -> Found:
    """Return a reader of distance on a bank that has no pictures along the range, some statistics replaced."""
    silent = dict.fromkeys(DEPTH, SILENT) | {"drawn_distances": replace(SILENT, note="beyond 9 m")}
    exchanged = {"lane_net": net(90, 8, 144, 0.47), "rise": Rise(0.5, 400, p=HIGH, note="nowhere")}
    return moved() | silent | exchanged | changes


CARDS = (
    "depth_lateral",
    "constant",
    "unfinished",
    "a guard failed",
    "watched",
    "nothing came",
    "not scorable",
    "stopped: image_invariant",
    "stopped: depth that swaps",
)
POLICIES_IN_JSON = (
    "policy: sees",
    "policy: swap without an interval",
    "policy: the wrist ignored",
    "policy: no motions",
)
CHANGED = ("shuffled", "recoloured", "lead_absent")
SWAPPING = SwapRate(0.9, 40, (0.7, 0.98), 0.001, chance=0.5)
GUARD = Guard("clock", holds=False, because="two replies came before their calls")


def settled(says: str, value: float = 250.0, n: int = 40, alpha: float = 0.01) -> EValue:
    """Return an e-value that has settled a claim."""
    return EValue(value, n, p=1 / value, threshold=1 / alpha, alpha=alpha, settled=True, says=says)


CLAIMS: Found = {
    "early.near_far": settled("it brakes harder for the nearer lead", 123.4, 31),
    "early.scorable": settled("its replies hold decisions", 60.0, 48, 0.02),
    "early.unscorable": settled("too few of its replies hold a decision", 1e9, 24),
    "early.presence": settled("real and blank differ"),
    "early.presence_response": settled("real and blank differ in outputs"),
    "early.bound_blank": settled("the effect of a blank is below 0.1", 104.2, 58),
    "early.steady": settled("no picture gets another answer twice", 20.5, 44, 0.05),
    "early.no_swaps": settled("less than half of its turns are exchanged"),
    "early.swaps_rate": settled("half of its turns are exchanged, or more"),
    "early.few_turns": settled("it turns too seldom", 50.0, 40, 0.02),
}


def stopped() -> dict[str, Evidence]:
    """Return what a verdict that was settled early can be on, by a name."""
    usual = StoppingPoint("image_invariant", "early.bound_blank", "no_power", "early.few_turns", 58, 460, 1152)
    with_it = ("early.steady", "early.scorable")
    by = {"presence_only": "presence", "refusal_effect": "presence_response", "not_scorable": "unscorable"}
    found = {
        "image_invariant": (blind(), replace(usual, other_claims=with_it, beyond=3)),
        "image_invariant, turns": (blind(mirror_swap_rate=SWAPPING), replace(usual, lateral=None)),
        **{
            label: (nothing_known(), replace(usual, label=label, decided_by=f"early.{claim}", other_claims=with_it[1:]))
            for label, claim in by.items()
        },
        "depth_associated": (
            nothing_known(),
            replace(usual, label="depth_associated", decided_by="early.near_far", interventional=True),
        ),
    }
    depth = replace(usual, label="depth", decided_by="depth_interventional", frames=144, interventional=True)
    swaps = replace(depth, lateral="swaps", lateral_by="early.swaps_rate")
    sided = {"turns_clear": signs(30, 4, 0, LOW), "turns_clear_within": signs(28, 4, 0, 0.004)}
    found |= {
        "depth": (moved(), depth),
        "depth, turns": (moved(mirror_swap_rate=SWAPPING, **sided), replace(depth, lateral=None)),
        "depth that swaps": (moved(mirror_swap_rate=SWAPPING), swaps),
        "depth that swaps, nobody knows whither": (
            moved(mirror_swap_rate=SWAPPING, turns_clear=signs(18, 16, 0, 0.4)),
            swaps,
        ),
        "depth that does not swap": (
            moved(mirror_swap_rate=SwapRate(0.1, 20, (0.0, 0.3), 1.0, chance=0.5)),
            replace(depth, lateral="does_not_swap", lateral_by="early.no_swaps"),
        ),
        "depth that a control takes away": (moved(sensitivity=Statistic(0.05, 144, (-0.1, 0.2))), depth),
    }
    return {f"stopped: {name}": evidence(one | CLAIMS, stopped=at) for name, (one, at) in found.items()} | {
        "stopped: controls that the bank lacks": evidence(
            nothing_known() | CLAIMS, stopped=found["depth_associated"][1], absent=("lead_drawn", "nudged")
        )
    }


@cache
def cases() -> dict[str, Evidence]:
    """Return what a verdict can be on, by a name."""
    swapped = {"mirror_swap_rate": SWAPPING}
    sided = {"turns_clear": signs(30, 4, 0, LOW), "turns_clear_within": signs(28, 4, 0, 0.004)}
    refused = {"real": {"decision": 140, "truncated": 4}, "blank": {"decision": 30, "refused": 114}}
    unparsed = {"unparsed_rate": Statistic(0.4, 288), "refusal_effect": share(1.0)}
    loose = DiscordantPairs(0.05, 144, (-0.02, 0.12), HIGH, b=10, c=3)
    made: dict[str, Found] = {
        "depth": moved(),
        "depth that swaps": moved(**swapped),
        "depth_lateral": moved(**swapped, **sided),
        "swaps, many turns blocked": moved(
            **swapped, **sided | {"turns_against": Statistic(0.2, 34, (0.08, 0.38), p=0.0001)}
        ),
        "swaps, clear within open": moved(**swapped, **sided | {"turns_clear_within": signs(20, 14, 0, 0.2)}),
        "swaps to no side": moved(**swapped, turns_clear=signs(18, 16, 0, 0.4)),
        "turns to the blocked side, perhaps": moved(**swapped, turns_clear=signs(10, 15, 2, 0.9)),
        "turns to the blocked side": moved(**swapped, turns_clear=signs(4, 30, 2, 1.0)),
        "depth_lateral, certain": moved(**swapped, **sided | {"turns_clear_within": signs(40, 0, 0, 0.0)}),
        "does not swap": moved(mirror_swap_rate=SwapRate(0.1, 40, (0.0, 0.3), 1.0, chance=0.5)),
        "no power to swap": moved(mirror_swap_rate=SwapRate(0.7, 10, (0.2, 0.9), 0.2, chance=0.5)),
        **{
            f"no power to swap, {rate} of 400": moved(mirror_swap_rate=SwapRate(rate, 400, (0.0, 0.6), 0.2, chance=0.5))
            for rate in (0.0, 0.51, 0.52, 0.55)
        },
        "no power to swap, a low chance": moved(mirror_swap_rate=SwapRate(0.3, 60, (0.2, 0.6), 0.2, chance=0.2)),
        "no turns": moved(mirror_swap_rate=SwapRate(None, 0)),
        "of an older bank": older(),
        "of an older bank, no exchange asked": older(lane_net=SILENT),
        "of an older bank, an exchange that is bounded": older(
            lane_net=DiscordantPairs(0.02, 144, (-0.05, 0.09), 0.9, b=9, c=6)
        ),
        "of an older bank, declines edited pictures": older(
            unparsed_controls=Statistic(0.3, 288, (0.2, 0.4), note="86 of 288")
        ),
        "a hole": moved(holes=Places(1.0, 7, places=(drawn.HOLE,))),
        "a kind of pairs is open": moved(order_drawn=Statistic(0.05, 100, (0.0, 0.3))),
        "declines edited pictures": moved(unparsed_controls=Statistic(0.3, 288, (0.2, 0.4), note="86 of 288")),
        "watched": nothing_known() | {"depth_observational": p(LOW)},
        "follows the file": moved(repeat_over_nudged=p(LOW)),
        "not scorable": nothing_known() | {"unparsed_reference": share(0.3)},
        "nothing came": nothing_known() | {"unparsed_reference": SILENT},
        "nothing tested": nothing_known(),
        "no blanks": blind(bound_blank=SILENT),
        "coin": coin(),
        "constant": blind(),
        "constant, loosely": blind(bound_noise=loose),
        "two effects are open": blind(bound_lead_near=replace(loose, p=0.2), bound_noise=loose, bound_scene=p(0.3)),
        "an effect of content is there": blind(bound_content_shuffled=replace(loose, ci=(0.02, 0.2))),
        "an effect is there": blind(bound_noise=replace(loose, ci=(0.02, 0.2))),
        "another answer twice": blind(repeats_together=p(LOW)),
        "presence": blind(presence=p(LOW)),
        "presence, content open": blind(presence=p(LOW), bound_content_shuffled=loose),
        "refusal": blind(presence_response=p(LOW)),
        "scene cue": blind(scene_cue=p(LOW)),
        **{
            f"content by {one}": blind(**{f"content_{one}": p(LOW)})
            for one in ("shuffled", "recoloured", "lead_absent")
        },
        "content, sides of it": blind(content_shuffled=p(LOW), depth_interventional=signs(22, 22, 100, 0.5)),
        "content, moved, follows the file": moved(content_shuffled=p(LOW), repeat_over_nudged=p(LOW)),
        "an exchange without an interval": older(lane_net=replace(net(90, 8, 144, 0.47), ci=None)),
        "content, watched in vain": blind(content_shuffled=p(LOW), depth_observational=p(0.2)),
        "content, follows the file": blind(
            content_shuffled=p(LOW), depth_observational=p(LOW), repeat_over_nudged=p(LOW)
        ),
        "another answer twice, nearly content": blind(
            repeats_together=p(LOW), content_shuffled=signs(30, 16, 98, 0.03)
        ),
        "constant, nearly present": blind(presence=signs(30, 16, 98, 0.03)),
        "no recoloured, no shuffled": blind(bound_content_recoloured=SILENT, bound_content_shuffled=SILENT),
        "content, a test near": blind(content_shuffled=p(LOW), depth_interventional=signs(30, 16, 98, 0.03)),
    }
    failing: Found = {
        "depth_net": DiscordantPairs(0.07, 144, (0.03, 0.099), 0.9, b=12, c=2),
        "sensitivity": Statistic(0.05, 144, (0.0, 0.2)),
        "specificity": Statistic(0.1, 144, (0.0, 0.2)),
        "specificity_far": Statistic(0.2, 48, (0.1, 0.3)),
        "order": Statistic(0.2, 144, (0.1, 0.3)),
        "order_drawn": Statistic(0.2, 144, (0.1, 0.3)),
        "rise": Rise(5.1, 400, p=0.001, nearer=(10.1, 11.2), farther=(11.3, 12.6)),
        "place_reversed": Statistic(0.3, 36, (0.1, 0.5), note="in `urban`"),
        "place_beside": Statistic(0.3, 36, (0.1, 1.0), note="in `urban`"),
        "file": signs(12, 0, 132, 0.0001),
    }
    shown: Found = {
        "sensitivity": Statistic(0.2, 144, (0.05, 0.35)),
        "specificity": Statistic(-0.1, 144, (-0.2, 0.05)),
        "order": Statistic(0.08, 40, (0.02, 0.2)),
        "rise": SILENT,
    }
    made |= {f"{name} is not shown": moved(**{name: one}) for name, one in shown.items()}
    made |= {f"{name} fails": moved(**{name: one}) for name, one in failing.items()}
    paper = {
        "unparsed": {"unparsed_rate": share(0.3)},
        "not graded": {"gap_order": Statistic(-1.0, 144)},
        "gap not tested": {"gap_order": SILENT},
        "no obstacle": {"obstacle.decision": p(0.3)},
        "no information": {"mutual_information.decision": p(0.3)},
        "swaps": swapped,
        "outputs only": {"cramers_v.decision": p(0.3)},
        "below its floor": {"clears_floor": share(0.0)},
        "no floor": {"clears_floor": share(0.0), "cramers_v": replace(PAPER["cramers_v"], p=0.3)},
        "an image token": {"image_token.decision": Statistic(0.3, 144, (0.2, 0.4), LOW)},
        "an image token at the margin": {"image_token.decision": Statistic(0.3, 144, (0.1, 0.4), LOW)},
        "an image token, perhaps": {"image_token.decision": Statistic(0.3, 144, (0.05, 0.4), LOW)},
        "an image token without an interval": {"image_token.decision": Statistic(0.3, 144, p=LOW)},
        "a floor of nothing": {"clears_floor": share(0.0), "noise_floor": share(0.0)},
        "a floor, no association at .05": {
            "clears_floor": share(0.0),
            "cramers_v": replace(PAPER["cramers_v"], p=0.05),
        },
        "one condition": {"cramers_v": Association(0.5, 1152, p=LOW, groups=1)},
        "no conditions": {"cramers_v": Association(0.5, 1152, p=LOW)},
    }
    made |= {f"paper: {name}": blind(**one) for name, one in paper.items()}
    found = {name: evidence(one) for name, one in made.items()}
    whole = blind()
    silent = {"real": {"refused": 144}, "blank": {"decision": 144}}
    cut = {"real": {"decision": 140, "http_error": 3, "no_json_object": 1}, "blank": {"decision": 144}}
    photographs = evidence(blind(content_shuffled=p(LOW)), replies={"real": {"decision": 144}}, gap=False)
    every = {"real": {"decision": 144}, "blank": {"refused": 144}, "noise": {"decision": 1, "refused": 143}}
    hardly = {"real": {"decision": 144}, "blank": {"refused": 1}, "noise": {"decision": 44, "refused": 100}}
    return (
        found
        | stopped()
        | {
            "cut off, by a budget that nobody knows": evidence(blind(), replies=refused, max_tokens=0),
            "cut off where a picture was edited": evidence(
                blind(), replies={"real": {"decision": 144}, "lead_near": {"decision": 140, "truncated": 4}}
            ),
            "lost on the way": evidence(blind() | {"unparsed_rate": Statistic(0.0139, 288)}, replies=cut),
            "content, of photographs": replace(photographs, absent=("lead_near", "lead_far")),
            "content, of photographs of one distance": replace(photographs, absent=("lead_far",)),
            "content, nothing moved": replace(photographs, gap=True, scenarios=2),
            "refuses every blank": evidence(blind() | unparsed, replies=every),
            "refuses the one blank": evidence(blind() | unparsed, replies={**hardly, "text_only": {}}),
            "a shard, its controls not asked": evidence(older(lane_net=SILENT), part=True),
            "refuses blanks": evidence(blind() | unparsed, replies=refused),
            "refuses noise": evidence(
                blind() | unparsed, replies={"real": {"decision": 144}, "noise": {"decision": 9, "refused": 135}}
            ),
            "refuses real ones": evidence(blind() | unparsed, replies=silent),
            "unfinished": evidence(whole, answered=900),
            "unfinished, may stop early": evidence(whole | {"early.near_far": SILENT}, answered=900),
            "a guard failed": evidence(whole, guards=(GUARD, replace(GUARD, holds=True))),
            "one direction": evidence(
                moved(mirror_swap_rate=SwapRate(0.0, 20, (0.0, 0.2), 1.0, chance=0.5)),
                directions={"LEFT": 20, "RIGHT": 0},
            ),
            "no gap": evidence(whole, gap=False),
            "turns within a lane not known": evidence(moved(**swapped, **sided | {"turns_clear_within": SILENT})),
            "pictures along the range that were asked in vain": evidence(
                older(), replies={**ASKED, **{one: {"refused": 144} for one in RANGED}}
            ),
            "pictures along the range that were not drawn": evidence(older(), absent=RANGED[3:]),
            "some of them that were not drawn": evidence(older(), absent=("exchange_beside",)),
            "watched, nothing moved": evidence(
                nothing_known() | {"depth_observational": p(LOW)},
                replies={"real": {"decision": 144}},
                absent=("lead_far",),
            ),
            "paper: nothing depends": evidence(whole, holm={"cramers_v": 0.4, "cramers_v.decision": LOW}),
        }
    )


class Several:
    """A scored run of four models, two of which are alike, and one has no note in common with these."""

    def evidence(self) -> dict[str, Evidence]:
        """Return what there is to judge."""
        made = {name: cases()[name] for name in ("depth", "constant", "unfinished", "stopped: image_invariant")}
        return {name: replace(one, model=name) for name, one in made.items()}


def said(case: str) -> object:
    """Return what the verdict on a case says, or the clauses of an admission."""
    if case == "clauses":
        values = {"parse": 0.95, "close_accuracy": 0.7499, "balanced_accuracy": None, "scene_equivariance": 0.65}
        values |= {"action_equivariance": 0.75, "actions": 2.0, "directional": 2.0}
        found = {name: Statistic(one, 9, None if one is None else (0.1, 0.9)) for name, one in values.items()}
        return [one.as_dict() for one in hold(found)]
    if case in (policies := policies_by_hand.cases()):
        return policies_by_hand.said(policies[case], whole=case in POLICIES_IN_JSON)
    if case == "several":
        verdicts = judge(Several())
        alike = {name: one for name, one in verdicts.items() if one.stopped is None}
        return {
            "shared": shared_notes(verdicts),
            "shared by all": shared_notes(alike),
            "text": words_of(verdicts).splitlines(),
        }
    verdict = judge_one(cases()[case])
    told = {"json": verdict.as_dict(), "text": str(verdict).splitlines()}
    return told | ({"card": verdict._repr_html_(), "short": repr(verdict)} if case in CARDS else {})


def names() -> list[str]:
    """Return the names of all cases."""
    return [*cases(), *policies_by_hand.cases(), "several", "clauses"]


if __name__ == "__main__":
    print(json.dumps({case: said(case) for case in names()}, indent=1, ensure_ascii=False))  # noqa: T201
