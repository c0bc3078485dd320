"""Messages: the turns of a conversation, with pictures in their places between the words.

`PromptMessage` is a message as a prompt writes it; `Turn` is the same message as it is sent.
"""

import base64
import hashlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal, cast, get_args

from eyechart.errors import SpecError, counted, did_you_mean, plain_file, raising, read_at_most
from eyechart.frames import Stimulus, decode

Role = Literal["system", "user", "assistant"]
Part = str | bytes
"""Words, or an encoded picture."""

MOST_MESSAGES = 200
MOST_EXAMPLE_BYTES = 8_000_000
"""The most bytes of a prompt's example pictures together; a run keeps them with its prompt."""

_PLACE = re.compile(r"\{\{(picture:[^{}]*)\}\}|\{picture:([^{}]*)\}")
_AGO = re.compile(r"[\w-]+@-([1-9]\d{0,3})")
_KEYS = ("role", "text", "pictures")


@dataclass(frozen=True, slots=True)
class Turn:
    """A message as it is sent: its role, and its words and pictures in their order."""

    role: Role
    parts: tuple[Part, ...]

    @property
    def words(self) -> str:
        """Return the words without the pictures."""
        return "".join(part for part in self.parts if isinstance(part, str))

    @property
    def pictures(self) -> tuple[bytes, ...]:
        """Return the encoded pictures in their order."""
        return tuple(part for part in self.parts if isinstance(part, bytes))

    def opened_by(self, words: str) -> "Turn":
        """Return this turn with words before its own first words."""
        at = next((place for place, part in enumerate(self.parts) if isinstance(part, str)), len(self.parts))
        own = self.parts[at : at + 1]
        said = "\n\n".join((words, *(part for part in own if isinstance(part, str))))
        return Turn(self.role, (*self.parts[:at], said, *self.parts[at + 1 :]))

    def digests(self) -> Iterator[bytes]:
        """Yield the parts of a request's digest: the role, the words, and pictures by digest."""
        yield b"message" + self.role.encode()
        for part in self.parts:
            yield b"words" + part.encode() if isinstance(part, str) else b"picture" + _digest(part)


@lru_cache(maxsize=256)
def _digest(picture: bytes) -> bytes:
    return hashlib.sha256(picture).digest()


@dataclass(frozen=True, slots=True)
class PicturePlace:
    """A picture's place in the words: a camera or an example's file, and how many instants ago."""

    name: str
    ago: int = 0

    @property
    def written(self) -> str:
        """Return the place as a prompt writes it."""
        return f"{{picture:{self.name}@-{self.ago}}}" if self.ago else f"{{picture:{self.name}}}"

    def image(self, seen: Stimulus) -> bytes | None:
        """Return a stimulus's picture for this place; None where a condition shows none."""
        if self.ago > len(seen.past):
            return None
        return (seen.past[-self.ago] if self.ago else seen).images.get(self.name)


@dataclass(frozen=True, slots=True)
class PromptPicture:
    """A picture that belongs to a prompt, not to a frame: its file's name and its bytes."""

    file: str
    image: bytes


