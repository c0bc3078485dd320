"""A guardian's score: Table t:positive-guardian of the paper, its text, and its page."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from eyechart.conditions import flip
from eyechart.errors import EyechartError
from eyechart.frames import FrameBank, decode, encode
from eyechart.guardian import interface_of
from eyechart.report.charts import BLUE, INK, MUTED, Drawing, canvas, style
from eyechart.report.page import Page, PageSummary, VerdictSummary, fill
from eyechart.report.table import Cell, Column, Mark, Table, columns, number, p_value
from eyechart.report.table import estimate as shown
from eyechart.stats.committee_votes import ABSTAIN, answers
from eyechart.stats.paired_tests import DiscordantPairs
from eyechart.stats.statistic import Statistic, UpperBound
from eyechart.studies.battery.album import view_uri
from eyechart.studies.guardian import ESTIMANDS, VIEWS, Bound, FrozenGuardian, GuardianScore, ModularReplay, NestedFit

MOST_PICTURES = 24
MOST_ROWS = 3000
_SIGNS = {1: "●", 0: "○", -1: "×"}


def guardian_page(score: GuardianScore, bank: FrameBank | None) -> Page:
    """Return a score as a page; without a ``bank`` it shows no pictures, and says so.

    The same score gives the same bytes.
    """
    frozen, table = score.frozen, score.table
    pictures, note = _pictures(score, bank)
    votes = _votes(score)
    listed = sum(len(rows) for _, rows in votes)
    drawn = curve(score)
    html = fill(
        "guardian.html",
        styles=("guardian.css",),
        answer=opening(score),
        frozen=frozen,
        frames=len(table.frames),
        episodes=len(set(table.episodes)),
        warnings=score.warnings,
        points=guardian_table(score),
        lines=list(score_lines(score, bounds=False))[1:],
        curve=drawn,
        bound=[] if score.bound is None else list(bound_lines(score.bound)),
        missed=len(score.missed),
        hazards=int(table.hazard.sum()),
        note=note,
        pictures=pictures,
        votes=votes,
        left_out="" if listed == len(table.frames) else f"The first {listed} of {len(table.frames)} frames.",
    )
    return Page(html, {"curve": [drawn]})


def opening(found: GuardianScore) -> PageSummary:
    """Return the page's opening: missed hazards, false alarms, and abstentions."""
    table, own = found.table, found.rows[found.frozen.point]
    hazards = int(table.hazard.sum())
    alarms = sum(found.answers[frame] == "hazard" and not table.hazard[at] for at, frame in enumerate(table.frames))
    handed = sum(answer == "abstain" for answer in found.answers.values())
    sentence = (
        f"It calls {len(found.missed)} of {hazards} hazards clear, raises a false alarm on {alarms} of "
        f"{len(table.frames) - hazards} clear frames, and hands back {handed} of {len(table.frames)}."
    )
    balanced, single = own["bal"], found.rows["single"]["bal"]
    low, high = balanced.ci or (0.0, 1.0)
    tone = "sees" if low > 0.5 else "blind" if high < 0.5 else "open"
    words = {"sees": "better than chance", "blind": "worse than chance", "open": "not shown to be better than chance"}
    reasons = (
        f"Balanced accuracy {shown(balanced)} over the {balanced.n} frames that it answers; the best single model of "
        f"the calibration has {shown(single)} over its own {single.n}."
    )
    bound = "" if found.bound is not None else "Its misses have no upper bound: no episodes were kept for one."
    who = " + ".join(found.frozen.committee)
    drawn = replace(curve(found, (4.2, 2.9)), name="in-short")
    return PageSummary(sentence, [VerdictSummary(who, words[tone], tone, reasons, bound, "points")], figure=drawn)


