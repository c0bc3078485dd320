"""Closed-loop episodes: a policy or a model drives a simulator, decision by decision."""

from eyechart.episodes.manifest import FORMAT, EpisodesManifest, read_manifest
from eyechart.episodes.nouns import STUDY, Episode, EpisodeKey, Step, fail_safe
from eyechart.episodes.planning import ACTION_MAP, ENGINES, Episodes, expected, plan, run, within
from eyechart.episodes.records import EPISODES, read_episodes, write_episodes
from eyechart.episodes.running import Bounds
from eyechart.episodes.showing import SHOWN
from eyechart.episodes.summary import Row, summarise

__all__ = [
    "ACTION_MAP",
    "ENGINES",
    "EPISODES",
    "FORMAT",
    "SHOWN",
    "STUDY",
    "Bounds",
    "Episode",
    "EpisodeKey",
    "Episodes",
    "EpisodesManifest",
    "Row",
    "Step",
    "expected",
    "fail_safe",
    "plan",
    "read_episodes",
    "read_manifest",
    "run",
    "summarise",
    "within",
    "write_episodes",
]
