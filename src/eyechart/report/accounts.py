"""Tables of the costs of calls, and of the findings of doctor and probe."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from rich.text import Text

from eyechart.costs import ALL, Account, UnreadReply
from eyechart.report.table import Cell, Column, Table, columns, number
from eyechart.stats.forced_choice import ForcedChoice

if TYPE_CHECKING:  # an account needs no probe
    from eyechart.probe import Diagnosis, ProbeResult

WORDS = {"sees": "it sees", "blind": "it is blind", "cannot_say": "cannot say"}
_COLOUR = {"sees": "bold green", "blind": "bold red", "cannot_say": "bold yellow"}
_YES = {True: "yes", False: "no", None: "—"}


def doctor_table(diagnosis: "Diagnosis") -> Table:
    """Return one row per check: how often it was right with n and p, and other tests."""
    rows: list[tuple[Cell, ...]] = []
    for name, score in diagnosis.scores().items():
        answered = score if isinstance(score, ForcedChoice) else None
        counted, expected = (f"{answered.right} right", answered.expected) if answered else ("—", None)
        rows.append((name if name == "all questions" else f"  {name}", counted, score.n, expected, score.p))
    (same, of), adds = diagnosis.sight.same, diagnosis.sight.image_tokens
    bare = ", ".join(repr(reply.text.strip()[:20]) for _, reply in diagnosis.sight.bare if reply.error is None)
    others: dict[str, tuple[str, int | str]] = {
        "the same words without a picture": (bare or "—", len(diagnosis.sight.bare)),
        "tokens that a picture adds": ("not reported" if adds is None else str(adds), ""),
        "the smallest detail that arrives": (diagnosis.acuity.words, sum(of for _, _, of in diagnosis.acuity.by_gap)),
        "the same picture again": (f"{same} of {of} replies the same" if of > 1 else "—", of),
        "a schema is enforced": (f"{_YES[diagnosis.schema_binds]}: {diagnosis.schema_says}", ""),
        "the token budget is enough": (f"{_YES[diagnosis.budget_enough]}: {diagnosis.budget_says}", ""),
    }
    rows += [(name, *cells, "", "") for name, cells in others.items()]
    named = (*columns("text", "check", "result"), Column("n", "count"), Column("by guessing", "number", 1))
    return Table("doctor", "", (*named, Column("p", "p")), tuple(rows))


def doctor_printed(found: "Diagnosis") -> Iterator[Table | Text | str]:
    """Yield the checks, the outcome, its causes, and what the calls took."""
    yield doctor_table(found)
    yield headline(found)
    yield from (f"likely cause: {cause}" for cause in found.causes)
    yield from (f"note: {note}; 'eyechart probe' writes that into a mode" for note in found.notes)
    if found.sight.cut is not None:
        yield f"stopped: {found.sight.cut}"
    yield f"calls: {found.spent.words}; the same pictures again: --seed {found.seed}"


def headline(found: "Diagnosis") -> Text:
    """Return the outcome in one line, with its reason."""
    text = Text(f"{found.mode.spec}: ")
    text.append(WORDS[found.outcome], style=_COLOUR[found.outcome])
    return text.append(f": {found.because}")


def probe_words(found: "ProbeResult") -> list[str]:
    """Return a probe's findings and its calls in words."""
    outcome = {**WORDS, "cannot_say": "cannot say whether it sees"}
    return [
        f"{found.mode.spec}: {outcome[found.sight.outcome]}: {found.sight.because}",
        *(f"likely cause: {cause}" for cause in found.causes),
        *(f"note: {note}" for note in found.notes),
        f"probe: {found.mode.spec}: {found.spent.words}",
    ]


def probe_table(result: "ProbeResult") -> Table:
    """Return one row per finding of a probe, with its field of the request mode."""
    mode, measured = result.mode, result.measured
    seconds = ", ".join(number(one, 2) for one in (measured.seconds, measured.seconds_min))
    temperature = "default" if mode.temperature is None else f"{mode.temperature:g}"
    rows = (
        ("sees the picture", WORDS[result.sight.outcome], ""),
        ("tokens of a reply, longest", _shown(measured.completion_tokens_max), f"max_tokens = {mode.max_tokens}"),
        ("its field", "", mode.token_field),
        ("role of the system words", "", f"system = {mode.system}"),
        ("a schema is enforced", _YES[measured.schema_binds], f"structured = {mode.structured}"),
        ("temperature matters", _YES[measured.temperature_matters], f"temperature = {temperature}"),
        ("seed matters", _YES[measured.seed_matters], f"seed = {str(mode.seed).lower()}"),
        ("unknown fields are ignored", _YES[measured.unknown_fields_ignored], ""),
        ("tokens of a prompt, of its picture", _shown(measured.prompt_tokens, measured.image_tokens), ""),
        ("seconds of a call, shortest", seconds, ""),
    )
    return Table("probe", "", columns("text", "found", "", "pinned"), rows)


def _shown(*values: float | None) -> str:
    return ", ".join("—" if value is None else f"{value:g}" for value in values)


