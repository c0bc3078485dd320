"""``eyechart doctor`` tests whether a model sees; ``eyechart probe`` finds its request mode."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from eyechart.cli.options import AS_USUAL, Json, LeRobotPython, PriceFile, RequestOptions, expanded
from eyechart.cli.terminal import patience, print_each, print_json, progress, resumable, say
from eyechart.errors import SpecError

if TYPE_CHECKING:
    from typing import Unpack

    from eyechart.models.prices import Prices
    from eyechart.modes import RequestMode
    from eyechart.probe import ProbeResult, Sample
    from eyechart.probe.asker import ProbeOptions

_Spec = Annotated[
    str, typer.Argument(help="A model's SPEC, or its request mode: FILE.toml, or a name of 'eyechart list modes'.")
]
_Seed = Annotated[int | None, typer.Option(min=0, help="Seed of the pictures; default: a new one, which is printed.")]
_MaxCost = Annotated[float | None, typer.Option(min=0, help="Stop at this many US dollars.")]


@expanded
def doctor(
    spec: _Spec,
    seed: _Seed = None,
    how: RequestOptions = AS_USUAL,
    max_cost: _MaxCost = None,
    prices: PriceFile = None,
    frames: Annotated[
        Path | None, typer.Option(help="A bank with motions: SPEC is a policy, tested on a few of the bank's frames.")
    ] = None,
    prompt: Annotated[
        str | None, typer.Option(help="With --frames: FILE.toml that asks a model for a motion in words.")
    ] = None,
    lerobot_python: LeRobotPython = None,
    json: Json = False,
) -> None:
    """Find out in at most 28 calls whether a model sees pictures, and if not, why.

    It needs no bank. It also tests whether the model repeats its answers, whether a JSON schema is
    enforced, and whether the token budget is enough. With --frames it tests a policy: whether its
    answers are motions, which channels reach it, whether it answers from a queue, and whether its
    numbers have the log's size.
    Exit 0: it sees, or nothing is wrong; 1: it is blind, it does not look, or something is wrong;
    2: inconclusive, or bad input.
    Example: eyechart doctor openai:MODEL --base-url http://127.0.0.1:8000/v1
    """
    from eyechart.models import require_lerobot

    require_lerobot([spec], lerobot_python)
    if frames is not None:
        _doctor_policy(_mode(spec, how.given()), frames, prompt, json=json)
    if prompt is not None:
        raise SpecError("--prompt asks a policy for a motion, and needs --frames BANK: without it leave it out")
    from eyechart.models.prices import read_prices
    from eyechart.probe import doctor as examine
    from eyechart.probe.doctor import MOST_CALLS
    from eyechart.report.accounts import doctor_printed

    given = how.given()
    mode, table = _mode(spec, given), read_prices(prices)
    _say_estimate(mode, MOST_CALLS, table)
    with resumable("nothing is kept"), progress("doctor", "calls") as move:
        found = examine(mode, seed=_draw(seed), prices=table, max_cost=max_cost, tell=move)
    if json:
        print_json(found.as_dict())
    else:
        print_each(doctor_printed(found))
    raise typer.Exit(found.exit_code)


@expanded
def probe(
    spec: _Spec,
    out: Annotated[Path, typer.Option(help="FILE.toml to write the request mode to.")],
    frames: Annotated[
        Path | None, typer.Option(help="A bank whose frames and prompt to use; default: sketches.")
    ] = None,
    prompt: Annotated[str, typer.Option(help="A prompt's name or FILE.toml; works without --frames too.")] = "baseline",
    seed: _Seed = None,
    how: RequestOptions = AS_USUAL,
    max_cost: _MaxCost = None,
    prices: PriceFile = None,
    json: Json = False,
) -> None:
    """Find how to ask a model, in at most 76 calls, and write it as a request mode for --mode.

    It finds the token budget at which replies are complete, and the token field that the endpoint
    takes. It tests whether a JSON schema is enforced, whether temperature and seed matter, whether
    unknown fields are ignored, and whether the model sees the picture. It measures what a picture
    and a call take. It does not change what an option gives.
    Exit 0: the mode is written; 1: it is written, but the model is blind; 2: no mode was found, or
    bad input; 3: stopped at --max-cost.
    Example: eyechart probe openai:MODEL --base-url http://127.0.0.1:8000/v1 --out mode.toml
    """
    from eyechart.destination import require_free, whole
    from eyechart.models.prices import read_prices
    from eyechart.modes import write_mode
    from eyechart.probe.mode_probe import MOST_CALLS
    from eyechart.report.accounts import probe_table, probe_words

    given = how.given()
    require_free(out, "request mode")
    mode, table = _mode(spec, given), read_prices(prices)
    sample = _sample(frames, prompt, mode)
    _say_estimate(mode, MOST_CALLS, table)
    result = probed(mode, given, sample, "nothing is kept", seed=_draw(seed), prices=table, max_cost=max_cost)
    with whole(out, "request mode") as partial:
        write_mode(partial, result.mode)
    print_json(result.as_dict()) if json else print_each([probe_table(result), *probe_words(result)])
    say(f"wrote {out}: ask this model with --mode {out}")
    if result.sight.outcome == "blind":
        raise typer.Exit(1)


def _doctor_policy(mode: "RequestMode", frames: Path, prompt: str | None, *, json: bool) -> NoReturn:
    """Print what is wrong with a policy; exit 0, 1 or 2."""
    from eyechart.frames import open_bank
    from eyechart.probe.policies import MOST_CALLS, examine_policy

    with resumable("nothing is kept"), patience("doctor") as under_way:
        diagnosis = examine_policy(
            mode,
            open_bank(frames),
            prompt=prompt,
            tell=lambda number: under_way(f"call {number} of at most {MOST_CALLS}"),
        )
    if json:
        print_json(diagnosis.as_dict())
    else:
        print_each(diagnosis.lines())
    raise typer.Exit(diagnosis.exit_code)


def _mode(spec: str, given: Mapping[str, object]) -> "RequestMode":
    """Return a SPEC's request mode with the options, or that of a file, which takes none."""
    from eyechart.models import known_modes
    from eyechart.modes import mode_of
    from eyechart.studies.probes import read_modes

    if spec.endswith(".toml") or spec in known_modes():
        return read_modes(None, [Path(spec)], given, say).modes[0]
    return mode_of(spec, given)


