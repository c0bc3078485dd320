"""run() drives the study's parts one after another, under limits that bound all of them together."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace

from eyechart.calls import Reply
from eyechart.episodes import Bounds, Episodes, within
from eyechart.episodes import run as run_episodes
from eyechart.ledger import Ledger
from eyechart.limits import Outcome, Spent
from eyechart.manifest import LEDGER
from eyechart.models.prices import Prices

Watch = Callable[[str], AbstractContextManager[Callable[[int, int], None] | None]]
"""From a part's name to what lasts while it is driven, and is told of its progress."""

USUAL = Bounds()


def _unwatched(part: str) -> AbstractContextManager[None]:
    del part
    return nullcontext()


def run(
    planned: Mapping[str, Episodes],
    prices: Prices,
    *,
    bounds: Bounds = USUAL,
    calls: int | None = None,
    cost_usd: float | None = None,
    watch: Watch = _unwatched,
) -> Outcome:
    """Drive what is left of each part; a model that is set aside in one drives in no later one.

    ``calls`` and ``cost_usd`` bound the whole study: what the ledgers of its other parts hold counts too. Raises what
    `eyechart.episodes.run` raises.
    """
    aside: dict[str, str] = {}
    stopped, uncounted = None, 0
    for name, part in planned.items():
        here = replace(part, keys=tuple(key for key in part.keys if key.policy not in aside))
        if here.left():
            before = Spent.together(spent(other, prices) for other in planned.values() if other is not part)
            limits = within(part, prices, calls=calls, cost_usd=cost_usd, before=before)
            with watch(name) as progress:
                outcome = run_episodes(here, bounds=replace(bounds, limits=limits), progress=progress)
            aside |= outcome.set_aside
            stopped, uncounted = stopped or outcome.stopped, max(uncounted, outcome.uncounted)
    return Outcome(aside, stopped, uncounted)


def spent(part: Episodes, prices: Prices) -> Spent:
    """Return what a part's probes and the attempts in its ledger took; one of unknown outcome has no known cost."""
    path, total = part.out / LEDGER, part.manifest.spent_before()
    if not path.is_file():
        return total
    with Ledger(path) as ledger:
        for spec in ledger.models():
            mode = part.manifest.mode(spec)
            for sent in ledger.attempts(spec):
                cost = None if sent.reply is None else prices.cost(mode, sent.reply)[0]
                total = total.plus(sent.reply or Reply(), cost)
    return total