@dataclass(frozen=True, slots=True)
class PromptMessage:
    """A message of a prompt. ``pictures`` are its examples.

    In the ``text``, ``{picture:CAMERA}`` is the place of a camera's picture, ``{picture:CAMERA@-1}``
    that of one instant before, and ``{picture:FILE}`` that of an example. Examples without a place
    come before the words. Raises SpecError for a malformed place, and for pictures of another role
    than the user's.
    """

    role: Role
    text: str
    pictures: tuple[PromptPicture, ...] = ()

    def __post_init__(self) -> None:
        if (has_place(self.text) or self.pictures) and self.role != "user":
            raise SpecError("only a message of the user may hold pictures")

    @property
    def texts(self) -> tuple[str, ...]:
        """Return the words between the places."""
        return tuple(piece for piece in _pieces(self.text) if isinstance(piece, str))

    @property
    def places(self) -> tuple[PicturePlace, ...]:
        """Return the places of cameras, in order."""
        own = {one.file for one in self.pictures}
        found = (piece for piece in _pieces(self.text) if isinstance(piece, PicturePlace))
        return tuple(place for place in found if place.name not in own)

    def turn(self, seen: Stimulus, fill: Callable[[str], str], first: Sequence[bytes] = ()) -> Turn:
        """Return the message about a stimulus, with pictures ``first`` before its words.

        ``fill`` replaces the fields in words. A place without a picture is left out.
        """
        examples = {one.file: one.image for one in self.pictures}
        pieces = _pieces(self.text)
        placed = {piece.name for piece in pieces if isinstance(piece, PicturePlace)}
        parts: list[Part] = [*(image for file, image in examples.items() if file not in placed), *first]
        for piece in pieces:
            part = fill(piece) if isinstance(piece, str) else examples.get(piece.name) or piece.image(seen)
            if isinstance(part, str) and parts and isinstance(parts[-1], str):
                parts[-1] += part
            elif part:
                parts.append(part)
        return Turn(self.role, tuple(parts) or ("",))

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values, with pictures in Base64."""
        pictures = [{"file": one.file, "image": base64.b64encode(one.image).decode()} for one in self.pictures]
        return {"role": self.role, "text": self.text, **({"pictures": pictures} if pictures else {})}

    def wording(self) -> list[object]:
        """Return all that a prompt's key depends on, with digests of pictures."""
        return [self.role, self.text, *([one.file, _digest(one.image).hex()] for one in self.pictures)]


def conversation(messages: Sequence[PromptMessage], seen: Stimulus, fill: Callable[[str], str]) -> tuple[Turn, ...]:
    """Return the turns about a stimulus.

    Cameras that no message places come before the words of the last message, in their order.
    """
    placed = {place.name for message in messages for place in message.places if not place.ago}
    rest = [image for name, image in seen.images.items() if name not in placed]
    turns = [message.turn(seen, fill) for message in messages[:-1]]
    return (*turns, messages[-1].turn(seen, fill, rest))


def has_place(text: str) -> bool:
    """Return whether a text has a place for a picture."""
    return any(isinstance(piece, PicturePlace) for piece in _pieces(text))


def require_placed(messages: Sequence[PromptMessage], seen: Stimulus, who: str) -> None:
    """Raise SpecError for a place that ``seen``, a stimulus as of every frame, has no picture for.

    ``who`` is the prompt in words.
    """
    every = [PicturePlace(name, ago) for ago in range(len(seen.past) + 1) for name in seen.images]
    there = [place.written for place in every if place.image(seen) is not None]
    for place in (place for message in messages for place in message.places):
        if place.image(seen) is None:
            lacks, way = "such a camera or example", ""
            if place.name in seen.images:
                lacks = f"{counted(place.ago, 'instant')} before a frame"
                way = f"; make the bank with 'eyechart frames import' and --history {place.ago}"
            near = did_you_mean(place.written, there)
            raise SpecError(
                f"{who} places {place.written}, but there is no picture of {lacks};{near} there are "
                f"{', '.join(there)}{way}"
            )


@lru_cache(maxsize=256)
def _pieces(text: str) -> tuple[str | PicturePlace, ...]:
    """Return a message's words and places in their order; raises SpecError for a malformed one."""
    pieces, at = list[str | PicturePlace](), 0
    for match in _PLACE.finditer(text):
        pieces.append(text[at : match.start()])
        pieces.append(f"{{{match[1]}}}" if match[1] else _place(match[2]))
        at = match.end()
    return tuple(piece for piece in (*pieces, text[at:]) if piece)


def _place(written: str) -> PicturePlace:
    ago = _AGO.fullmatch(written)
    if ago is None and not re.fullmatch(r"[\w./ -]+", written):
        raise SpecError(
            f"{{picture:{written}}} is no place of a picture: write {{picture:CAMERA}}, {{picture:CAMERA@-1}} for one "
            "instant before, or {picture:FILE} of the message's pictures"
        )
    return PicturePlace(written) if ago is None else PicturePlace(written.partition("@")[0], int(ago[1]))