def _draw(given: int | None) -> int:
    """Return the given seed, or a new one: no cache knows its pictures."""
    import secrets

    return secrets.randbelow(10**6) if given is None else given


def _sample(frames: Path | None, prompt: str, mode: "RequestMode") -> "Sample":
    from eyechart.probe import default_sample

    if frames is None:
        return default_sample(prompt)
    from eyechart.studies import battery as study

    nowhere = frames / "no-run-is-made-here"
    return study.plan(frames, [mode], nowhere, prompt=None if prompt == "baseline" else prompt).sample()


def _say_estimate(mode: "RequestMode", calls: int, prices: "Prices") -> None:
    """Print the most calls and their cost, from the assumed tokens per call."""
    from eyechart.costs import assumed, estimate

    known, basis = assumed(mode)
    expected = estimate(known, calls, prices, concurrency=1)
    say(f"at most, {basis}: {expected.words}")


def probed(
    mode: "RequestMode",
    given: Mapping[str, object],
    sample: "Sample",
    kept: str,
    *,
    seed: int | None = None,
    **how: "Unpack[ProbeOptions]",
) -> "ProbeResult":
    """Probe one model; print what a failed probe spent, and exit 3 at a limit.

    ``kept`` says what an interrupt leaves.
    """
    from eyechart.probe import ProbeError
    from eyechart.probe import probe as find

    try:
        with resumable(kept), progress(f"probe {mode.spec}", "calls") as move:
            how["tell"] = move
            return find(mode, fixed=given, sample=sample, seed=_draw(seed), **how)
    except ProbeError as error:
        say(f"probe: {mode.spec}: {error.spent.words}")
        if error.limit:
            say(f"stopped: {error}; the findings are not kept")
            raise typer.Exit(3) from None
        raise
