"""What a test suite asks of a run: ``assert_grounded(run, "depth")``."""

from pathlib import Path

from eyechart.gate import hold
from eyechart.studies import battery


def assert_grounded(
    run: Path | str,
    *require: str,
    max_unparsed: float | None = None,
    resamples: int = 5000,
    independent: bool = False,
    reread: bool = False,
    allow_fingerprints: bool = False,
) -> None:
    """Raise AssertionError unless every model of a run meets every requirement.

    ``require`` are names of `eyechart.gate.REQUIREMENTS`, ``depth`` if none is given. "Cannot say" is not enough:
    an empty or unfinished run fails too, and one that several models answered, or several fingerprints of one unless
    they are allowed. ``independent`` and ``reread`` are those of `eyechart.api.read_report`. Raises
    LedgerError or BankError where the folder is no run, or needs ``reread``.
    """
    scored = battery.score(Path(run), resamples=resamples, independent=independent, reread=reread)
    gate = hold(scored, require or ("depth",), max_unparsed=max_unparsed, allow_fingerprints=allow_fingerprints)
    if gate.exit_code:
        outcome = {False: "fails", None: "cannot say"}
        wrong = [
            f"{check.model} {check.requirement}: {outcome[check.holds]}: {check.because}"
            for check in gate.checks
            if check.holds is not True
        ]
        raise AssertionError("\n".join(wrong) or f"{run} holds no model")
