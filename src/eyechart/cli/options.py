"""Options that several commands share, and the request modes that they give."""

import inspect
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

if TYPE_CHECKING:
    from eyechart.planned_run import RunAllowance
    from eyechart.studies.probes import RunModes

Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
PriceFile = Annotated[Path | None, typer.Option(help="FILE.toml of prices, used before the built-in table.")]
Mode = Annotated[
    list[Path] | None,
    typer.Option(help="A model's request mode, which names its model: FILE.toml, or a name of 'eyechart list modes'."),
]
Model = Annotated[list[str] | None, typer.Option(help="A model's SPEC; repeat for more models.")]
Frames = Annotated[Path, typer.Option(help="Folder of the frame bank.")]
Out = Annotated[Path, typer.Option(help="Folder of the run; the same one resumes it.")]
Prompt = Annotated[
    str | None, typer.Option(help="A name of 'eyechart list prompts', or FILE.toml; default: one that suits the bank.")
]
Conditions = Annotated[str | None, typer.Option(help="Conditions with commas; default: all that the bank has.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of stimuli, sampling and the order of calls.")]
Shard = Annotated[str | None, typer.Option(help="i/n: make only this part of the calls; join with 'merge'.")]


def _name_lerobot(python: Path | None) -> Path | None:
    """Name the Python of LeRobot's policies to this process, as its variable does; a file here comes first."""
    if python is not None:
        os.environ["EYECHART_LEROBOT_PYTHON"] = str(python.absolute() if python.exists() else python)
    return python