@style()
def curve(found: GuardianScore, size: tuple[float, float] = (6.4, 3.4)) -> Drawing:
    """Draw the share of wrong answers by the share of frames answered, with the operating points.

    ``size`` is its width and height in inches.
    """
    figure, axes = canvas(*size, (0.7, 0.2, 0.55, 0.2))
    points = [(one.answered / one.frames, one.wrong / one.answered) for one in found.curve]
    axes.plot([x for x, _ in points], [y for _, y in points], color=BLUE, linewidth=1.6, marker="o", markersize=3)
    labels: dict[tuple[float, float], list[str]] = {}
    descriptions, top = [], max([0.02, *(y for _, y in points)])
    for key, name in row_names(found.frozen).items():
        x, accuracy = found.rows[key]["coverage"].value, found.rows[key]["acc"].value
        if x is None or accuracy is None:
            continue
        top = max(top, 1 - accuracy)
        own = key == found.frozen.point
        colour, size_pt = (BLUE, 9) if own else (INK, 6)
        axes.plot([x], [1 - accuracy], "s" if key == "single" else "o", color=colour, markersize=size_pt)
        word = "single model" if key == "single" else key.replace("_", "-")
        labels.setdefault((round(x, 2), round(1 - accuracy, 3)), []).append(word)
        descriptions.append(f"{name}: coverage {x:.3f}, risk {1 - accuracy:.3f}")
    for place, words in labels.items():
        said = ", ".join(words)
        axes.annotate(said, place, xytext=(-8, 6), textcoords="offset points", ha="right", color=MUTED)
    axes.set_xlim(0, 1.03)
    axes.set_ylim(-0.04 * top, 1.25 * top)
    axes.set_xlabel("coverage: share of frames answered")
    axes.set_ylabel("risk: share of answers wrong")
    return Drawing("guardian-curve", "Risk by coverage", ". ".join(descriptions), figure)


def _votes(score: GuardianScore) -> list[tuple[str, list[dict[str, object]]]]:
    """Return the frames by episode, each with its votes and its outcome."""
    table, own = score.table, score.table.of(score.frozen.committee)
    episodes: dict[str, list[dict[str, object]]] = {}
    for place, frame in enumerate(table.frames[:MOST_ROWS]):
        hazard, answer = bool(table.hazard[place]), score.answers[frame]
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


def _pictures(score: GuardianScore, bank: FrameBank | None) -> tuple[list[dict[str, object]], str]:
    """Return the views of the first missed frames, and notes on them."""
    if not score.missed:
        return [], ""
    if bank is None:
        return [], "To see their pictures, give the bank with --frames."
    table = score.table
    shown: list[dict[str, object]] = []
    for frame in score.missed[:MOST_PICTURES]:
        place = table.frames.index(frame)
        said = table.of(score.frozen.committee)[:, place]
        views = [
            (view, view_uri(picture), _said(score.frozen.committee, said[:, number_of].tolist()))
            for number_of, (view, picture) in enumerate(zip(VIEWS, _views(score, bank, frame), strict=False))
        ]
        shown.append({"frame": frame, "episode": table.episodes[place], "views": views})
    more = len(score.missed) - len(shown)
    return shown, f"The first {len(shown)} are shown; {more} more are in the table of votes." if more else ""


def _views(score: GuardianScore, bank: FrameBank, frame_id: str) -> Sequence[bytes]:
    """Return the models' view of a frame; without a known view, the picture and its reflection."""
    frame = bank.frame(frame_id)
    image = bank.recorded(frame)
    try:
        return interface_of(score.frozen).views(image)
    except EyechartError:
        if frame.mirror_axis == "none":
            return (image,)
        return (image, encode(flip(decode(image, frame_id), frame.mirror_axis)))


def _said(committee: Sequence[str], votes: Iterable[int]) -> str:
    words = {1: "hazard", 0: "clear", -1: "missing"}
    return ", ".join(f"{model} {words[int(vote)]}" for model, vote in zip(committee, votes, strict=True))


_SHOWN = 10


def row_names(frozen: FrozenGuardian) -> dict[str, str]:
    """Return the names of a score's rows in the paper's order."""
    at = {"voters": frozen.voters, "threshold": frozen.threshold}
    ties = [h for h in range(frozen.voters + 1) if answers(h, 0, point="abstain", **at) == ABSTAIN]
    tie = " to ".join(f"{h}–{frozen.voters - h}" for h in dict.fromkeys((ties[0], ties[-1])))
    single = "the best single model" if frozen.selection is None else frozen.selection.single
    return {
        "single": f"{single}, original",
        "two_way": f"guardian of {len(frozen.committee)}, hazard from {frozen.threshold} of {frozen.voters}",
        "abstain": f"guardian, abstain on {tie}",
        "unanimous": "guardian, unanimous only",
    }


def guardian_table(score: GuardianScore) -> Table:
    """Return the rows of Table t:positive-guardian: best single model, three operating points."""
    named, own = row_names(score.frozen), score.frozen.point
    rows = tuple((Mark(name, "", "*" if key == own else ""), *_cells(score.rows[key])) for key, name in named.items())
    caption = "Best single model of the calibration, and the guardian at each operating point"
    return Table("points", caption, _COLUMNS, rows, "* frozen: the guardian's own operating point")


