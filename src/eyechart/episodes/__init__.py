"""Closed-loop episodes: a policy or a model drives a simulator, decision by decision."""

from eyechart.episodes.nouns import EPISODES, STUDY, Episode, EpisodeKey, Step, fail_safe, read_episodes, write_episodes

__all__ = [
    "EPISODES",
    "STUDY",
    "Episode",
    "EpisodeKey",
    "Step",
    "fail_safe",
    "read_episodes",
    "write_episodes",
]
