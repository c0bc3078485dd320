"""The order for a look: its subject, its bill, and the functions that report progress."""

import re
import shlex
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from eyechart.costs import CostEstimate, duration
from eyechart.errors import SpecError
from eyechart.ledger import Ledger
from eyechart.looks.answer import PYTHON, NextStep
from eyechart.looks.pictures import Pictures
from eyechart.manifest import LEDGER, is_run, read_manifest
from eyechart.models import OpenedModel
from eyechart.models.http import is_loopback
from eyechart.models.prices import OWN_MACHINE
from eyechart.modes import RequestMode, read_mode
from eyechart.planned_run import Bar
from eyechart.run import failed_on_the_road
from eyechart.studies import ReadOptions, study_of

_NO_NAME = re.compile(r"[^A-Za-z0-9._]+")
_ARGUMENTS = {"frames": "bank", "map": "columns"}
"""Python names of command options that differ."""
MODE = "mode.toml"
"""The request mode that a look found, in its folder."""
UNASKED_CALLS = 100
"""This many calls of unknown price need no consent."""


@dataclass(frozen=True)
class LookRequest:
    """A model or a policy, the pictures to test it on, and the folder for all files.

    ``by_file`` says that a request mode is given, and ``file`` is its file, if any. ``held`` is an
    open callable. ``budget`` limits the calls. ``again`` retries those that failed in transport.
    ``python`` was named as the one that has LeRobot.
    """

    mode: RequestMode
    pictures: Pictures
    out: Path
    by_file: bool = False
    prompt: str | None = None
    seed: int = 0
    budget: int | None = None
    held: OpenedModel | None = None
    file: Path | None = None
    again: bool = False
    python: Path | None = None

    @property
    def spec(self) -> str:
        """Return the SPEC of the model or policy."""
        return self.mode.spec

    @property
    def run(self) -> Path:
        """Return the folder of the run."""
        return self.out / "run"

    @property
    def report(self) -> Path:
        """Return the page's path."""
        return self.out / "report.html"

    def require_own_folder(self) -> None:
        """Raise SpecError if the folder is a file, or holds a look at another model, whose mode would be lost."""
        if self.out.exists() and not self.out.is_dir():
            raise SpecError(f"{self.out} is a file, and a look needs a folder: give another --out")
        kept = self.out / MODE
        before = read_manifest(self.run).models if is_run(self.run) else ()
        of = [*before] or ([read_mode(kept).spec] if kept.is_file() else [])
        if of and self.spec not in of:
            raise SpecError(f"{self.out} holds a look at {', '.join(of)}, not at {self.spec}: give another --out")

    def command(self, *, prompt: str | None = None, out: Path | None = None, again: bool = False) -> str:
        """Return the command that looks again, with another prompt or folder, or at failed calls.

        It is Python code for a function in ``__main__`` of a session or notebook, which a command
        cannot reach.
        """
        given = self._given | ({} if prompt is None else {"prompt": prompt}) | {"out": str(out or self.out)}
        given |= {"again": True} if again else {}
        module, _, name = self.spec.removeprefix("python:").rpartition(":")
        if module == "__main__":
            named = {_ARGUMENTS.get(one, one): value for one, value in given.items()}
            return f"{PYTHON}{', '.join([name, *(f'{one}={value!r}' for one, value in named.items())])})"
        words: list[str] = []
        for one, value in given.items():
            many = [f"{a}={b}" for a, b in value.items()] if isinstance(value, dict) else [str(value)]
            option = f"--{one.replace('_', '-')}"
            words += [option] if value is True else [word for each in many for word in (option, each)]
        return shlex.join(["eyechart", "look", self.spec, *words])

    def continued(self) -> Iterator[NextStep]:
        """Yield how to go on with an unfinished run; changed code of a callable needs another folder."""
        yield NextStep("continue where it stopped", self.command())
        if self.spec.startswith("python:"):
            again = self.command(out=self.out.with_name(f"{self.out.name}-2"))
            yield NextStep("if its code is changed first, look in another folder", again)

    @property
    def _given(self) -> dict[str, str | int | float | dict[str, str]]:
        """Return the options that a resumed look needs, by the command's names."""
        of = self.pictures
        paths = {"frames": of.frames, "photos": of.photos, "table": of.table, "dataset": of.dataset, "mode": self.file}
        paths["lerobot_python"] = self.python
        given: dict[str, str | int | float | dict[str, str] | None] = {
            **{name: None if path is None else str(path) for name, path in paths.items()},
            "threshold": of.threshold,
            "unit": of.unit,
            "map": dict(of.columns),
            "base_url": "" if self.by_file else self.mode.base_url,
            "prompt": self.prompt,
            "seed": self.seed,
            "budget": self.budget,
        }
        return {
            name: value for name, value in given.items() if value not in (None, "", {}) and (name, value) != ("seed", 0)
        }

    def begun(self, frames: int, usual: int) -> list[str]:
        """Return in words that an existing run keeps its frames, if they are fewer than usual."""
        more = self.command(out=self.out.with_name(f"{self.out.name}-2"))
        goes_on = f"{self.out} was started on {frames} of {usual} frames, and keeps those, whatever the budget"
        return [f"{goes_on}; more frames need another folder: '{more}'"][: frames < usual]


