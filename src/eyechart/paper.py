"""What of the paper runs determine: its tables and figures by label, and what is missing for the others.

Each study says which it yields (`Study.paper`); here halves of one table that are of two kinds of run are joined.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from eyechart.destination import require_foreign
from eyechart.errors import OutputError
from eyechart.studies import Reading, Study, Tell, study_of

if TYPE_CHECKING:
    from eyechart.report.charts import Drawing
    from eyechart.report.table import Table

LABELS: Mapping[str, str] = {
    "t:conditions": "eyechart run",
    "t:baselines": "eyechart run closed-loop",
    "t:controller-local": "eyechart run structured",
    "t:mpc-intent": "eyechart run hierarchy",
    "t:degeneracy": "eyechart run closed-loop",
    "t:frontier": "eyechart run",
    "t:qwenorder": "eyechart run",
    "t:prompts": "eyechart run prompts",
    "t:positive-guardian": "eyechart guardian score",
    "fgr:mi": "eyechart run",
    "fgr:bicb": "eyechart run",
    "fgr:vlm-interface": "eyechart run structured",
}
"""The labels of the paper's tables and figures, each with the command whose run determines it."""
ELSEWHERE: Mapping[str, str] = {
    "t:positive-guardian": "it is of a guardian and votes, which are no run",
    "fgr:vlm-interface": "no command writes it yet; its calibrated view is what the estimators are shown",
}
"""The labels that no run determines, and why."""


@dataclass(frozen=True)
class Artefacts:
    """The tables and figures that runs determine; ``missing`` says by label what would determine the others."""

    tables: "tuple[Table, ...]"
    drawings: "tuple[Drawing, ...]"
    missing: Mapping[str, str]


def artefacts(
    runs: Sequence[Path], banks: Sequence[Path] = (), reading: Reading | None = None, tell: Tell = lambda _: None
) -> Artefacts:
    """Return all of the paper that runs of any kinds determine; those of one kind stand in one table.

    Raises what scoring them raises.
    """
    from eyechart.report.table import Table  # noqa: PLC0415 - the list of labels needs no figures

    by_kind: dict[str, tuple[Study[object], list[Path]]] = {}  # type: ignore[type-var]
    for run in dict.fromkeys(runs):
        study = study_of(run)
        by_kind.setdefault(type(study).__qualname__, (study, []))[1].append(run)
    made = [one for study, mine in by_kind.values() for one in study.paper(mine, banks, reading or Reading(), tell)]
    tables = tuple(_joined([one for one in made if isinstance(one, Table)]))
    drawings = tuple(one for one in made if not isinstance(one, Table))
    have = {one.label for one in tables} | {one.name.replace("-", ":", 1) for one in drawings}
    missing = {
        label: f"{ELSEWHERE[label]}: {command}" if label in ELSEWHERE else f"needs a run of {command}"
        for label, command in LABELS.items()
        if label not in have
    }
    return Artefacts(tables, drawings, missing)


def _joined(tables: "Sequence[Table]") -> "Iterator[Table]":
    """Yield tables, with those of one label and other columns as one."""
    held: dict[str, Table] = {}
    for one in tables:
        before = held.get(one.label) if one.label else None
        if before is None or set(before.names[1:]) & set(one.names[1:]):
            if before is not None:
                yield before
            if one.label:
                held[one.label] = one
            else:
                yield one
        else:
            held[one.label] = before.joined(one)
    yield from held.values()


def write(found: Artefacts, folder: Path) -> list[Path]:
    """Write tables as CSV, Markdown and LaTeX, figures as SVG and PDF; return the files.

    Raises OutputError where a file may not be written there.
    """
    from eyechart.report.table import files_of  # noqa: PLC0415 - as above

    files = files_of(found.tables)
    names = [one.name for one in found.drawings]
    for place, one in enumerate(found.drawings):
        stem = f"{one.name}_{again + 1}" if (again := names[:place].count(one.name)) else one.name
        files |= {f"{stem}.svg": one.svg().encode("utf-8", "backslashreplace"), f"{stem}.pdf": one.pdf()}
    try:
        for name in files:
            require_foreign(folder / name)
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            (folder / name).write_bytes(content)
    except OSError as error:
        raise OutputError(f"{folder} cannot be written: {error.strerror}; choose another place") from error
    return [folder / name for name in files]
