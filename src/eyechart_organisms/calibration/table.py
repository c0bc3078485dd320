"""The tables of a calibration, as Markdown that a terminal can show too."""

from collections.abc import Callable, Mapping, Sequence

from eyechart.stats.agreement import clopper_pearson, rate
from eyechart.stats.statistic import Statistic
from eyechart.verdicts import LABELS, PAPER_LABELS
from eyechart.verdicts.ruling import number
from eyechart_organisms.adversaries import ADVERSARIES
from eyechart_organisms.calibration import early_stops
from eyechart_organisms.calibration.early_stops import EQUAL, SAVERS, mean_saved
from eyechart_organisms.calibration.known_answers import KNOWN, NULLS
from eyechart_organisms.calibration.tally import CLAIMS, FALSE, VARIANTS, WANTED, Calibration
from eyechart_organisms.calibration.world import POWER, SETTINGS

Cells = Sequence[Sequence[str]]


def tables(found: Calibration) -> str:
    """Return all results of a calibration, one table below the other."""
    parts = [
        f"{found.replications} replications of each setting, seed {found.seed}, {found.resamples} resamples a test.",
        _table("Settings", ("setting", "bank"), [(name, SETTINGS[name].says) for name in found.settings]),
    ]
    if "default" in found.settings:
        counts = found.labels["default"][VARIANTS[0]]
        deserve = {name: one.calibrated for name, one in KNOWN.items()}
        title = f"Calibrated rules, setting default, {VARIANTS[0]}: share of each label"
        parts.append(_confusion(title, counts, deserve, tuple(LABELS), found.replications))
        deserve = {name: one.paper for name, one in KNOWN.items()}
        title = "The paper's rules, setting default: share of each label"
        parts.append(_confusion(title, found.paper["default"], deserve, PAPER_LABELS, found.replications))
    parts += [_right(found, variant) for variant in VARIANTS]
    parts += [_false_claims(found), _type_one(found), _power(found)]
    parts += [_stopped(found, variant) for variant in VARIANTS]
    parts += [_stopped_elsewhere(found), _ever(found), _adversaries(found), _targets(found)]
    return "\n\n".join(part for part in parts if part)


def _table(title: str, head: Sequence[str], rows: Cells) -> str:
    """Return a Markdown table whose columns are as wide as their widest cell."""
    wide = [max(len(row[place]) for row in (head, *rows)) for place in range(len(head))]

    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(f"{cell:<{width}}" for cell, width in zip(cells, wide, strict=True)) + " |"

    rule = "|" + "|".join("-" * (width + 2) for width in wide) + "|"
    return "\n".join([f"### {title}", "", line(head), rule, *map(line, rows)])


def _with_interval(one: Statistic) -> str:
    return "—" if one.value is None or one.ci is None else f"{one.value:.4f} [{one.ci[0]:.4f}, {one.ci[1]:.4f}]"


def _confusion(
    title: str, counts: Mapping[str, Mapping[str, int]], deserve: Mapping[str, str], labels: Sequence[str], n: int
) -> str:
    given = [label for label in labels if any(label in count for count in counts.values()) or label in deserve.values()]
    rows = [
        (name, deserve[name], *(f"{count[label] / n:.3f}" if label in count else "" for label in given))
        for name, count in counts.items()
    ]
    return _table(title, ("controller", "deserves", *given), rows)


def _right(calibration: Calibration, variant: str) -> str:
    rows = [
        (name, *(number(calibration.right(setting, variant, name)) for setting in calibration.settings))
        for name in KNOWN
    ]
    undecided = (
        "undecided, of all",
        *(number(calibration.undecided(setting, variant)) for setting in calibration.settings),
    )
    return _table(f"Share of right labels, {variant}", ("controller", *calibration.settings), [*rows, undecided])


def _false_claims(calibration: Calibration) -> str:
    rows = []
    for setting in calibration.settings:
        for variant in VARIANTS:
            each = [calibration.false_claims(claim, setting, variant) for claim in CLAIMS]
            cells = [
                f"{one.pooled.value:.4f} of {one.pooled.n}"
                + (f" ({one.worst} {one.worst_rate.value:.3f})" if one.worst_rate.value else "")
                for one in each
            ]
            rows.append((setting, variant.split()[0], *cells))
    title = "False claims: share over the controllers for which the claim is false (the worst controller)"
    return _table(title, ("setting", "counterfactuals", *CLAIMS), rows)


