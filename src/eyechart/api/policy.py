"""Policies: a callable of a notebook is asked with each channel exchanged, and what is said of it is read."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, TypedDict, Unpack

from eyechart.api.asked import each_named, placed, require_arguments, require_new, require_several, still
from eyechart.api.reports import Read, row_of, written_page
from eyechart.errors import SpecError, speaks_of_arguments, whole_number
from eyechart.frames import FrameBank, open_bank
from eyechart.models import Opened, open_policy, policy_mode
from eyechart.models.policy_callable import hold
from eyechart.models.prices import read_prices
from eyechart.models.python_callable import name_of
from eyechart.planned import Allowed, moving
from eyechart.probe import policies as doctor
from eyechart.probe.policies import PolicyDiagnosis
from eyechart.run import Progress
from eyechart.studies import policy
from eyechart.studies.policy import Extent, PolicyScore
from eyechart.studies.policy.scoring import judge
from eyechart.studies.probed import accept_losses
from eyechart.verdicts.channels import PolicyVerdict

if TYPE_CHECKING:  # a score needs no templates
    from eyechart.report.page import Page

AskedPolicy = str | Callable[..., object]
"""A policy: its SPEC, or a callable that takes (images, state, instruction) and returns (horizon, dimensions)."""


@dataclass(frozen=True, repr=False)
class PolicyReport(Read[PolicyScore, PolicyVerdict]):
    """A run of policies, scored and judged: ``report["python:mine"].camera.label`` is what is said of its cameras.

    ``path`` is the run's folder, ``score`` holds every statistic, ``verdicts`` maps each policy's SPEC to its verdict.
    ``print`` it for the verdicts in words; a notebook shows them as cards.
    """

    asked: ClassVar[str] = "policy"

    def rows(self) -> list[dict[str, object]]:
        """Return every statistic of every policy as plain values, a row each; ``pandas.DataFrame`` takes the list.

        ``low`` and ``high`` are the ends of the interval; what cannot be said is None, and ``note`` says why.
        """
        return [
            row_of("policy", spec, name, one)
            for spec, found in self.score.models.items()
            for name, one in found.statistics.items()
        ]

    @speaks_of_arguments
    def to_html(self, out: Path | str) -> Path:
        """Write the report as one self-contained page, as ``eyechart report`` does, and return where it is.

        Raises OutputError where the page may not be written there.
        """
        from eyechart.studies.battery.subjects import find_pictures  # noqa: PLC0415 - matplotlib is slow to import
        from eyechart.studies.policy.page import made  # noqa: PLC0415 - as above

        def page() -> "Page":
            pictures, about = find_pictures(self.score.manifest, self.score.bank, self.path)
            notes = [f"without pictures, because {about}"] if pictures is None else []
            return made([(self.score, pictures)], notes).page

        return written_page(page, out)

    def _scope(self) -> str:
        return f"the bank '{self.score.bank.name}'" if self.verdicts else "the run holds no policy"


class _Asking(TypedDict, total=False):
    """How a run of policies is planned and made: see `eyechart.studies.policy.plan` and ``run``."""

    conditions: Sequence[str] | None
    seed: int
    limit: int | None
    answers: int
    shapley: bool
    timeout_s: float | None
    max_calls: int | None
    again: bool
    accept_loss: bool


@speaks_of_arguments
def run_policies(
    bank: FrameBank | Path | str,
    policies: AskedPolicy | Sequence[AskedPolicy] | Mapping[str, Callable[..., object]],
    out: Path | str,
    *,
    progress: Progress | None = None,
    **asking: Unpack[_Asking],
) -> PolicyReport:
    """Ask policies about every frame of a bank with each of their channels exchanged, and return the report.

    The calls that the run's folder ``out`` holds already are not made again, so an interrupted call goes on where it
    stopped. ``policies`` is a SPEC, a callable, or several of them. A callable takes (images: dict of uint8 (h, w, 3)
    by camera, state: float array, instruction: str or None) and returns an array (horizon, dimensions). It is called
    ``python:MODULE:FUNCTION`` in the report; a mapping gives other names (``{"mine": act}`` is ``python:mine``). What
    it may declare of itself are attributes, see `eyechart.models.policy_callable`.

    ``limit`` asks about so many frames; who draws answers is asked ``answers`` times (4); with ``shapley`` every subset
    of the channels is asked. ``conditions`` (all that the bank can show), ``seed`` and ``timeout_s`` (for an answer)
    are those of `eyechart.studies.policy.plan`. At ``max_calls`` the run stops. ``again`` asks once more what ended in
    a failure on the way; ``accept_loss`` goes on although calls that were made are missing from the ledger.
    ``progress`` gets (calls done, of how many).

    Raises BankError, SpecError or LedgerError as ``plan`` does.
    """
    root, place = placed(bank), Path(out).absolute()
    require_arguments("run_policies", asking, _Asking)
    if (conditions := asking.get("conditions")) is not None:
        require_several("conditions", conditions, '["real", "blank"]')
    limit, most = (asking.get(name) for name in ("limit", "max_calls"))
    if (shapley := asking.get("shapley", False)) not in (True, False):
        raise SpecError(f"shapley is True or False, not {shapley!r}")
    extent = Extent(
        None if limit is None else whole_number("limit", limit, 1),
        answers=whole_number("answers", asking.get("answers", policy.ANSWERS), 1),
        shapley=shapley,
    )
    if asking.get("accept_loss", False):
        list(accept_losses(place))
    planned = policy.plan(
        root,
        _opened(policies, timeout_s := asking.get("timeout_s")),
        place,
        seed=whole_number("seed", asking.get("seed", 0), 0),
        extent=extent,
        conditions=conditions,
        timeout_s=timeout_s,
    )
    most = None if most is None else whole_number("max_calls", most, 1)
    allowed = Allowed(read_prices(), max_calls=most, concurrency=1, again=asking.get("again", False))
    outcome = planned.make(allowed, moving(progress))
    for spec, why in outcome.set_aside.items():
        warnings.warn(f"{spec} was set aside, and is judged by what it answered before: {why}", stacklevel=3)
    return _read(still(out, place))


@speaks_of_arguments
def read_policies(run: Path | str, *, reread: bool = False) -> PolicyReport:
    """Score and judge a run of policies, finished or not; it makes no call and changes nothing.

    ``reread`` reads the answers of a run that was begun under another version of the reader by today's. Raises
    LedgerError or BankError where the folder is no run of policies, or needs ``reread``.
    """
    return _read(run, reread=reread)


@speaks_of_arguments
def examine_policy(
    bank: FrameBank | Path | str,
    policy: AskedPolicy | Mapping[str, Callable[..., object]],
    *,
    timeout_s: float | None = None,
) -> PolicyDiagnosis:
    """Ask a policy at most twenty times about a few frames, and return what is amiss, as ``eyechart doctor`` says it.

    ``print`` what comes back for a line a check; ``.exit_code`` is 0 where nothing is amiss. Raises SpecError for what
    is no policy, and BankError for a bank that declares no motion or has one episode.
    """
    opened = _opened(policy, timeout_s)
    if len(opened) != 1:
        raise SpecError(f"one policy is examined at a time, not {len(opened)}")
    return doctor.examine_policy(opened[0], bank if isinstance(bank, FrameBank) else open_bank(Path(bank)))


def _read(run: Path | str, *, reread: bool = False) -> PolicyReport:
    scored = policy.score(Path(run), reread=reread)
    return PolicyReport(Path(run), scored, judge(scored))


def _opened(
    policies: AskedPolicy | Sequence[AskedPolicy] | Mapping[str, Callable[..., object]], timeout_s: float | None
) -> list[Opened]:
    """Return each policy with its mode; raises SpecError where one is none, or two callables have one name."""
    opened: dict[str, Opened] = {}
    for name, one in each_named(policies, "policy", "policies", (str,)):
        if isinstance(one, str):
            opened[one] = open_policy(one, timeout_s)
            continue
        assert callable(one)
        mode = policy_mode(f"python:{name or name_of(one)}", timeout_s)
        require_new(mode.spec, opened, "policies")
        opened[mode.spec] = Opened(mode, hold(one, mode))
    return list(opened.values())
