"""The way from a picture to a vote: the view that a model gets, the question, and the reading."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from eyechart.calls import Query, Reply
from eyechart.conditions import flip
from eyechart.errors import GuardianError
from eyechart.frames import Stimulus, decode, encode
from eyechart.perception.view import find_view
from eyechart.prompts import close_m_of
from eyechart.records import to_json_fields
from eyechart.spaces.scene import SCENES
from eyechart.studies.guardian import VIEWS, VOTE_READER, VOTED, FrozenGuardian, read_vote

Answer = Literal["hazard", "clear", "abstain"]
Vote = bool | None
Pictures = tuple[bytes, bytes]
"""The models' input: the view of a picture, and of its reflection."""

_PICTURE = "the picture"


@dataclass(frozen=True, slots=True)
class Interface:
    """How a picture becomes votes.

    ``views`` turns an encoded picture into the models' views, and raises BankError if it cannot.
    ``query`` makes the question about a view, with a seed. ``read`` returns the vote of a reply, or
    None with the reason. ``view``, ``prompt`` and ``reader`` are as in a guardian's file.
    """

    view: str | None
    prompt: str | None
    reader: int | None
    views: Callable[[bytes], Pictures]
    query: Callable[[bytes, int], Query]
    read: Callable[[Reply], tuple[Vote, str]]


@dataclass(frozen=True, slots=True)
class Assessment:
    """A guardian's judgement of a picture.

    ``votes`` maps each model to its votes on the picture and on its reflection: True is hazard,
    False clear. None is missing, with the reason in ``missing`` under ``MODEL/VIEW``. ``why`` is
    one line for a log.
    """

    answer: Answer
    votes: Mapping[str, tuple[Vote, Vote]]
    latency_s: float
    why: str
    missing: Mapping[str, str]

    def as_dict(self) -> dict[str, object]:
        """Return the assessment as plain JSON values."""
        votes = {model: dict(zip(VIEWS, pair, strict=True)) for model, pair in self.votes.items()}
        return to_json_fields(self, "answer missing why", votes=votes, latency_s=round(self.latency_s, 4))


def interface_of(frozen: FrozenGuardian) -> Interface:
    """Return the interface of a guardian's choice: view, prompt and reading of its structured run.

    Raises GuardianError if its votes came from elsewhere, or its prompt needs more than a picture.
    Raises SpecError if this version of eyechart lacks the view.
    """
    prompt, about = frozen.about.wording, frozen.about
    if prompt is None or about.view is None:
        raise GuardianError(
            "this guardian's votes came from a table, so its prompt and view are not known here: give Guardian.load an "
            "interface of your own"
        )
    if not prompt.asks_scene or prompt.fields:
        said = f"says {{{prompt.fields[0]}}} of a frame" if prompt.fields else "asks for no scene"
        raise GuardianError(f"the prompt '{prompt.name}' {said}, so it cannot be asked about a picture alone")
    if about.voting not in {None, VOTE_READER}:
        raise GuardianError(
            f"the rules for votes differ: this guardian was chosen under version {about.voting}, here "
            f"is version {VOTE_READER}; choose a guardian with 'eyechart guardian fit'"
        )
    view, axis = find_view(about.view), about.axis
    axis = view.axis if view is not None else axis
    if axis not in {"vertical", "horizontal"}:
        raise GuardianError(f"this guardian's pictures have the mirror axis {axis!r}, so they cannot be reflected")

    close_m = close_m_of(prompt)
    if close_m is None:
        raise GuardianError(
            f"the prompt '{prompt.name}' does not say which leads are close, so no reply can be checked"
        )

    def views(picture: bytes) -> Pictures:
        pixels = decode(picture, _PICTURE)
        reflected = flip(pixels, axis)
        if view is None:
            return picture, encode(reflected)
        return encode(view.show(pixels, _PICTURE)), encode(view.show(reflected, _PICTURE))

    def query(picture: bytes, seed: int) -> Query:
        return prompt.query(Stimulus.of(picture), seed, SCENES)

    def read(reply: Reply) -> tuple[Vote, str]:
        vote = read_vote(reply, close_m)
        return vote.hazard, "" if vote.hazard is not None else f"no vote: {vote}"

    return Interface(about.view, prompt.key, VOTED.reader, views, query, read)