def failed(wanted: LookRequest) -> int:
    """Return the number of calls of a look's run that failed in transport, and may be asked again."""
    if not is_run(wanted.run):
        return 0
    with Ledger(wanted.run / LEDGER) as ledger:
        return len(failed_on_the_road(ledger, [wanted.spec]))


def folder_name(spec: str) -> str:
    """Return the folder name of a look at a SPEC."""
    return _NO_NAME.sub("-", spec).strip("-.") or "look"


@dataclass(frozen=True)
class Bill:
    """The most that calls take: dollars (None without a price), seconds (None if unmeasured).

    ``usual`` is the number of calls in a frequent case, which ``when`` names: a model that never
    looks is settled early.
    """

    mode: RequestMode
    expected: CostEstimate
    basis: str
    usual: int | None = None
    when: str = "if it never looks"

    @property
    def is_own(self) -> bool:
        """Return whether the model runs on the user's own machine, so that it costs nothing."""
        own = self.mode.spec.partition(":")[0] in (*OWN_MACHINE, "python", "trained", "lerobot")
        return own or bool(self.mode.base_url and is_loopback(self.mode.base_url))

    @property
    def is_free(self) -> bool:
        """Return whether no consent is needed: no cost, or few calls of unknown price."""
        one = self.expected
        return self.is_own or not one.calls or (one.cost_usd is None and one.calls <= UNASKED_CALLS)

    @property
    def words(self) -> str:
        """Return the bill in one line."""
        one = self.expected
        usual = "" if self.usual is None else f" (about {self.usual} {self.when})"
        time = "minutes not known yet" if one.seconds is None else f"about {duration(one.seconds)}"
        cost = "cost not known" if one.cost_usd is None else f"at most ${one.cost_usd:.2f} {self.basis}"
        return f"at most {one.calls} calls{usual}, {time}, {'no cost' if self.is_own else cost}"


@dataclass(frozen=True)
class Watch:
    """Functions that report a look; ``agree`` accepts the bill or raises SpecError."""

    say: Callable[..., None]
    bar: Bar
    agree: Callable[[Bill], None]


def write_report(wanted: LookRequest, bank: Path, watch: Watch, *, has_new_calls: bool) -> None:
    """Write the run's page; an existing page stays if no call was made since."""
    from eyechart.report.page import write_page  # noqa: PLC0415 - it draws figures

    if wanted.report.is_file() and not has_new_calls:
        return
    with watch.bar("report", "pages") as move:
        made = study_of(wanted.run, "report").report([wanted.run], [bank], ReadOptions(), lambda _: None)
        write_page(made.page, wanted.report)
        move(1, 1)