def paper_table(found: GuardianScore) -> Table:
    """Return Table t:positive-guardian in the paper's form."""
    rows = tuple((name, *_cells(found.rows[key])) for key, name in row_names(found.frozen).items())
    named = (Column("method"), *columns("estimate", *METRICS.values(), beside=""))
    caption = f"Leakage-controlled longitudinal guardian on {len(found.table.frames)} frames that did not choose it"
    return Table("", "", named, rows).labelled("t:positive-guardian", caption)


def tests_table(score: GuardianScore) -> Table:
    """Return the two tests of the two-way point against the best single model."""
    exact, whole = score.mcnemar, score.over_episodes
    corrected, made = (exact.b, exact.c) if isinstance(exact, DiscordantPairs) else (0, 0)
    rows = (("exact McNemar", corrected, made, exact.p), ("signs of episodes flipped", None, None, whole.p))
    named = (Column("test"), *columns("count", "corrected", "made"), Column("p", "p"))
    return Table("guardian-tests", "The two-way guardian against the best single model", named, rows)


def replay_table(found: ModularReplay) -> Table:
    """Return the shares of modular replay."""
    shares = {
        "agreement with the renderer policy": found.agreement,
        "agreement where answered": found.agreement_answered,
        "agreement of a perfect guardian": found.ceiling,
        "agreement of a perfect guardian where answered": found.ceiling_answered,
        "answered": found.answered,
        "equivariance": found.equivariance,
    }
    rows = tuple((name, share) for name, share in shares.items())
    caption = "Modular replay: the guardian brakes, a deterministic reader keeps the sides"
    return Table("modular", caption, (Column("share"), Column("value", "estimate")), rows)


def nested_table(fit: NestedFit) -> Table:
    """Return the pooled row of nested leave-one-episode-out."""
    row = ("nested leave-one-episode-out", *_cells(fit.pooled), f"{fit.agreed} of {len(fit.folds)}")
    return Table("nested", "Committees chosen without each episode", (*_COLUMNS, Column("folds alike")), (row,))


METRICS = {"coverage": "coverage", "acc": "acc.", "bal": "bal. acc.", "sens": "sens.", "spec": "spec."}
_COLUMNS = (Column("method"), *columns("estimate", *METRICS.values()))


def _cells(row: Mapping[str, Statistic]) -> tuple[Cell, ...]:
    return tuple(row[name] for name in METRICS)


def choice_lines(frozen: FrozenGuardian) -> Iterator[str]:
    """Yield sentences on the choice, its frames, and facts that were not recorded."""
    votes = f"hazard from {frozen.threshold} of {frozen.voters} votes"
    yield f"committee: {', '.join(frozen.committee)}; {votes}; {frozen.point}"
    if frozen.selection is not None:
        chosen = frozen.selection
        costs = chosen.costs is not None
        worth = f"expected cost {-chosen.worth:.4g}" if costs else f"balanced accuracy {chosen.worth:.3f}"
        yield (
            f"chosen on {len(chosen.frames)} frames of {len(chosen.episodes)} episodes among {chosen.candidates} "
            f"candidates: {worth} there, which is too good; best single model there: {chosen.single}"
        )
        if not costs and chosen.worth <= 0.5:
            yield "that is no better than chance: use none of these committees in a stack"
    if lacking := frozen.about.unrecorded(frozen.committee):
        yield f"not recorded, so a change of it cannot be noticed: {', '.join(lacking)}"


def score_lines(score: GuardianScore, *, bounds: bool = True) -> Iterator[str]:
    """Yield sentences on intervals, test, curve, misses and ``bounds``."""
    corrected, made = (score.mcnemar.b, score.mcnemar.c) if isinstance(score.mcnemar, DiscordantPairs) else (0, 0)
    p, whole = score.mcnemar.p, score.over_episodes
    exact = f" ({p:.3g})" if p is not None and p < 0.0001 else ""
    yield f"* the guardian's own operating point; intervals: {_method(score)}"
    yield (
        f"Two-way against the single model: {corrected} errors corrected, {made} made; exact McNemar p "
        f"{p_value(p)}{exact}, frames taken as independent"
    )
    yield f"The same by flipping the signs of whole episodes' differences: p {p_value(whole.p)} (n {whole.n})"
    curve = ", ".join(f"{one.answered / one.frames:.3f}: {one.wrong / one.answered:.3f}" for one in score.curve)
    yield f"Risk by coverage, from the surest frames: {curve}"
    shown = ", ".join(score.missed[:_SHOWN]) + (", …" if len(score.missed) > _SHOWN else "")
    yield f"Hazards called clear: {len(score.missed)}{f' ({shown})' if shown else ''}"
    if score.incomplete:
        yield f"{score.incomplete} frames lack votes; missing votes never count as clear"
    if bounds and score.bound is not None:
        yield from bound_lines(score.bound)