def read_messages(written: object, prompt: Path) -> tuple[PromptMessage, ...]:
    """Read the ``[[messages]]`` of a prompt's file; raises SpecError, which names the fault.

    Example pictures are files in the prompt's folder.
    """

    def picture(file: object) -> PromptPicture:
        if not isinstance(file, str) or "." not in file:
            raise SpecError(f"pictures are names of files with an ending, as 'near.png'; got {file!r}")
        return PromptPicture(file, _example(prompt.parent, file))

    with raising(SpecError, str(prompt), of=SpecError):
        return _messages(written, picture)


def messages_from(written: object) -> tuple[PromptMessage, ...]:
    """Build messages from plain JSON values, as in `PromptMessage.as_dict`; raises SpecError."""

    def picture(one: object) -> PromptPicture:
        if not isinstance(one, Mapping) or not all(isinstance(one.get(key), str) for key in ("file", "image")):
            raise SpecError("an example picture is a table with file and image")
        with raising(SpecError, f"picture '{one['file']}' is no Base64", of=ValueError):
            return PromptPicture(one["file"], base64.b64decode(one["image"], validate=True))

    return _messages(written, picture)


def _example(folder: Path, file: str) -> bytes:
    """Return an example picture's bytes; raises SpecError unless it is a picture in the folder."""
    path = folder / file
    what = f"picture '{file}'"
    with raising(SpecError, f"{what} cannot be read", of=(OSError, ValueError)):
        real = plain_file(path).resolve()
    if not real.is_relative_to(folder.resolve()) or not real.is_file():
        raise SpecError(f"{what} is no file in the prompt's folder {folder}: put it there")
    image = read_at_most(path, MOST_EXAMPLE_BYTES, SpecError, "the pictures of a prompt")
    with raising(SpecError, what, of=Exception):
        decode(image, file)
    return image


def _messages(written: object, picture: Callable[[object], PromptPicture]) -> tuple[PromptMessage, ...]:
    if not isinstance(written, list | tuple) or not 0 < len(written) <= MOST_MESSAGES:
        raise SpecError(f"messages must be 1 to {MOST_MESSAGES} tables: [[messages]] with role and text")
    messages = []
    for number, one in enumerate(written):
        with raising(SpecError, f"message {number + 1}", of=SpecError):
            messages.append(_message(one, picture))
            if messages[-1].role == "system" and number:
                raise SpecError("only the first message may be the system's")
    if messages[-1].role != "user":
        raise SpecError(f"the last message must be the user's, not the {messages[-1].role}'s")
    if sum(len(one.image) for message in messages for one in message.pictures) > MOST_EXAMPLE_BYTES:
        raise SpecError(f"the example pictures have more than {MOST_EXAMPLE_BYTES} bytes together: make them smaller")
    return tuple(messages)


def _message(one: object, picture: Callable[[object], PromptPicture]) -> PromptMessage:
    """Return a message; raises SpecError for one that no model can be sent."""
    given = one if isinstance(one, Mapping) else {}
    for key in given:
        if key not in _KEYS:
            raise SpecError(f"it has no '{key}'; it has {', '.join(_KEYS)}")
    role, text, pictures = given.get("role"), given.get("text", ""), given.get("pictures", ())
    if role not in get_args(Role) or not isinstance(text, str) or not isinstance(pictures, list | tuple):
        raise SpecError(
            'it needs a role ("system", "user" or "assistant") and a text; pictures are a list, as ["near.png"]'
        )
    message = PromptMessage(cast("Role", role), text, tuple(map(picture, pictures)))
    if len({example.file for example in message.pictures}) < len(message.pictures):
        raise SpecError("a picture is named twice")
    if not text.strip() and not message.pictures:
        raise SpecError("it has neither text nor pictures")
    return message