Limit = Annotated[int | None, typer.Option(help="Use only this many frames, spread over the episodes.")]
Concurrency = Annotated[int, typer.Option(min=1, help="Concurrent calls per model.")]
Episodes = Annotated[int, typer.Option(min=1, help="Concurrent episodes per model.")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Print the plan and make no call.")]
DryDrive = Annotated[bool, typer.Option("--dry-run", help="Print the plan; make no drive and no call.")]
DriveAgain = Annotated[bool, typer.Option("--again", help="Drive again what ended in an error.")]
AskAgain = Annotated[
    bool, typer.Option("--again", help="Retry calls that failed in transport (not refusals, not answers).")
]
LeRobotPython = Annotated[
    Path | None,
    typer.Option(help="Python that has LeRobot, for a lerobot: SPEC.", callback=_name_lerobot, metavar="PYTHON"),
]
Independent = Annotated[
    bool, typer.Option("--independent", help="Declare that frames outside episodes are independent draws.")
]
Reread = Annotated[
    bool, typer.Option("--reread", help="Read again the replies that another version of the reader read.")
]
Fresh = Annotated[bool, typer.Option("--fresh", help="Read the run anew, whatever was kept of an earlier reading.")]
Steps = Annotated[
    list[str] | None,
    typer.Option("--step", metavar="SPEC=N", help="For policies: the training step of a checkpoint; repeat for more."),
]
Against = Annotated[
    str | None, typer.Option(help="For drives: the policy to compare the others with; default: the best constant.")
]


AcceptLoss = Annotated[
    bool, typer.Option("--accept-loss", help="Continue even if the ledger lost some finished calls.")
]


def accept(out: Path) -> None:
    """Accept the losses of a run's ledgers, and print each."""
    from eyechart.cli.terminal import say
    from eyechart.studies.probes import accept_losses

    for ledger, lost in accept_losses(out):
        say(f"{lost.words} that were written to {ledger} are lost: the run continues without them")


@dataclass(frozen=True)
class CostLimits:
    """What a run may spend, and whether it starts without a probe."""

    max_calls: Annotated[int | None, typer.Option(min=1, help="Stop at this many requests in total.")] = None
    max_cost: Annotated[float | None, typer.Option(min=0, help="Stop at this many US dollars in total.")] = None
    prices: PriceFile = None
    no_probe: Annotated[bool, typer.Option("--no-probe", help="Do not probe first; ask as the options say.")] = False
    accept_loss: AcceptLoss = False
    moved: Annotated[
        bool, typer.Option("--moved", help="Continue a run although its server, key or headers changed (recorded).")
    ] = False
    watch: Annotated[
        bool, typer.Option("--watch", help="Serve a page on this machine that shows the run as it goes.")
    ] = False
    sequential: Annotated[
        bool | None,
        typer.Option(
            "--sequential/--together",
            help="Ask models one after another, with only one open at a time, or all at once. Default: local models "
            "(hf:, ollama:) one after another.",
            show_default=False,
        ),
    ] = None

    def allowed(self, out: Path, *, dry_run: bool, **more: Any) -> "RunAllowance":  # noqa: ANN401 - those of RunAllowance
        """Return what a command allows its run; the user's prices come before the built-in ones.

        If the command says so, it first accepts what the ledgers lost.
        """
        from eyechart.models.prices import read_prices
        from eyechart.planned_run import RunAllowance

        if self.accept_loss and not dry_run:
            accept(out)
        given = {name: value for name, value in vars(self).items() if name not in {"prices", "accept_loss"}}
        return RunAllowance(read_prices(self.prices), dry_run=dry_run, **given, **more)


NO_LIMIT = CostLimits()


@dataclass(frozen=True)
class EndpointOptions:
    """The options that reach models without a mode file, also in studies of reply forms."""

    base_url: Annotated[str | None, typer.Option(help="Address of the server, as http://127.0.0.1:8000/v1.")] = None
    key_env: Annotated[str | None, typer.Option(help="Environment variable with the key.")] = None
    token_field: Annotated[
        str | None, typer.Option(help="The field that the model takes: max_tokens or max_completion_tokens.")
    ] = None
    temperature: Annotated[str | None, typer.Option(help="Default 0; 'default' leaves it to the endpoint.")] = None
    system: Annotated[
        str | None, typer.Option(help="The role of the system words: system, or user if the server refuses that role.")
    ] = None
    answer: Annotated[
        str | None,
        typer.Option(help="text, or reasoning: where the text is empty, the end of the reasoning is the answer."),
    ] = None
    stream: Annotated[
        str | None,
        typer.Option(help="none; usage: stream the reply and its token counts; plain: stream without counts."),
    ] = None
    timeout: Annotated[float | None, typer.Option(help="Seconds for a whole reply; default 120.")] = None
    header: Annotated[list[str] | None, typer.Option(help="'NAME: VALUE'; a secret as 'NAME: $VARIABLE'.")] = None
    body: Annotated[list[str] | None, typer.Option(help="KEY=JSON, merged into the request.")] = None
    option: Annotated[
        list[str] | None, typer.Option(help="KEY=VALUE for the adapter, as device=cuda or think=false.")
    ] = None

    def given(self) -> dict[str, object]:
        """Return the request-mode fields that options set; raises SpecError for a wrong pair."""
        from eyechart.modes import fields_in_words

        return fields_in_words(vars(self))


@dataclass(frozen=True)
class RequestOptions(EndpointOptions):
    """How to ask models without a mode file."""

    max_tokens: Annotated[int | None, typer.Option(help="Token budget of a reply; default 1024.")] = None
    json_mode: Annotated[
        str | None,
        typer.Option(help="How JSON is required of the server: none, json_object, json_schema or tool_call."),
    ] = None


ADDRESSED = EndpointOptions()
AS_USUAL = RequestOptions()


@dataclass(frozen=True)
class ClusterOptions:
    """Where a run asks its models."""

    engine: Annotated[
        str, typer.Option(help="Where models are asked: local, or ray, by actors on the cluster of RAY_ADDRESS.")
    ] = "local"
    workers: Annotated[int, typer.Option(min=1, help="With --engine ray: actors that hold each model.")] = 1
    gpus: Annotated[float, typer.Option(min=0, help="With --engine ray: GPUs that each actor claims, as 1 or 0.5.")] = 0


@dataclass(frozen=True)
class NoClusterOptions:
    """No options: the models of drives are asked by the coordinator."""


ON_THIS_MACHINE = ClusterOptions()


@dataclass(frozen=True)
class ModelRunOptions:
    """How a run asks its models, how many calls run at once, and what it may spend."""

    concurrency: Concurrency = 8
    how: RequestOptions = AS_USUAL
    spending: CostLimits = NO_LIMIT
    again: AskAgain = False
    dry_run: DryRun = False
    cluster: ClusterOptions = ON_THIS_MACHINE

    def run_modes(self, specs: Sequence[str] | None, files: Sequence[Path] | None, **more: object) -> "RunModes":
        """Return the request modes of a command's models."""
        from eyechart.cli.terminal import say
        from eyechart.studies.probes import read_modes

        return read_modes(specs, files, self.how.given() | more, say)

    def allowed(self, out: Path, **more: Any) -> "RunAllowance":  # noqa: ANN401 - those of RunAllowance
        """Return what a command allows its run, as `CostLimits` does."""
        at_once = {"concurrency": self.concurrency, "again": self.again, **vars(self.cluster)}
        return self.spending.allowed(out, dry_run=self.dry_run, **at_once, **more)


@dataclass(frozen=True)
class FormRunOptions(ModelRunOptions):
    """`ModelRunOptions` for a study that varies the form of replies."""

    how: EndpointOptions = ADDRESSED  # type: ignore[assignment]


@dataclass(frozen=True)
class DriveOptions(ModelRunOptions):
    """`ModelRunOptions` for drives."""

    concurrency: Episodes = 8
    again: DriveAgain = False
    dry_run: DryDrive = False
    cluster: NoClusterOptions = NoClusterOptions()  # type: ignore[assignment]


@dataclass(frozen=True)
class PolicyRunOptions(ModelRunOptions):
    """`ModelRunOptions` for policies: those called here are called one at a time."""

    concurrency: Annotated[
        int | None,
        typer.Option(min=1, help="Concurrent calls per policy; default: 1, and 8 for a model that answers in words."),
    ] = None  # type: ignore[assignment]

    def allowed(self, out: Path, **more: Any) -> "RunAllowance":  # noqa: ANN401 - as in ModelRunOptions
        """Return what a command allows its run; ``in_words`` says that models answer in words."""
        usual = 8 if more.pop("in_words") else 1
        at_once = {"concurrency": self.concurrency or usual, "again": self.again, **vars(self.cluster)}
        return self.spending.allowed(out, dry_run=self.dry_run, **at_once, **more)


MADE, FORMS_MADE, DRIVEN, POLICIES_MADE = (
    ModelRunOptions(),
    FormRunOptions(),
    DriveOptions(),
    PolicyRunOptions(),
)


def names(given: str | None) -> list[str] | None:
    """Return the names in a list with commas; None if there is no list."""
    return None if given is None else [one.strip() for one in given.split(",")]


def filled(words: str) -> tuple[str, ...]:
    """Return the names in a list with commas, without empty ones."""
    return tuple(name.strip() for name in words.split(",") if name.strip())


def expanded(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command with an option for every field of the dataclasses among its parameters.

    Typer reads options only from a command's signature, where commands cannot share them.
    """
    own = inspect.signature(command, eval_str=True)
    groups: dict[str, Any] = {
        parameter.name: parameter.annotation
        for parameter in own.parameters.values()
        if is_dataclass(parameter.annotation)
    }
    taken = [option for parameter in own.parameters.values() for option in _options(parameter)]

    @wraps(command)
    def run(**given: Any) -> None:  # noqa: ANN401  (as many kinds as there are options)
        for name, group in groups.items():
            given[name] = _built(group, given)
        command(**given)

    run.__signature__ = own.replace(parameters=taken)  # type: ignore[attr-defined]
    run.__annotations__ = {option.name: option.annotation for option in taken}
    return run


_GUESTS = frozenset({"mode", "model", "policy", "simulator", "spec"})
"""Parameters that may make a command import or open another person's code."""
_NAMES = frozenset({"mode"})
"""Parameters that take a name or a path; they are read before any import."""


def from_one_folder(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command whose paths stay fixed when a callable changes the working folder.

    A prompt's file is a path too, although its option also takes a name. A command that calls no
    model stays as it is.
    """
    from eyechart.cli.terminal import from_here

    if not _GUESTS & inspect.signature(command).parameters.keys():
        return command

    def placed(name: str, given: Any) -> Any:  # noqa: ANN401 - whatever an option may be
        if isinstance(given, list | tuple):
            return type(given)(placed(name, one) for one in given)
        if name == "prompt" and isinstance(given, str) and given.endswith(".toml"):
            return str(from_here(Path(given)))
        return from_here(given) if isinstance(given, Path) and name not in _NAMES else given

    @wraps(command)
    def run(**given: Any) -> None:  # noqa: ANN401
        command(**{name: placed(name, one) for name, one in given.items()})

    return run


def _options(parameter: inspect.Parameter) -> list[inspect.Parameter]:
    if not is_dataclass(parameter.annotation):
        return [parameter]
    hints = get_type_hints(parameter.annotation, include_extras=True)
    own = [
        parameter.replace(name=field.name, annotation=hints[field.name], default=field.default)
        for field in fields(parameter.annotation)
    ]
    return [option for one in own for option in _options(one)]


def _built(group: Any, given: dict[str, Any]) -> Any:  # noqa: ANN401 - a class of options, and one of them
    """Return a group of options, with the groups in it; removes them from ``given``."""
    hints = get_type_hints(group)
    parts = {field.name: _built(hints[field.name], given) for field in fields(group) if is_dataclass(hints[field.name])}
    return group(**parts, **{field.name: given.pop(field.name) for field in fields(group) if field.name not in parts})