def _method(score: GuardianScore) -> str:
    """Return the method of the table's intervals, by column if they differ, or why one has none."""
    made = dict[str, list[str]]()
    for row in score.rows.values():
        for name, one in row.items():
            how = one.method if one.ci is not None else f"none, because {one.note or 'no class was answered'}"
            if name not in made.setdefault(how, []):
                made[how].append(name)
    return next(iter(made)) if len(made) == 1 else "; ".join(f"{', '.join(by)}: {how}" for how, by in made.items())


def bound_lines(bound: Bound) -> Iterator[str]:
    """Yield sentences on each bound, its number of episodes, and where it holds."""
    per_frame = bound.frame_rate
    if bound.rate.ci is None or bound.any_miss.ci is None or not isinstance(per_frame, UpperBound) or not per_frame.ci:
        yield f"no bound: {bound.rate.note}; {bound.needed_at_best} episodes without a miss would bound it by 1 %"
        return
    at = f"at {100 * bound.confidence:g} % confidence"
    yield (
        f"Missed-hazard rate per episode ({ESTIMANDS['missed_hazard_rate']}): {number(bound.rate.value, 4)}, at most "
        f"{bound.rate.ci[1]:.4f} {at}, from {bound.episodes} episodes"
    )
    yield (
        f"Missed-hazard rate per frame ({ESTIMANDS['missed_hazard_rate_per_frame']}): "
        f"{number(per_frame.value, 4)}, at most {per_frame.ci[1]:.4f} {at}, from {per_frame.n} "
        f"hazardous frames of {bound.episodes} episodes, none of more than {per_frame.longest} frames"
    )
    yield (
        f"Episodes with any miss ({ESTIMANDS['any_miss_in_an_episode']}): {number(bound.any_miss.value, 4)}, at most "
        f"{bound.any_miss.ci[1]:.4f} {at}, from {bound.episodes} episodes; for 1 % it needs {bound.needed} episodes "
        f"without a further miss ({bound.needed_at_best} without any)"
    )
    kept = bound.conformal_threshold
    threshold = "no two-way threshold" if kept is None else f"a two-way threshold of at most {kept}"
    risks = ", ".join(f"{place}: {risk:.3f}" for place, risk in enumerate(bound.conformal, 1))
    yield (
        f"In expectation only (conformal risk control, no confidence; {ESTIMANDS['conformal']}): at most "
        f"{bound.risk:g} with {threshold}; by threshold {risks}"
    )
    yield f"The bounds are {bound.scope}"


def nested_lines(fit: NestedFit) -> Iterator[str]:
    """Yield sentences on the choices of the folds."""
    kinds: dict[tuple[tuple[str, ...], int, str], list[str]] = {}
    for episode, chosen in fit.folds.items():
        kinds.setdefault(chosen, []).append(episode)
    for (committee, threshold, point), episodes in sorted(kinds.items(), key=lambda one: -len(one[1])):
        yield f"{len(episodes)}/{len(fit.folds)} folds: {' + '.join(committee)}, hazard from {threshold}, {point}"


def replay_lines(found: ModularReplay) -> Iterator[str]:
    """Yield sentences on how a modular replay compares."""
    yield (
        f"Agreement with the renderer policy: {number(found.agreement.value)} (n {found.agreement.n}); where the "
        f"guardian answered {number(found.agreement_answered.value)} (n {found.agreement_answered.n})"
    )
    yield (
        f"The ceiling, a perfect guardian that answers the truth on every frame: {number(found.ceiling.value)} (n "
        f"{found.ceiling.n}); where this one answered {number(found.ceiling_answered.value)} (n "
        f"{found.ceiling_answered.n})"
    )
    yield (
        f"The guardian answered on {number(found.answered.value)} of them (n {found.answered.n}); where it abstains, "
        "the renderer policy acts and agrees with itself"
    )
    yield (
        f"Equivariant under reflection: {number(found.equivariance.value)} (n {found.equivariance.n}), for the reader "
        "and the policy alone: the votes on a frame and its reflection are exchanged"
    )
    yield f"The renderer policy turns on {found.directional} of these frames; lateral control is not tested further"
    if found.unread:
        yield f"{len(found.unread)} pictures could not be read and count in no share"
