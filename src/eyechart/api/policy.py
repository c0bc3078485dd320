"""Run policies with each channel exchanged, and read their report."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, TypedDict, Unpack

from eyechart.api.reports import RunReport, row_of, written_page
from eyechart.api.subjects import each_named, placed, require_arguments, require_new, require_several, still
from eyechart.errors import SpecError, speaks_of_arguments, whole_number
from eyechart.frames import FrameBank, open_bank
from eyechart.models import OpenedModel, open_policy, policy_mode
from eyechart.models.policy_callable import hold
from eyechart.models.prices import read_prices
from eyechart.models.python_callable import name_of
from eyechart.planned_run import RunAllowance, moving
from eyechart.probe import policies as doctor
from eyechart.probe.policies import PolicyDiagnosis
from eyechart.run import Progress
from eyechart.studies import policy
from eyechart.studies.policy import PolicyScore, PolicySelection
from eyechart.studies.policy.scores import judge
from eyechart.studies.probes import accept_losses
from eyechart.verdicts.policy_verdict import PolicyVerdict

if TYPE_CHECKING:  # a score needs no templates
    from eyechart.report.page import Page

AskedPolicy = str | Callable[..., object]
"""A policy: its SPEC, or a callable from (images, state, instruction) to (horizon, dimensions)."""


@dataclass(frozen=True, repr=False)
class PolicyReport(RunReport[PolicyScore, PolicyVerdict]):
    """A scored and judged run of policies, one verdict per policy.

    ``report["python:mine"].camera.label`` is a camera label. ``path`` is the run's folder,
    ``score`` holds every statistic, and ``verdicts`` maps each SPEC to its verdict. ``print`` it
    for the verdicts in words; a notebook shows them as cards.
    """

    asked: ClassVar[str] = "policy"

    def rows(self) -> list[dict[str, object]]:
        """Return every statistic of every policy as a row of values, for ``pandas.DataFrame``.

        ``low`` and ``high`` are the ends of the interval. An inconclusive value is None, and
        ``note`` says why.
        """
        return [
            row_of("policy", spec, name, statistic)
            for spec, found in self.score.models.items()
            for name, statistic in found.statistics.items()
        ]

    @speaks_of_arguments
    def to_html(self, out: Path | str) -> Path:
        """Write the report as one page, as ``eyechart report`` does, and return its path.

        Raises OutputError if the page may not be written there.
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


class _PolicyOptions(TypedDict, total=False):
    """The options of a run of policies: those of its ``plan`` and ``run``."""

    conditions: Sequence[str] | None
    seed: int
    limit: int | None
    answers: int
    shapley: bool
    timeout_s: float | None
    max_calls: int | None
    again: bool
    accept_loss: bool
    engine: str
    workers: int
    gpus: float


@speaks_of_arguments
def run_policies(
    bank: FrameBank | Path | str,
    policies: AskedPolicy | Sequence[AskedPolicy] | Mapping[str, Callable[..., object]],
    out: Path | str,
    *,
    progress: Progress | None = None,
    **asking: Unpack[_PolicyOptions],
) -> PolicyReport:
    """Ask policies about every frame of a bank with channels exchanged, and return the report.

    Calls that the folder ``out`` already holds are not repeated, so the same call resumes an
    interrupted run. ``policies`` is a SPEC, a callable, or several of them. A callable takes
    (images: dict of uint8 (h, w, 3) by camera, state: float array, instruction: str or None) and
    returns an array (horizon, dimensions). The report calls it ``python:MODULE:FUNCTION``. A
    mapping gives other names (``{"mine": act}`` is ``python:mine``). A callable may declare
    attributes, see `eyechart.models.policy_callable`.

    ``limit`` is the number of frames. A policy that samples its answers is asked ``answers`` times
    (4). ``shapley`` asks about every subset of the channels. ``conditions`` (default: all that the
    bank can show), ``seed`` and ``timeout_s`` (for an answer) are those of
    `eyechart.studies.policy.plan`. The run stops at ``max_calls``. ``again`` retries calls that
    failed in transport. With ``engine="ray"``, so many ``workers`` of the cluster of RAY_ADDRESS
    hold each policy, and each claims ``gpus``. ``accept_loss`` continues although the ledger lost finished calls.
    ``progress`` gets (calls done, total).

    Raises BankError, SpecError or LedgerError as ``plan`` does.
    """
    root, place = placed(bank), Path(out).absolute()
    require_arguments("run_policies", asking, _PolicyOptions)
    if (conditions := asking.get("conditions")) is not None:
        require_several("conditions", conditions, '["real", "blank"]')
    limit, most = (asking.get(name) for name in ("limit", "max_calls"))
    if (shapley := asking.get("shapley", False)) not in (True, False):
        raise SpecError(f"shapley must be True or False, not {shapley!r}")
    extent = PolicySelection(
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
    allowed = RunAllowance(
        read_prices(),
        max_calls=most,
        concurrency=1,
        again=asking.get("again", False),
        engine=asking.get("engine", "local"),
        workers=whole_number("workers", asking.get("workers", 1), 1),
        gpus=asking.get("gpus", 0.0),
    )
    outcome = planned.make(allowed, moving(progress))
    for spec, why in outcome.set_aside.items():
        warnings.warn(f"{spec} was set aside, and is judged by its answers before that: {why}", stacklevel=3)
    return _read(still(out, place))


@speaks_of_arguments
def read_policies(run: Path | str, *, reread: bool = False) -> PolicyReport:
    """Score and judge a run of policies, finished or not, without a call.

    ``reread`` reads the answers of an older run with today's reader. Raises LedgerError or
    BankError if the folder is no run of policies or needs ``reread``.
    """
    return _read(run, reread=reread)


@speaks_of_arguments
def examine_policy(
    bank: FrameBank | Path | str,
    policy: AskedPolicy | Mapping[str, Callable[..., object]],
    *,
    timeout_s: float | None = None,
) -> PolicyDiagnosis:
    """Test a policy with at most twenty calls, as ``eyechart doctor`` does, and return its faults.

    ``print`` the result for one line per check; ``.exit_code`` is 0 if nothing is wrong. Raises
    SpecError if it is no policy, and BankError if the bank declares no motion or has one episode.
    """
    opened = _opened(policy, timeout_s)
    if len(opened) != 1:
        raise SpecError(f"examine_policy takes one policy, not {len(opened)}")
    return doctor.examine_policy(opened[0], bank if isinstance(bank, FrameBank) else open_bank(Path(bank)))


def _read(run: Path | str, *, reread: bool = False) -> PolicyReport:
    scored = policy.score(Path(run), reread=reread)
    return PolicyReport(Path(run), scored, judge(scored))


def _opened(
    policies: AskedPolicy | Sequence[AskedPolicy] | Mapping[str, Callable[..., object]], timeout_s: float | None
) -> list[OpenedModel]:
    """Return each policy with its mode; raises SpecError for no policy, or a name twice."""
    opened: dict[str, OpenedModel] = {}
    for name, one in each_named(policies, "policy", "policies", (str,)):
        if isinstance(one, str):
            opened[one] = open_policy(one, timeout_s)
            continue
        assert callable(one)
        mode = policy_mode(f"python:{name or name_of(one)}", timeout_s)
        require_new(mode.spec, opened, "policies")
        opened[mode.spec] = OpenedModel(mode, hold(one, mode))
    return list(opened.values())