def costs_table(accounts: Mapping[str, Mapping[str, Account]], *, every: bool) -> Table:
    """Return the costs of calls, a row per model, and with ``every`` per condition."""
    rows = tuple(
        (
            *(spec, *([name] if every else [])),
            *(one.calls, one.attempts, _reasons(one.retries), one.unknown, _reasons(one.errors), _reasons(one.missing)),
            *("—" if n is None else f"{n:,}" for n in (one.prompt_tokens, one.completion_tokens, one.reasoning_tokens)),
            *(_cost(one), one.latency_median_s, one.latency_p95_s, one.first_byte_median_s),
            "not measured" if one.energy_j is None else one.energy_j,
        )
        for spec, found in accounts.items()
        for name, one in found.items()
        if every or name == ALL
    )
    named = (
        Column("model"),
        *([Column("condition", "word")] if every else []),
        *columns("count", "calls", "attempts", "retries", "no outcome", "errors", "no decision"),
        *columns("count", "tokens in", "out", "reasoning", "cost"),
        *columns("number", "median s", "p95 s", "first byte s"),
        Column("energy", "number", 1, unit=" J"),
    )
    note = _gross(one for found in accounts.values() for one in found.values())
    return Table("costs", "what the calls took", named, rows, note)


_GROSS = (
    "Energy is gross: all that this machine's GPUs, and its processors with a counter, drew during the calls, "
    "with idle draw and the loading of weights"
)


def _gross(accounts: Iterable[Account]) -> str:
    """Return the note on energy, if any was measured."""
    return _GROSS if any(account.energy_j is not None for account in accounts) else ""


NO_PRICE = (
    "Price unknown: the endpoint reports no cost, and the dated table of prices has none. The paper's hosted "
    "models have none either, because the paper does not name their endpoint. Set a price with --prices FILE"
)

CALLABLES = ("python", "trained")
"""The adapters of functions on this machine."""
NO_PRICE_HERE = "A local callable has no price; --prices FILE can set one"


def _unpriced(accounts: Mapping[str, Account]) -> list[str]:
    """Return in words why prices are unknown."""
    specs = [spec for spec, account in accounts.items() if "unknown" in account.cost_from]
    own = [spec.partition(":")[0] in CALLABLES for spec in specs]
    return [*([NO_PRICE_HERE] if any(own) else []), *([NO_PRICE] if not all(own) else [])]


def deployment_table(accounts: Mapping[str, Account]) -> Table:
    """Return the costs of decisions, in the paper's units: a row per model.

    A decision is a call whose reply holds one. Costs per decision of an unfinished run are unknown,
    as are attempts of unknown cost or energy. Source: paper, section Transfer and deployment
    characteristics.
    """
    rows: list[tuple[Cell, ...]] = []
    for spec, account in accounts.items():
        decided = account.finished - sum(account.missing.values()) if account.finished == account.calls else 0
        dollars = None if account.cost_from.get("unknown") or account.cost_usd is None else 1000 * account.cost_usd
        joules = account.energy_j if account.energy_measured >= account.finished else None
        rows.append(
            (
                *(spec, account.finished, _each(dollars, decided), _each(account.completion_tokens, account.finished)),
                _each(account.missing.get("truncated", 0), account.finished),
                *(account.latency_median_s, account.latency_p95_s, _each(joules, decided), "/".join(account.cost_from)),
            )
        )
    named = (
        *(Column("model"), Column("calls", "count"), Column("$ per 1000 decisions", "number", 3)),
        *(Column("output tokens per call", "number", 0), Column("truncated", "number", 1, 100, "%")),
        *columns("number", "median s", "p95 s", "J per decision", digits=2),
        Column("price", "word"),
    )
    caption = "Cost, latency and energy. A decision is a call whose reply holds one"
    note = "— unknown, not measured, or the run is not finished"
    note = ". ".join(filter(None, (note, *_unpriced(accounts), _gross(accounts.values()))))
    return Table("costs", caption, named, tuple(rows), note)


def deployment_tables(accounts: Mapping[str, Account]) -> tuple[Table, ...]:
    """Return that table for a page under a file name of its own; none without models."""
    return (replace(deployment_table(accounts), name="deployment"),) if accounts else ()


def _each(total: float | None, count: int) -> float | None:
    return None if total is None or not count else total / count


def unread_table(found: Mapping[str, Sequence[UnreadReply]]) -> Table:
    """Return one row per reply without a decision, most frequent first, with the reason."""
    rows = tuple((spec, one.count, one.missing, one.why, one.text) for spec, all_of in found.items() for one in all_of)
    named = (Column("model"), Column("replies", "count"), *columns("word", "no decision", "why"), Column("reply"))
    return Table("unread", "replies without a decision", named, rows)


def _reasons(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {reason}" for reason, count in counts.items()) or "0"


def _cost(account: Account) -> str:
    if account.cost_usd is None:
        return "unknown"
    unknown = account.cost_from.get("unknown", 0)
    how = "/".join(name for name in account.cost_from if name != "unknown")
    return f"${account.cost_usd:.4f} ({how}{f'; {unknown} unknown' if unknown else ''})"
