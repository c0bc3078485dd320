"""Closed-loop episodes: a policy or a model drives a simulator, decision by decision."""

from eyechart.episodes.coordinator import Bounds
from eyechart.episodes.plans import (
    ACTION_MAP,
    EpisodesRun,
    drives_ended,
    errors_ended,
    expected,
    plan,
    run,
    usual_conditions,
    with_marginals,
)
from eyechart.episodes.records import (
    SILENCES,
    STUDY,
    Episode,
    EpisodeKey,
    EpisodeMeans,
    Step,
    UnfinishedEpisodes,
    every_episode,
    read_episodes,
    summarise,
    unfinished,
    write_episodes,
)
from eyechart.episodes.worlds import Setup
from eyechart.manifest import EPISODES, EpisodesManifest
from eyechart.manifest import read_episodes_manifest as read_manifest

__all__ = [
    "ACTION_MAP",
    "EPISODES",
    "SILENCES",
    "STUDY",
    "Bounds",
    "Episode",
    "EpisodeKey",
    "EpisodeMeans",
    "EpisodesManifest",
    "EpisodesRun",
    "Setup",
    "Step",
    "UnfinishedEpisodes",
    "drives_ended",
    "errors_ended",
    "every_episode",
    "expected",
    "plan",
    "read_episodes",
    "read_manifest",
    "run",
    "summarise",
    "unfinished",
    "usual_conditions",
    "with_marginals",
    "write_episodes",
]
