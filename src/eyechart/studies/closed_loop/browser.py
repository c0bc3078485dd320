"""The data of a page's browser of episodes: every step, and pictures of a few replayed drives."""

from collections.abc import Sequence
from dataclasses import dataclass

from eyechart.episodes import Episode
from eyechart.errors import EyechartError, counted
from eyechart.frames import RGB
from eyechart.records import to_json_fields
from eyechart.report.page import evenly
from eyechart.studies import Tell
from eyechart.studies.battery.album import data_uri, encode_small
from eyechart.studies.closed_loop import ClosedLoopScore, Drives
from eyechart.studies.closed_loop.replay import decided, episode_id, replay

MOST_EPISODES = 1000
MOST_STEPS = 60_000
"""The most episodes and steps in the page; of more, episodes are taken evenly."""

PICTURED = 6
"""The most episodes that are replayed for pictures, of as many drivers as possible."""
MOST_PICTURES = 60
"""The most pictures of one episode; of a longer drive every second, third, … step."""
PICTURE_BYTES = 6_000_000
WIDTH = 480
LONGEST_REPLY = 1500
TEXT_BUDGET = 4_000_000


@dataclass(frozen=True)
class BrowserData:
    """The browser's data, and ``notes`` on what it leaves out."""

    data: dict[str, object]
    notes: tuple[str, ...]


def drives_data(score: ClosedLoopScore, *, pictured: int = PICTURED, tell: Tell = lambda _: None) -> BrowserData:
    """Return the browser's data; ``pictured`` episodes are replayed for their pictures."""
    every = [(drive, episode) for drive in score.drives for episode in (*drive.episodes, *drive.errors)]
    steps = sum(len(episode.steps) for _, episode in every)
    part = min(1.0, MOST_EPISODES / max(1, len(every)), MOST_STEPS / max(1, steps))
    listed = evenly(every, max(1, int(part * len(every))))
    notes = []
    if len(listed) < len(every):
        notes.append(f"The browser lists {len(listed):,} of {len(every):,} episodes; every number counts all of them.")
    album = _Album()
    for drives, episode in _chosen(score.drives, listed, pictured):
        tell(f"driving '{episode_id(episode)}' again")
        album.add(drives, episode)
    notes += album.notes()
    texts = _Texts()
    episodes = [_episode(one, episode, album, texts) for one, episode in listed]
    if texts.cut:
        notes.append(f"{texts.cut} replies are cut or left out; the ledger has all of them.")
    roles = {action: drive.space.role(action) for drive in score.drives for action in drive.space.actions}
    data = {"episodes": episodes, "pictures": album.uris, "texts": texts.kept, "roles": roles}
    return BrowserData(data, tuple(notes))


def _chosen(
    drives: Sequence[Drives], listed: Sequence[tuple[Drives, Episode]], count: int
) -> list[tuple[Drives, Episode]]:
    """Return the episodes with pictures: one per driver, drivers taken evenly, worlds varied."""
    result = []
    for turn, one in enumerate(evenly(drives, count)):
        mine = [episode for other, episode in listed if other is one and episode.steps and episode.ended != "error"]
        if mine:
            result.append((one, mine[(7 * turn) % len(mine)]))
    return result


class _Album:
    """Small pictures of the replayed episodes, and their places."""

    def __init__(self) -> None:
        self.uris: list[str] = []
        self.places: dict[tuple[str, str], list[int]] = {}
        self.spent = 0
        self.refused: list[str] = []
        self.full = False

    def add(self, drives: Drives, episode: Episode) -> None:
        """Replay an episode and keep its pictures, as long as there is room."""
        every = 1 + len(episode.steps) // MOST_PICTURES
        places, begun = [], len(self.uris)
        try:
            for number, shot in enumerate(replay(drives, episode)):
                if self.spent > PICTURE_BYTES:
                    self.full = True
                    break
                if number % every == 0:
                    self.uris.append(self._encode(shot.picture))
                places.append(len(self.uris) - 1)
        except EyechartError as error:
            del self.uris[begun:]
            self.refused.append(str(error))
            return
        self.places[drives.driver.label, episode_id(episode)] = places

    def _encode(self, picture: RGB) -> str:
        small = encode_small(picture, WIDTH, 75, lossless=False)
        self.spent += len(small)
        return data_uri(small)

    def notes(self) -> list[str]:
        """Return in words what the album leaves out."""
        said = [f"Without pictures: {words}." for words in self.refused]
        count = len(self.places)
        said.append(
            f"Pictures of {counted(count, 'episode')}, driven again from the recorded actions and "
            "checked against the recorded state; 'eyechart film' shows every other episode."
        )
        return said


class _Texts:
    """Distinct replies of models, each once, within a budget."""

    def __init__(self) -> None:
        self.kept: list[str] = []
        self.numbers: dict[str, int] = {}
        self.spent = 0
        self.cut = 0

    def number(self, text: str) -> int:
        """Return the number of a reply, -1 where there is no room for it."""
        short = text[:LONGEST_REPLY]
        self.cut += short != text
        if short not in self.numbers:
            if self.spent + len(short) > TEXT_BUDGET:
                self.cut += 1
                return -1
            self.spent += len(short)
            self.numbers[short] = len(self.kept)
            self.kept.append(short)
        return self.numbers[short]


def _episode(drives: Drives, episode: Episode, album: _Album, texts: _Texts) -> dict[str, object]:
    replies = drives.texts
    steps = []
    for step in episode.steps:
        gap = step.truth.get("lead_gap_m")
        text = texts.number(replies[step.frame]) if step.frame in replies else -1
        metres = round(gap, 2) if isinstance(gap, int | float) and not isinstance(gap, bool) else None
        own = step.decision.action is not None
        steps.append([decided(step), step.executed_action, own, metres, _rounded(step.speed_mps, 2), text])
    return {
        "id": episode_id(episode),
        "driver": drives.driver.label,
        "policy": episode.key.policy,
        "run": drives.driver.run,
        **to_json_fields(episode.key, "simulator scenario seed condition"),
        **to_json_fields(episode, "ended detail"),
        "distance": _rounded(episode.distance_m, 1),
        "reward": round(episode.reward, 2),
        "crashed": episode.has_crashed,
        "steps": steps,
        "pictures": album.places.get((drives.driver.label, episode_id(episode)), []),
    }


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)
