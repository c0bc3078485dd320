"""Scores a structured run: ledger and bank to estimates to figures; only reads, same bytes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eyechart.errors import LedgerError
from eyechart.frames import FrameBank
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, RunManifest, read_run
from eyechart.records import to_json_fields
from eyechart.spaces.discrete import DRIVING, Discrete
from eyechart.spaces.scene import SCENE_READERS, SCENES, Estimate, SceneSpace
from eyechart.stats.agreement import rate
from eyechart.stats.episodes import mean_of_shares, share_over_episodes
from eyechart.stats.jackknife import mean_over_episodes
from eyechart.stats.statistic import ModelStatistics, Statistic, not_available
from eyechart.studies.battery import CallsScore, plan_of, require_requests, took_run
from eyechart.studies.structured.plans import STUDIES
from eyechart.studies.structured.scene_answers import Floats, Mask, SceneAnswers, read_scene_answers, scenes_of
from eyechart.verdicts import Evidence
from eyechart.verdicts.admission import ClauseResult, hold

_ONE_EPISODE = "Wilson: one episode shows no spread"


@dataclass(frozen=True, slots=True)
class Bootstrap:
    """The episodes for intervals, one per frame; None where the bank records none."""

    episodes: NDArray[np.str_] | None


class Figures:
    """Every figure of one model's estimates, over the frames of a mask.

    A reply without an estimate is never right: it is a wrong value of ``close``, an unequal pair
    and no swap. Accuracies and decisions are those of the unreflected frames; the reflections count
    in ``parse`` and in the pairs.
    """

    def __init__(self, answers: SceneAnswers, space: Discrete, mask: Mask, how: Bootstrap) -> None:
        real, mirrored = answers.replies_to("real"), answers.replies_to("mirrored")
        chosen = [place for place in np.flatnonzero(mask) if real[place] is not None]
        self._answers, self._space, self._how = answers, space, how
        self._frames = np.array(chosen, dtype=np.int64)
        self._real = [answers.estimates("real")[place] for place in chosen]
        self._has_mirrored = np.array([mirrored[place] is not None for place in chosen], dtype=np.bool_)
        self._mirrored = [answers.estimates("mirrored")[place] for place in chosen]

    def statistics(self) -> dict[str, Statistic]:
        """Return every figure by name."""
        close, said = self._answers.close[self._frames], _flags(self._real, lambda one: one.close)
        parsed = _given(self._real)
        right = parsed & (said == close)
        actions = [self._act(one) for one in self._real if one is not None]
        turning = _flags(self._real, lambda one: self._act(one) in self._space.directional)
        counted = "counted on the frames as they are"
        mirrored, also = self._has_mirrored.astype(np.float64), _given(self._mirrored).astype(np.float64)

        def is_exchanged(estimate: Estimate, other: Estimate) -> bool:
            return self._space.reflect(self._act(estimate)) == self._act(other)

        return {
            "parse": self._ratio(parsed.astype(np.float64) + also, 1.0 + mirrored),
            "close_accuracy": self._share(right),
            "balanced_accuracy": self._balanced(right, close),
            "sensitivity": self._share(right, close),
            "specificity": self._share(right, ~close),
            "gap_mae_m": self._gap_error(),
            "lead_missed": self._share(
                _flags(self._real, lambda one: one.gap_m is None),
                self._answers.visible[self._frames] & parsed,
            ),
            "scene_equivariance": self._pairs(lambda one, other: one.mirrored() == other),
            "scene_equivariance.confidence_aside": self._pairs(
                lambda one, other: not SCENES.distance(one.mirrored(), other)
            ),
            "action_equivariance": self._pairs(is_exchanged),
            "swap_rate": self._pairs(is_exchanged, turning),
            "disagreement": self._share(_flags(self._real, lambda one: one.disagrees(self._answers.distances)), parsed),
            "actions": Statistic(float(len(set(actions))), len(actions), method=counted) if actions else _nothing(),
            "directional": Statistic(float(turning.sum()), len(actions), method=counted) if actions else _nothing(),
        }

    def _act(self, estimate: Estimate) -> str:
        return estimate.act(self._answers.distances)

    def _share(self, hits: Mask, of: Mask | None = None) -> Statistic:
        among = np.ones(len(hits), dtype=np.bool_) if of is None else of
        return self._ratio((hits & among).astype(np.float64), among.astype(np.float64))

    def _ratio(self, hits: Floats, among: Floats) -> Statistic:
        k, n = int(hits.sum()), int(among.sum())
        if not n:
            return _nothing()
        episodes = self._how.episodes
        if episodes is None:
            return Statistic(k / n, n, note="the bank records no episodes: no interval", detail={"k": k})
        _, codes = np.unique(episodes[self._frames], return_inverse=True)
        statistic = share_over_episodes(*(np.bincount(codes, weights=column) for column in (hits, among)))
        return replace(rate(k, n), note=_ONE_EPISODE) if statistic.ci is None else statistic

    def _balanced(self, right: Mask, close: Mask) -> Statistic:
        if not close.any() or close.all():
            return not_available("one of the two classes is empty", len(close), "balanced accuracy")
        episodes = self._how.episodes
        if episodes is None:
            value = float(right[close].mean() + right[~close].mean()) / 2
            return Statistic(value, len(close), note="the bank records no episodes: no interval")
        _, codes = np.unique(episodes[self._frames], return_inverse=True)
        counted = [(np.bincount(codes, weights=right & of), np.bincount(codes, weights=of)) for of in (close, ~close)]
        return mean_of_shares(*counted)

    def _gap_error(self) -> Statistic:
        """Return the mean absolute error of estimated gaps of leads in the picture, in metres."""
        if self._answers.unit != "m":
            return not_available(f"the bank's gap is in {self._answers.unit}, and estimates are in metres")
        gaps_m = [-1.0 if one is None or one.gap_m is None else one.gap_m for one in self._real]
        given = self._answers.visible[self._frames] & (np.array(gaps_m) >= 0)
        if not given.any():
            return not_available("no estimate gives a gap for a lead that is in the picture")
        errors = np.where(
            given, np.abs(np.array(gaps_m) - np.where(given, self._answers.gap_m[self._frames], 0.0)), 0.0
        )
        found = self._mean(np.column_stack([errors, given]))
        worst = float(errors.max())
        return replace(found, n=int(given.sum()), detail={"largest": worst}, unit="m")

    def _pairs(self, equal: Callable[[Estimate, Estimate], bool], of: Mask | None = None) -> Statistic:
        """Return the share of equal pairs over frames with a reflected call, or of a mask."""
        both = zip(self._real, self._mirrored, strict=True)
        hits = [one is not None and other is not None and equal(one, other) for one, other in both]
        return self._share(
            np.array(hits, dtype=np.bool_), self._has_mirrored if of is None else self._has_mirrored & of
        )

    def _mean(self, sums: Floats) -> Statistic:
        episodes = self._how.episodes
        if episodes is None:
            value = float(sums[:, 0].sum() / sums[:, 1].sum())
            return Statistic(value, len(sums), note="the bank records no episodes: no interval")
        _, codes = np.unique(episodes[self._frames], return_inverse=True)
        by_episode = np.stack([np.bincount(codes, weights=column) for column in sums.T], axis=1)
        return mean_over_episodes(by_episode)


def _flags(estimates: list[Estimate | None], holds: Callable[[Estimate], bool]) -> Mask:
    return np.array([estimate is not None and holds(estimate) for estimate in estimates], dtype=np.bool_)


def _given(estimates: list[Estimate | None]) -> Mask:
    return _flags(estimates, lambda _: True)


def _nothing() -> Statistic:
    return not_available("no replies of this kind")


@dataclass(frozen=True)
class EstimatorScore:
    """One model's estimates and figures: over all frames, and over those before a collision.

    ``before`` is None where the bank does not record collisions. ``clauses`` are checked on
    ``statistics``.
    """

    model: str
    version: str
    planned: int
    answered: int
    answers: SceneAnswers
    statistics: Mapping[str, Statistic]
    before: Mapping[str, Statistic] | None
    clauses: tuple[ClauseResult, ...]

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        said = {"unread": self.answers.reasons, "repairs": self.answers.repairs, "before_collision": self.before}
        return to_json_fields(self, "version planned answered clauses statistics", admitted=self.is_admitted, **said)

    @property
    def is_admitted(self) -> bool:
        """Return whether every planned call is answered and every clause is met."""
        return self.answered >= self.planned and all(clause.passes for clause in self.clauses)

    @property
    def failed(self) -> frozenset[str]:
        """Return the names of the clauses that are not met."""
        return frozenset(clause.name for clause in self.clauses if not clause.passes)


@dataclass(frozen=True)
class StructuredScore(CallsScore[EstimatorScore]):
    """The scores of an admission or structured run, and apart from them the costs of its calls."""

    pairs: int

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        run = to_json_fields(self.manifest, "study fingerprint view seed frames", prompt=self.manifest.prompt.key)
        own = to_json_fields(self, "pairs models accounting guards")
        return {**run, "bank": self.bank.name, "reader": self.space.reader, **own}

    def __repr__(self) -> str:
        return f"<StructuredScore of {', '.join(self.models) or 'no model'} on {self.pairs} pairs of {self.bank.name}>"

    @property
    def space(self) -> SceneSpace:
        """Return the space of the estimates, with the version of its reader."""
        return scenes_of(self.bank)

    def measured(self) -> tuple[ModelStatistics, ...]:
        """Return the figures of every estimator on the bank."""
        return tuple(
            ModelStatistics(
                spec,
                self.bank.name,
                model.statistics,
                "" if model.answered >= model.planned else f"{model.answered} of {model.planned} calls",
            )
            for spec, model in self.models.items()
        )

    def evidence(self) -> dict[str, Evidence]:
        """Return the gate's evidence on every model."""
        return {
            spec: Evidence(
                model=spec,
                statistics=model.statistics,
                planned=model.planned,
                answered=model.answered,
                replies={"": model.answers.reasons},
                guards=self.guards[spec],
            )
            for spec, model in self.models.items()
        }


