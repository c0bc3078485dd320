"""Tables for the terminal of what drove: the ladder, the paper's beside it, paired differences, and the audit."""

from collections.abc import Mapping, Sequence

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from eyechart.episodes import Unfinished
from eyechart.report.tables import number, p_value
from eyechart.stats.statistic import Statistic
from eyechart.studies.closed_loop import Blind, Degeneracy, Driver, Paired, Replay, Rung
from eyechart.studies.closed_loop.published import PUBLISHED, Beside, leads, unlike

_DIGITS = {"distance_m": 1, "reward": 2, "speed_mps": 1}
NAMES = {
    "distance_m": "distance (m)",
    "reward": "reward",
    "speed_mps": "speed (m/s)",
    "crash_rate": "crash",
    "success_rate": "success",
}
"""What the columns of the ladder are called."""

NARROWEST = 16
"""A driver's name is folded to as few characters before a number beside it is cut."""


def shown(one: Statistic, name: str, *, signed: bool = False) -> str:
    """Return a number of the ladder with its interval; a rate in percent."""
    scale, digits, sign = (100.0, 1, "%") if name.endswith("_rate") else (1.0, _DIGITS[name], "")
    if one.value is None:
        return "—"
    form = f"{{:+.{digits}f}}" if signed else f"{{:.{digits}f}}"
    value = form.format(scale * one.value)
    if one.ci is None:
        return value + sign
    return f"{value}{sign} [{form.format(scale * one.ci[0])}, {form.format(scale * one.ci[1])}]"


def ladder_table(rungs: Sequence[Rung], references: Mapping[str, Driver]) -> Table:
    """Return one row a driver, the best by reward first; the reference is marked."""
    caption = (
        "[ ] 95 % interval: episodes resampled, of a rate exact (Clopper-Pearson). * what the others are held against"
    )
    table = Table(box=SIMPLE_HEAD, pad_edge=False, caption=caption, caption_justify="left")
    table.add_column("policy", overflow="fold", min_width=NARROWEST)
    for name in ("n", *NAMES.values()):
        table.add_column(name, justify="right", no_wrap=True)
    several = len({one.driver.simulator for one in rungs}) > 1
    for one in sorted(rungs, key=lambda each: (each.driver.simulator, -(each.statistics["reward"].value or 0.0))):
        where = f"{one.driver.simulator} · " if several else ""
        star = " *" if references.get(one.driver.simulator) == one.driver else ""
        errors = f" + {one.errors} in error" if one.errors else ""
        cells = [shown(one.statistics[name], name) for name in NAMES]
        table.add_row(Text(f"{where}{one.driver.label}{star}"), f"{one.statistics['reward'].n}{errors}", *cells)
    return table


def paper_table(rows: Sequence[Beside]) -> Table:
    """Return Table t:baselines: ours, the paper's and the difference, in percent or for crashes in points."""
    title = "Table t:baselines: ours | the paper's (difference in %, of crashes in points)"
    table = Table(box=SIMPLE_HEAD, pad_edge=False, title=title, title_justify="left")
    table.add_column("policy", overflow="fold", min_width=NARROWEST)
    columns = ("distance_m", "reward", "speed_mps", "crash_rate")
    for name in columns:
        table.add_column(NAMES[name], justify="right", no_wrap=True)
    for row in rows:
        cells = []
        for name in columns:
            value, theirs = row.rung.statistics[name].value, PUBLISHED[row.rung.driver.policy][name]
            scale, digits = (100.0, 1) if name == "crash_rate" else (1.0, _DIGITS[name])
            by = row.differences.get(name)
            mine = "—" if value is None else f"{scale * value:.{digits}f}"
            cells.append(f"{mine} | {scale * theirs:.{digits}f} ({'—' if by is None else f'{100 * by:+.1f}'})")
        table.add_row(Text(row.rung.driver.policy), *cells)
    return table


def paper_words(rows: Sequence[Beside], rungs: Sequence[Rung]) -> list[str]:
    """Return in words who leads, and which rows lie further from the paper than 2 % (in crashes: one episode)."""
    words = [unlike(rows)] if unlike(rows) else []
    real = [one for one in rungs if one.driver.condition == "real"]
    best = {NAMES[name]: " and ".join(who) for name, who in leads(real).items()}
    if best:
        words.append("best: " + "; ".join(f"{name} {who}" for name, who in best.items()))
    near = [row.rung.driver.policy for row in rows if not row.apart]
    if near:
        words.append(f"within 2 % of the paper, and one episode in crashes: {', '.join(near)}")
    for row in rows:
        if row.apart:
            apart = ", ".join(
                f"{NAMES[name]} {100 * row.differences[name]:+.1f}{' points' if name == 'crash_rate' else ' %'}"
                for name in row.apart
            )
            words.append(f"differs: {row.rung.driver.policy}: {apart}")
    return words


def unfinished_words(found: Mapping[str, Sequence[Unfinished]]) -> list[str]:
    """Return what is left of the runs, and why, a line a policy."""
    return [f"{f'{run} · ' if run else ''}{one.policy}: {one.words}" for run, left in found.items() for one in left]


