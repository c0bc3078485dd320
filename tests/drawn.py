"""Answers to pictures in which the lead is drawn along its range, and statistics of depth by hand."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from eyechart.stats.order import Density, Order, Rise
from eyechart.stats.paired_tests import Place, Places, SignTest
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.depth import BrakingLevels

Floats = NDArray[np.float64]
Look = Callable[[Floats, Floats, Floats], Floats]
"""The braking level at a distance of the lead and of a neighbour, with a number in [0, 1) that is the frame's own."""


def grades(lead: Floats, beside: Floats, own: Floats) -> Floats:
    """Brake by the distance of the lead."""
    del beside, own
    return np.where(lead < 12, 1.0, np.where(lead < 30, 0.5, 0.0))


def answered(look: Look, frames: int = 144, seed: int = 0, coin: float = 0.0) -> BrakingLevels:
    """Return what a controller answers on frames of 12 episodes in 4 scenarios, with a coin in a share of its calls."""
    rng = np.random.default_rng(seed)
    drawn = 5 * 12 ** ((rng.permutation(frames) + rng.random(frames)) / frames)
    exchange = 5.6 * (49 / 5.6) ** ((rng.permutation(frames) + rng.random(frames)) / frames)
    close = np.maximum(drawn, exchange) < 1.5 * np.minimum(drawn, exchange)
    exchange = np.where(close, np.where(drawn > 17, drawn / 2.2, drawn * 2.2), exchange)
    near, far, far_too, real = (rng.uniform(*ends, frames) for ends in ((7, 9), (50, 60), (50, 60), (6, 60)))
    nobody, own = np.full(frames, np.inf), rng.random(frames)

    def asked(lead: Floats, beside: Floats) -> Floats:
        tossed = rng.choice([1.0, 0.5, 0.0, 0.0, 0.0], frames)
        return np.where(rng.random(frames) < coin, tossed, look(lead, beside, own))

    shown = {
        **dict.fromkeys(("real", "real_repeat"), (real, nobody)),
        **dict.fromkeys(("lead_near", "lead_near_nudged"), (near, nobody)),
        "lead_far": (far, nobody),
        **dict.fromkeys(("lead_drawn", "lead_drawn_nudged"), (drawn, nobody)),
        **dict.fromkeys(("exchange_own", "exchange_own_nudged"), (exchange, far)),
        "exchange_beside": (far, exchange),
        "exchange_apart": (far, far_too),
    }
    names = np.array(["light", "dense", "merge", "blocked"])
    return BrakingLevels(
        levels={name: asked(*places) for name, places in shown.items()},
        at={"near": near, "far": far, "drawn": drawn, "own": exchange, "real": real},
        episodes=np.array([f"e{frame * 12 // frames}" for frame in range(frames)]),
        strata={"scenario": names[np.arange(frames) * 4 // frames]},
    )


def found_of(moved: BrakingLevels) -> dict[str, Statistic]:
    """Return every statistic of depth, beside those of a reader that the rules read besides."""
    return by_hand() | {name: test() for name, test in moved.tests().items()}


def by_hand(**changed: Statistic) -> dict[str, Statistic]:
    """Return the statistics of a reader that earns depth, with some of them changed."""
    statistics: Mapping[str, Statistic] = {
        "unparsed_reference": Statistic(0.0, 288, (0.0, 0.01)),
        "unparsed_controls": Statistic(0.0, 144, (0.0, 0.01)),
        "depth_interventional": SignTest(1.0, 144, (0.9, 1.0), 1e-20, wins=144, losses=0, ties=0),
        "depth_net": Statistic(1.0, 144, (0.95, 1.0)),
        "lane_net": Statistic(None, 0),
        "repeat_over_nudged": Statistic(None, 0),
        "lateral_earned": Statistic(0.0, 1),
        "sensitivity": Statistic(0.9, 144, (0.8, 1.0)),
        "specificity": Statistic(-0.3, 144, (-0.4, -0.2)),
        **{f"specificity_{name}": Statistic(-0.3, 48, (-0.4, -0.2)) for name in ("near", "middle", "far")},
        "order": Order(0.02, 140, (0.0, 0.06), lost=3, won=147, contradicted=0),
        **{
            f"order_{name}": Order(0.02, 100, (0.0, 0.08), lost=2, won=98, contradicted=0)
            for name in ("near_far", "near_drawn", "drawn", "drawn_far")
        },
        "rise": Rise(1.5, 400, p=0.8, nearer=(10, 11), farther=(11, 12)),
        "file": SignTest(0.5, 8, (0.2, 0.8), 0.6, wins=4, losses=4, ties=136),
        "specificity_reversed": Statistic(-0.4, 144, (-0.45, -0.35)),
        "picture_before": Statistic(-0.15, 300, (-0.17, -0.13)),
        "drawn_distances": Density(20.0, 288, fewest=12),
        "holes": Places(0.0, 7, places=()),
        "place_open": Places(0.0, 7, places=()),
        "place_reversed": Statistic(-0.7, 36, (-0.9, -0.5), note="in `light`"),
        "place_beside": Statistic(-0.2, 36, (-0.3, 1.0), note="in `light`"),
    }
    return {**statistics, **changed}


HOLE = Place("scenario", "blocked", 36, 0, 0, 0.0, -0.08, 0.08, 0.0, -0.08)
"""A scenario in which braking does not answer."""