def score(path: Path, *, reread: bool = False) -> StructuredScore:
    """Score the admission or structured run in a folder, finished or not.

    ``reread`` lets today's reader read the replies of a run begun under an older one. Raises
    LedgerError or BankError where the folder is no such run, or needs ``reread``.
    """
    manifest, bank = read_run(path, reread=reread)
    require_scorable(path, manifest, reread=reread)
    return score_run(manifest, bank, path / LEDGER, held=True)


def require_scorable(path: Path, manifest: RunManifest, *, reread: bool = False) -> None:
    """Raise LedgerError where a run may not be scored so, see ``score``."""
    if manifest.study not in STUDIES:
        raise LedgerError(f"{path} is a run of the study '{manifest.study}', not one of {', '.join(STUDIES)}")
    manifest.require_reader(path, SCENE_READERS, reread=reread)


def score_run(manifest: RunManifest, bank: FrameBank, ledger_path: Path, *, held: bool = False) -> StructuredScore:
    """Score the calls in a ledger by a run's manifest and its bank.

    With ``held`` each call is compared with the run's requests; raises LedgerError where one
    differs.
    """
    plan = plan_of(manifest, bank)
    with Ledger(ledger_path) as ledger:
        if held:
            require_requests(ledger_path, ledger.columns(), manifest, plan)
        answers = {spec: read_scene_answers(spec, ledger.replies(spec), bank, plan.frames) for spec in manifest.models}
    accounting, guards = took_run(manifest, bank, ledger_path)
    silent = "episode" in bank.manifest.absent and not bank.manifest.independent
    episodes = None if silent else np.array([frame.drive for frame in plan.frames])
    how = Bootstrap(episodes)
    models = {
        spec: _scored(answers[spec], how, version, sum(1 for _ in plan.keys_of(spec)))
        for spec, version in manifest.models.items()
    }
    return StructuredScore(manifest, bank, models, accounting, guards, len(plan.frames))


def _scored(answers: SceneAnswers, how: Bootstrap, version: str, planned: int) -> EstimatorScore:
    """Score one model; the safety policy has the five driving actions, whatever the bank's."""
    every = np.ones(len(answers.frames), dtype=np.bool_)
    statistics = Figures(answers, DRIVING, every, how).statistics()
    return EstimatorScore(
        model=answers.model,
        version=version,
        planned=planned,
        answered=answers.finished,
        answers=answers,
        statistics=statistics,
        before=None if answers.before is None else Figures(answers, DRIVING, answers.before, how).statistics(),
        clauses=hold(statistics),
    )