def _type_one(calibration: Calibration) -> str:
    """Return how often each test rejected a true null: by default, over all, and at most."""
    rows = []
    for test, (alpha, names) in NULLS.items():
        each = {setting: calibration.type_one(setting, test) for setting in calibration.settings}
        made = {setting: one for setting, one in each.items() if one.value is not None}
        counts = [calibration.tests[setting][test][name] for setting in calibration.settings for name in names]
        over_all = rate(sum(count[1] for count in counts), sum(count[0] for count in counts))
        worst = max(made, key=lambda setting: made[setting].value or 0.0, default="")
        first = made.get("default")
        rows.append(
            (
                test,
                f"{alpha:g}",
                "—" if first is None else f"{_with_interval(first)} of {first.n}",
                f"{_with_interval(over_all)} of {over_all.n}",
                f"{worst} {number(made[worst])} of {made[worst].n}" if worst else "—",
            )
        )
    title = "Type-I error of each test: share of rejections where its null is true, with Wilson's 95 % interval"
    return _table(title, ("test", "alpha", "default", "all settings", "most in"), rows)


def _power(calibration: Calibration) -> str:
    """Return the share of right labels by the number of frames."""
    sizes = [name for name in POWER if name in calibration.settings]
    if len(sizes) < 2:
        return ""
    head = [f"{one.scenarios * one.episodes * one.frames} frames" for one in map(SETTINGS.__getitem__, sizes)]

    def cell(name: str) -> Callable[[str], str]:
        return lambda setting: " / ".join(number(calibration.right(setting, variant, name)) for variant in VARIANTS)

    rows = [(name, *map(cell(name), sizes)) for name in KNOWN]
    return _table("Power: share of right labels against n, with / without counterfactuals", ("controller", *head), rows)


def _stopped(calibration: Calibration, variant: str) -> str:
    """Return the effect of early stopping on each controller in the default setting."""
    by = calibration.early.get("default", {}).get(variant, {})
    rows = []
    for name, sums in by.items():
        mean, low, high = mean_saved(sums)
        n = sums["runs"]
        shares = (f"{sums[column] / n:.3f}" for column in ("stopped", "equal", "lateral", "false"))
        rows.append((name, f"{mean:.3f} [{max(low, 0):.3f}, {high:.3f}]", *shares))
    head = ("controller", "calls saved, mean [95 %]", "stopped", "verdict as in full", "lateral as in full", "false")
    return _table(f"Stopping early, setting default, {variant}: share of runs", head, rows) if rows else ""


def _stopped_elsewhere(calibration: Calibration) -> str:
    """Return the same for the other settings, in brief."""
    rows = []
    for setting, variants in calibration.early.items():
        for variant, by in variants.items():
            worst = min(by, key=lambda name: by[name]["equal"])
            saved = (f"{mean_saved(by[name])[0]:.3f}" for name in SAVERS)
            false = max(by, key=lambda name: by[name]["false"])
            least = f"{by[worst]['equal'] / by[worst]['runs']:.3f} ({worst})"
            most = f"{by[false]['false'] / by[false]['runs']:.3f}"
            rows.append((setting, variant.split()[0], *saved, least, most))
    head = ("setting", "counterfactuals", *SAVERS, "verdict as in full, least", "false, most")
    return _table("Stopping early: mean share of calls saved", head, rows) if rows else ""


def _ever(calibration: Calibration) -> str:
    """Return how often each null of early stopping was ever rejected."""
    rows = []
    n = early_stops.DRAWS * calibration.replications
    for null, count in zip(early_stops.NULLS, calibration.ever, strict=False):
        low, high = clopper_pearson(count, n)
        rows.append((null.claim, null.says, f"{count / n:.4f} [{low:.4f}, {high:.4f}] of {n}"))
    title = "Stopping early: share of whole runs in which a true null is ever rejected, with Clopper-Pearson's interval"
    return _table(title, ("claim", "its null", "ever rejected"), rows) if rows else ""


def _adversaries(calibration: Calibration) -> str:
    """Return each adversary's labels, and how often they were false."""
    rows = []
    for name, counts in calibration.adversaries.items():
        one, n = ADVERSARIES[name], sum(counts.values())
        said = ", ".join(f"{label} {count / n:.3f}" for label, count in sorted(counts.items(), key=lambda at: -at[1]))
        false = sum(count for label, count in counts.items() if one.is_false(*label.split("/")))
        rows.append((name, one.says, one.deserves, said, f"{false / n:.3f}"))
    title = "Adversaries, setting default, with counterfactuals and controls: share of each label / lateral label"
    return _table(title, ("adversary", "what it does", "deserves", "is called", "untrue"), rows) if rows else ""


def _targets(calibration: Calibration) -> str:
    wanted = ", ".join(f"false {claim} {variant} at most {most}" for (claim, variant), most in FALSE.items())
    says = f"Targets: right at least .95 with counterfactuals for {', '.join(WANTED)}; {wanted}."
    if calibration.early:
        least = ", ".join(f"{share} for {name}" for name, share in SAVERS.items())
        says += f" Stopping early, setting default: verdict as in full at least {EQUAL} for every controller, calls"
        says += f" saved with counterfactuals at least {least}, no null rejected above {early_stops.EVER}."
    misses, named = calibration.misses(), [f"named: {one}" for one in calibration.limits()]
    return "\n".join([says, *named, *([f"missed: {one}" for one in misses] or ["All targets hold."])])
