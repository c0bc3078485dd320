"""``look`` in Python: one answer about a model, a callable or a policy."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TypedDict, Unpack

from eyechart.api.subjects import placed, require_arguments
from eyechart.errors import SpecError, finite_number, speaks_of_arguments, whole_number
from eyechart.event_loops import Progress
from eyechart.frames import FrameBank
from eyechart.looks import Bill, Look, LookRequest, Pictures, Watch, folder_name, is_policy, spec_of
from eyechart.looks import look as looked
from eyechart.models import OpenedModel, policy_callable, policy_mode
from eyechart.models.python_callable import hold, name_of
from eyechart.modes import RequestMode


class _LookOptions(TypedDict, total=False):
    """The options of `look`."""

    bank: FrameBank | Path | str | None
    photos: Path | str | None
    table: Path | str | None
    dataset: Path | str | None
    columns: Mapping[str, str]
    threshold: float | None
    unit: str | None
    base_url: str
    prompt: str | None
    seed: int
    budget: int | None
    out: Path | str | None
    again: bool
    yes: bool


@speaks_of_arguments
def look(
    subject: str | RequestMode | Callable[..., object],
    *,
    progress: Progress | None = None,
    **how: Unpack[_LookOptions],
) -> Look:
    """Find out whether a model, a callable or a policy looks, as ``eyechart look`` does.

    ``print`` the result for the screen. ``subject`` is a SPEC, a request mode, or a callable. A
    callable is a policy if ``dataset`` or a bank of motions is given, else a controller. Frames
    come from ``bank``, from ``photos`` with their ``table``, or from the LeRobotDataset
    ``dataset``; otherwise eyechart draws them. ``columns`` maps places to columns of the table. A
    distance below ``threshold``, in ``unit``, is near. All files go to ``out`` (``looks/NAME``),
    where the same look resumes. ``budget`` limits the calls; calls that may cost raise SpecError
    unless ``yes``. ``again`` retries the calls that failed in transport. ``progress`` gets (done,
    total).

    Raises BankError, SourceError, SpecError or LedgerError as the steps do.
    """
    require_arguments("look", how, _LookOptions)
    given = {
        "frames": how.get("bank"),
        "photos": how.get("photos"),
        "table": how.get("table"),
        "dataset": how.get("dataset"),
    }
    where = {name: None if one is None else placed(one) for name, one in given.items()}
    limit, budget = how.get("threshold"), how.get("budget")
    pictures = Pictures(
        where["frames"],
        where["photos"],
        where["table"],
        where["dataset"],
        how.get("columns", {}),
        None if limit is None else finite_number("threshold", limit),
        how.get("unit"),
    )
    mode, held = _subject(subject, how.get("base_url", ""), pictures)
    wanted = LookRequest(
        mode,
        pictures,
        Path(how.get("out") or Path("looks") / folder_name(mode.spec)).absolute(),
        by_file=isinstance(subject, RequestMode),
        prompt=how.get("prompt"),
        seed=whole_number("seed", how.get("seed", 0), 0),
        budget=None if budget is None else whole_number("budget", budget, 1),
        held=held,
        again=how.get("again", False),
    )
    return looked(wanted, _watch(progress, yes=how.get("yes", False)))


def _subject(
    subject: str | RequestMode | Callable[..., object], base_url: str, pictures: Pictures
) -> tuple[RequestMode, OpenedModel | None]:
    """Return a subject's request mode, and the open callable if it is one."""
    if isinstance(subject, RequestMode):
        return subject, None
    if isinstance(subject, str):
        return RequestMode(spec_of(subject), base_url=base_url), None
    if not callable(subject):
        raise SpecError(f"look takes a SPEC, a RequestMode or a callable, not a {type(subject).__name__}")
    mode = RequestMode(f"python:{name_of(subject)}")
    if is_policy(mode.spec, pictures):
        mode = policy_mode(mode.spec)
        return mode, OpenedModel(mode, policy_callable.hold(subject, mode))
    return mode, OpenedModel(mode, hold(subject, mode))


def _watch(progress: Progress | None, *, yes: bool) -> Watch:
    @contextmanager
    def bar(what: str, unit: str) -> Iterator[Progress]:
        del what, unit
        yield progress or (lambda *_: None)

    def agree(bill: Bill) -> None:
        if not (bill.is_free or yes):
            raise SpecError(f"this may cost: {bill.words}; give yes=True to agree, or budget=CALLS for less")

    return Watch(lambda *_: None, bar, agree)
