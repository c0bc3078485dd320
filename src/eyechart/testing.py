"""Assertions about runs for a test suite: ``assert_looks``, ``assert_grounded``."""

from collections.abc import Sequence
from pathlib import Path
from textwrap import wrap
from typing import Unpack

from eyechart.errors import finite_number, printable, speaks_of_arguments, whole_number
from eyechart.gate import Check, FurtherTerms, read_requirements
from eyechart.looks import Look
from eyechart.report.short_names import shorten
from eyechart.studies import ReadOptions, study_of
from eyechart.verdicts.labels import LOOKS

LINES, WIDTH = 24, 72
"""A failure fits on a screen of 24 lines of 80 characters, after pytest's 8 per line."""
_EACH = 4
"""Lines per check, if there are several."""


class _Terms(FurtherTerms, total=False):
    """The terms of a gate; see `assert_grounded`."""

    max_unparsed: float | None
    resamples: int
    independent: bool
    reread: bool


@speaks_of_arguments
def assert_grounded(
    run: Path | str,
    *require: str,
    max_unparsed: float | None = None,
    resamples: int = 5000,
    independent: bool = False,
    reread: bool = False,
    **terms: Unpack[FurtherTerms],
) -> None:
    """Raise AssertionError unless every model or policy of a run meets every requirement.

    ``require`` are the requirements of ``eyechart gate``. A battery has the names of
    `eyechart.gate.REQUIREMENTS` (default ``depth``) or ``looks``. Policies have an axis and a label
    (default ``camera:camera_content``). ``terms`` are those of `eyechart.gate.FurtherTerms`:
    ``order``, as ``order=0.05``, ``allow_fingerprints`` and ``made_elsewhere``. ``independent`` and
    ``reread`` are those of `eyechart.api.read_report`.
    "Cannot say" fails too, and so does an empty or unfinished run, or one with answers from several
    models. Several fingerprints of one model and answers from elsewhere fail unless a term allows
    them. The message fits on one screen: failures come first, and the others are counted;
    `eyechart.gate.hold` returns every check.
    Raises LedgerError or BankError if the folder is no run or needs ``reread``, and SpecError if
    its kind has no gate.
    """
    whole_number("resamples", resamples, 1)
    for name, given in (("max_unparsed", max_unparsed), ("order", terms.get("order"))):
        if given is not None:
            finite_number(name, given)
    study = study_of(Path(run), "gate")
    wanted = read_requirements(",".join(require) or study.required, study.requirements)
    scored = study.score(Path(run), ReadOptions(independent, reread, resamples=resamples))
    gate = study.gate(scored, wanted, max_unparsed=max_unparsed, **terms)
    if gate.exit_code:
        raise AssertionError(
            _on_a_screen([check for check in gate.checks if check.holds is not True], len(gate.checks), run)
        )


@speaks_of_arguments
def assert_looks(run: Path | str | Look, **terms: Unpack[_Terms]) -> None:
    """Raise AssertionError unless every model or policy of a run looks.

    It is ``eyechart gate --require looks``. ``run`` is a folder, or a result of `eyechart.look`.
    For policies it requires the cameras' content, as a gate does by default. ``terms`` are those of
    `assert_grounded`.
    """
    if isinstance(run, Look):
        if run.run is None:
            raise AssertionError("\n".join(run.lines()))
        run = run.run
    wanted = (LOOKS,) if LOOKS in study_of(Path(run), "gate").requirements else ()
    assert_grounded(run, *wanted, **terms)


def _on_a_screen(wrong: Sequence[Check], count: int, run: Path | str) -> str:
    """Return the checks that do not hold as at most `LINES` lines of `WIDTH`, out of ``count``."""
    if not wrong:
        return "\n".join(wrap(printable(f"{run} holds no model"), WIDTH))
    names = shorten(check.model for check in wrong)
    lines = [f"{len(wrong)} of {count} checks do not hold"]
    ordered = sorted(wrong, key=lambda check: check.holds is None)
    for done, one in enumerate(ordered):
        outcome = "cannot say" if one.holds is None else "fails"
        said = wrap(printable(f"{names[one.model]} {one.requirement}: {outcome}: {one.because}"), WIDTH)
        room = LINES - len(lines) - (done + 1 < len(ordered))
        most = min(room, _EACH if len(ordered) > 1 else LINES)
        if most < 1:
            lines.append(f"and {len(ordered) - done} more; eyechart.gate.hold gives them all")
            break
        if len(said) > most:
            said = [*said[: most - 1], f"{said[most - 1][: WIDTH - 1]}…"]
        lines += said
    return "\n".join(lines)