def paired_table(found: Sequence[Paired], title: str, caveat: str = "") -> Table:
    """Return one row a comparison: first less second in the same worlds, with the p that Holm leaves."""
    caption = Text(caveat) if caveat else None
    table = Table(box=SIMPLE_HEAD, pad_edge=False, title=Text(title), title_justify="left", caption=caption)
    table.caption_justify = "left"
    table.add_column("policy", overflow="fold", min_width=NARROWEST)
    table.add_column("worlds", justify="right")
    for name in NAMES.values():
        table.add_column(name, justify="right", no_wrap=True)
    for one in found:
        table.add_row(Text(one.first.label), str(one.worlds), *_stacked(one))
    return table


def blind_table(found: Sequence[Blind]) -> Table:
    """Return one row a policy and condition: real less the condition, with the p that Holm leaves."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, title="Real pictures less others, same worlds", title_justify="left")
    table.add_column("policy", overflow="fold", min_width=NARROWEST)
    for name in ("less", "finding"):
        table.add_column(name, no_wrap=True)
    for name in ("worlds", *NAMES.values()):
        table.add_column(name, justify="right", no_wrap=True)
    for one in found:
        label = f"{one.driver.run} · {one.driver.policy}" if one.driver.run else one.driver.policy
        finding = one.finding.replace("_", " ")
        table.add_row(Text(label), one.condition, finding, str(one.paired.worlds), *_stacked(one.paired))
    return table


def _stacked(one: Paired) -> list[str]:
    """Return each difference above its interval and its p, so that the table stays narrow."""
    cells = [shown(one.differences[name], name, signed=True).replace(" [", "\n[") for name in NAMES]
    return [f"{cell}\np {p_value(one.holm.get(name))}" for name, cell in zip(NAMES, cells, strict=True)]


def degeneracy_table(rows: Sequence[Degeneracy]) -> Table:
    """Return Table t:degeneracy, with the episode-safe p beside the paper's and the parse failures."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, title="Degeneracy audit (Table t:degeneracy)", title_justify="left")
    several = len({row.driver.simulator for row in rows}) > 1
    table.add_column("model", overflow="fold", min_width=NARROWEST)
    for name in ("n", "modal", "actions", "H (b)", "MI (b)", "MI/H", "p (paper)", "p (episodes)", "no decision"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("reads as", no_wrap=True)
    for row in rows:
        found = row.statistics
        varies = (found["distinct_actions"].value or 0) > 1
        mi, share = (number(found[name].value) if varies else "—" for name in ("information_bits", "information_share"))
        p, q = (p_value(one) if varies else "—" for one in (row.holm_naive, row.holm))
        table.add_row(
            Text(f"{row.driver.simulator} · {row.driver.label}" if several else row.driver.label),
            str(found["modal_share"].n),
            number(found["modal_share"].value),
            number(found["distinct_actions"].value, 0),
            number(found["entropy_bits"].value, 2),
            mi,
            share,
            p,
            q,
            f"{100 * (found['unparsed_rate'].value or 0.0):.1f} %",
            row.label,
        )
    return table


def degeneracy_words(rows: Sequence[Degeneracy]) -> list[str]:
    """Return what the table leaves to words: the geometry, what the two p are, and why one cannot be said."""
    words = []
    geometries: dict[str, list[str]] = {}
    for row in rows:
        geometries.setdefault(row.geometry or "none: the truth has no gap", []).append(row.driver.simulator)
    words += [f"scene geometry in {', '.join(dict.fromkeys(who))}: {what}" for what, who in geometries.items()]
    words.append(
        "p (paper): steps permuted one by one, as if they were independent; p (episodes): whole episodes exchanged. "
        "Both Holm-corrected over these rows, a constant one counted with p = 1"
    )
    for row in rows:
        safe = row.statistics["information_episode_safe"]
        if safe.value is None and safe.p is None and not row.constant:
            words.append(f"{row.driver.label}: no episode-safe p: {safe.note}")
    return words


def replay_table(found: Sequence[Replay]) -> Table:
    """Return one row a driver and scripted controller: agreement, the best constant's, and that in shuffled order."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, title="Decision-level replay", title_justify="left")
    table.add_column("model", overflow="fold", min_width=NARROWEST)
    table.add_column("controller", no_wrap=True)
    several = len({one.driver.simulator for one in found}) > 1
    for name in ("n", "agrees", "best constant", "shuffled order", "p"):
        table.add_column(name, justify="right", no_wrap=True)
    for one in found:
        where = f"{one.driver.simulator} · " if several else ""
        best = one.best_constant
        constant = "—" if best is None else f"{best[0]} {best[1]:.3f}"
        agrees, shuffled = (share(each) for each in (one.agreement, one.shuffled))
        p = p_value(one.shuffled.p)
        table.add_row(
            Text(f"{where}{one.driver.label}"), one.controller, str(one.agreement.n), agrees, constant, shuffled, p
        )
    return table


def share(one: Statistic) -> str:
    """Return a share with its interval, to three digits."""
    if one.value is None:
        return "—"
    return f"{one.value:.3f}" + ("" if one.ci is None else f" [{one.ci[0]:.3f}, {one.ci[1]:.3f}]")
