"""Run policies with each channel exchanged, and read their report."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Unpack

from eyechart.api.battery import _Mode
from eyechart.api.reports import RunReport, row_of, written_page
from eyechart.api.subjects import placed, require_arguments, require_several, still, subjects_of
from eyechart.errors import SpecError, printable, speaks_of_arguments, whole_number
from eyechart.frames import FrameBank, open_bank
from eyechart.models import states
from eyechart.models.policy_callable import hold
from eyechart.models.prices import read_prices
from eyechart.modes import RequestMode
from eyechart.planned_run import RunAllowance, moving
from eyechart.probe import policies as doctor
from eyechart.probe.policies import PolicyDiagnosis
from eyechart.run import Progress
from eyechart.studies import policy
from eyechart.studies.policy import PolicyScore, PolicySelection
from eyechart.studies.policy.plans import PolicyRun
from eyechart.studies.policy.scores import judge
from eyechart.studies.probes import accept_losses
from eyechart.verdicts.policy_verdict import PolicyVerdict

if TYPE_CHECKING:  # a score needs no templates
    from eyechart.report.page import Page

AskedPolicy = str | RequestMode | Callable[..., object]
"""A policy: its SPEC or request mode, or a callable (images, state, instruction) -> array."""


@dataclass(frozen=True, repr=False)
class PolicyReport(RunReport[PolicyScore, PolicyVerdict]):
    """A scored and judged run of policies, one verdict per policy.

    ``report["python:mine"].camera.label`` is a camera label. ``path`` is the run's folder,
    ``score`` holds every statistic, and ``verdicts`` maps each SPEC to its verdict. ``print`` it
    for the verdicts in words; a notebook shows them as cards.
    """

    subject: ClassVar[str] = "policy"

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


class _PolicyOptions(_Mode, total=False):
    """The options of a run of policies: request-mode fields, and those of its ``plan`` and ``run``."""

    conditions: Sequence[str] | None
    prompt: str | None
    seed: int
    limit: int | None
    answers: int
    shapley: bool
    max_calls: int | None
    max_cost: float | None
    concurrency: int
    probe: bool
    again: bool
    accept_loss: bool
    moved: bool
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
    bank can show) and ``seed`` are those of `eyechart.studies.policy.plan`. The run stops at
    ``max_calls``, or at ``max_cost`` US dollars. ``again`` retries calls that failed in transport.
    With ``engine="ray"``, so many ``workers`` of the cluster of RAY_ADDRESS hold each policy, and
    each claims ``gpus``. ``accept_loss`` continues although the ledger lost finished calls.
    ``moved`` continues although addresses, keys or headers of policies changed. ``progress`` gets
    (calls done, total).

    A served model that states a motion in words (``openai:``, ``ollama:``, ``hf:``) is a policy too.
    ``prompt`` is the TOML file that asks it; ``concurrency`` (8) calls are made at once. Given by
    its SPEC it is probed first, unless ``probe`` is false. ``base_url``, ``max_tokens``,
    ``timeout_s`` and the other fields of a `eyechart.modes.RequestMode` (all but ``seed``) apply to
    policies that are not given by a request mode.

    Raises BankError, SpecError or LedgerError as ``plan`` does, and ProbeError if a probe fails.
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
    patient = asking.get("timeout_s") is not None
    how: dict[str, Any] = {
        name: one for name, one in asking.items() if name in _Mode.__annotations__ and (patient or name != "timeout_s")
    }
    subjects = subjects_of(policies, "policy", "policies", how, hold)
    planned_of = partial(
        policy.plan,
        root,
        out=place,
        seed=whole_number("seed", asking.get("seed", 0), 0),
        extent=extent,
        conditions=conditions,
        prompt=asking.get("prompt"),
    )

    most = None if most is None else whole_number("max_calls", most, 1)
    usual = 8 if any(states(mode.spec) for mode in subjects.modes) else 1
    at_once = whole_number("concurrency", asking.get("concurrency", usual), 1)
    bounds: dict[str, Any] = {"max_calls": most, "max_cost": asking.get("max_cost"), "concurrency": at_once}
    allowed = RunAllowance(
        read_prices(),
        no_probe=not asking.get("probe", True),
        again=asking.get("again", False),
        moved=asking.get("moved", False),
        engine=asking.get("engine", "local"),
        workers=whole_number("workers", asking.get("workers", 1), 1),
        gpus=asking.get("gpus", 0.0),
        **bounds,
    )
    planned: PolicyRun = subjects.planned(planned_of, [place], allowed)
    outcome = planned.make(allowed, moving(progress))
    for spec, why in outcome.set_aside.items():
        said = f"{spec} was set aside, and is judged by its answers before that: {printable(why)}"
        warnings.warn(said, stacklevel=3)
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
    prompt: str | None = None,
) -> PolicyDiagnosis:
    """Test a policy with at most 24 calls, as ``eyechart doctor`` does, and return its faults.

    ``prompt`` is a TOML file that asks a served model for a motion in words.

    ``print`` the result for one line per check; ``.exit_code`` is 0 if nothing is wrong. Raises
    SpecError if it is no policy, and BankError if the bank declares no motion or has one episode.
    """
    subjects = subjects_of(policy, "policy", "policies", {} if timeout_s is None else {"timeout_s": timeout_s}, hold)
    if len(subjects.modes) != 1:
        raise SpecError(f"examine_policy takes one policy, not {len(subjects.modes)}")
    frames = bank if isinstance(bank, FrameBank) else open_bank(Path(bank))
    return doctor.examine_policy(subjects.held.get(subjects.modes[0].spec, subjects.modes[0]), frames, prompt=prompt)


def _read(run: Path | str, *, reread: bool = False) -> PolicyReport:
    scored = policy.score(Path(run), reread=reread)
    return PolicyReport(Path(run), scored, judge(scored))
