"""Closed-loop episodes: a policy or a model drives a simulator, decision by decision."""

from eyechart.episodes.expecting import expected, sample_of, within
from eyechart.episodes.nouns import SILENCES, STUDY, Episode, EpisodeKey, Step
from eyechart.episodes.planning import ACTION_MAP, Episodes, keep_probes, plan, require_engine, run
from eyechart.episodes.records import EPISODES, read_episodes, write_episodes
from eyechart.episodes.running import Bounds
from eyechart.episodes.summary import Row, Unfinished, every_episode, summarise, unfinished
from eyechart.episodes.worlds import Setup
from eyechart.manifest import EpisodesManifest
from eyechart.manifest import read_episodes_manifest as read_manifest

__all__ = [
    "ACTION_MAP",
    "EPISODES",
    "SILENCES",
    "STUDY",
    "Bounds",
    "Episode",
    "EpisodeKey",
    "Episodes",
    "EpisodesManifest",
    "Row",
    "Setup",
    "Step",
    "Unfinished",
    "every_episode",
    "expected",
    "keep_probes",
    "plan",
    "read_episodes",
    "read_manifest",
    "require_engine",
    "run",
    "sample_of",
    "summarise",
    "unfinished",
    "within",
    "write_episodes",
]
