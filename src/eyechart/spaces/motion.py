"""Motions: arrays of numbers, steps ahead by dimensions, with a meaning given by the space.

A controller's array is kept exactly: its text holds the shape, the type, the bytes and their
digest.
"""

import base64
import binascii
import hashlib
import json
import math
import re
from collections.abc import Coroutine, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal, cast, get_args

import numpy as np
import numpy.typing as npt

from eyechart.errors import SpecError, counted, printable, raising, suggestion
from eyechart.records import LARGEST, to_json_fields
from eyechart.spaces.rotations import FREEDOM, MATRIX, Rotation, angle, compared
from eyechart.spaces.space import Answer, AnySpace, Decision, SpaceDefaults, unparsed, why_unanswered

Kind = Literal["delta", "absolute", "velocity", "waypoints"]
"""The meaning of a step's numbers: a change, a target place, a speed, or a place to pass."""

MOTION_READER = 1
"""The version of these rules, which a run records to detect motions read by other rules."""

PLACES: tuple[Kind, ...] = ("absolute", "waypoints")
_TYPES = ("<f2", "<f4", "<f8")
_KEYS = 200
"""The most characters of a dict's keys in an error."""
MOST_NUMBERS = 100_000
"""A larger array is not kept."""

Floats = npt.NDArray[np.float64]
_NAMED = (
    "{} is no array of numbers. A policy that answers with names is a controller: let it take (prompt, image), and ask "
    "it with 'eyechart run battery' as --model python:MODULE:FUNCTION, with the names in the [answer] of --prompt FILE"
)

ONE_VALUE = 1e-9
"""A dimension with at most this spread has one value."""


_ARRAY = "return the array (horizon, dimensions)"


def _with_a_way_out(error: Exception) -> str:
    """Return an array library's error, with advice if it has none."""
    if "inhomogeneous" in str(error):
        return "its rows differ in length: return as many numbers for each step"
    return f"{error}; numpy has no such numbers: return .float()" if "BFloat16" in str(error) else str(error)


def _no_array(given: object) -> str:
    """Return in words that a value is no array, and what to return instead."""
    name, way = type(given).__name__, _ARRAY
    if isinstance(given, Coroutine):
        given.close()  # or Python warns that nobody awaited it
        way = f"{_ARRAY} that it gives: let a plain function run it, as by asyncio.run"
    elif isinstance(given, Iterator):
        way = f"{_ARRAY} whole, not by yield"
    elif own := [one for one in ("actions", "action") if one in dir(given)]:
        way = f"return its .{own[0]}"
    return f"{'an' if name[0] in 'AEIOUaeiou' else 'a'} {name} is no array of numbers; {way}"


def _texts(array: npt.NDArray[np.generic]) -> str:
    """Return in words what to return instead of texts or bytes."""
    if array.dtype.kind == "S":
        return "bytes are no array of numbers; return the array itself"
    with suppress(ValueError):
        array.astype(float)
        return "numbers written as text are no array of numbers; return them by .astype(float)"
    if array.ndim == 0 and str(array).lstrip()[:1] in ("[", "{"):
        return "a text of JSON is no array of numbers; return json.loads of it"
    return _NAMED.format("a text")


def _holds_array(given: object) -> bool:
    """Return whether a value is or holds an array; one number is none."""
    if isinstance(given, Mapping):
        return any(map(_holds_array, given.values()))
    shape = getattr(given, "shape", None)
    return isinstance(given, list | tuple) or (hasattr(given, "__array__") if shape is None else tuple(shape) != ())


def _alone(given: object) -> object:
    """Return the one array that a policy's dict holds as ``actions`` or ``action``.

    Any other value is returned as it is. Raises ValueError for a dict with another array, and for
    a tuple or a list of an array with something else.
    """
    if isinstance(given, Mapping):
        arrays = [name for name, one in given.items() if _holds_array(one)]
        if given and not arrays and all(isinstance(one, str) for one in given.values()):
            raise ValueError(_NAMED.format(f"a {type(given).__name__} of texts"))
        if len(arrays) != 1 or arrays[0] not in {"actions", "action"} or isinstance(given[arrays[0]], Mapping):
            own = f"a {type(given).__name__} is no array of numbers; its keys are {_keys(given)}"
            raise ValueError(f"{own}: {_ARRAY}, alone or as 'actions'; {_of_several(given, arrays)}")
        given = given[arrays[0]]
    if isinstance(given, list | tuple) and len(given) > 1:
        others = any(one is None or isinstance(one, Mapping) for one in given)
        if others or len(getattr(given[0], "shape", ())) > 1:
            parts = printable(", ".join(type(one).__name__ for one in given))
            own = f"a {type(given).__name__} of {len(given)} ({parts}) is no array"
            raise ValueError(f"{own}; return the first alone, if it is the array (horizon, dimensions): [0]")
    return given


def _keys(given: Mapping[object, object]) -> str:
    """Return the keys of a dict in words."""
    keys = printable(", ".join(_key(name, one) for name, one in given.items())) or "none"
    return keys if len(keys) <= _KEYS else f"{keys[:_KEYS]}…"


def _key(name: object, value: object) -> str:
    """Return a key in words, with the keys of the dict that it holds."""
    return f"{name!r} (a dict of {', '.join(map(repr, value))})" if isinstance(value, Mapping) else repr(name)


def _of_several(given: Mapping[object, object], arrays: Sequence[object]) -> str:
    """Return what to do with a dict of several values: take the motion out of it, or join its parts."""
    whole = [name for name in ("actions", "action") if name in arrays and not isinstance(given[name], Mapping)]
    if len(whole) == 1:
        return f"""return x["{whole[0]}"] of it, if that is the array"""
    return "join its parts by np.concatenate(…, -1)"


def read_kind(word: str | None) -> Kind | None:
    """Return a word as a kind, or None; raises SpecError that lists the kinds."""
    if word is None or word in get_args(Kind):
        return cast("Kind | None", word)
    raise SpecError(f"a motion is {', '.join(get_args(Kind))}, not '{word}'{suggestion(word, get_args(Kind))}")


@dataclass(frozen=True)
class Motion:
    """An array as it came: ``shape``, numpy's ``type``, and the bytes in C order."""

    shape: tuple[int, ...]
    type: str
    data: bytes

    @classmethod
    def of(cls, given: object) -> "Motion":
        """Return a controller's array, also one in a dict as ``actions`` or ``action``.

        Raises ValueError if it is no array, if it is one of several, or if it is too large.
        """
        given = _alone(given)
        with raising(ValueError, f"a {type(given).__name__} is no array", of=Exception, words=_with_a_way_out):
            array = np.asarray(given)
        if array.dtype.kind == "O" and not isinstance(given, np.ndarray | list | tuple):
            raise ValueError(_no_array(given))
        if array.dtype.kind in "US":
            raise ValueError(_texts(array))
        if array.dtype.kind not in "fiu" or array.dtype.itemsize > 8:
            raise ValueError(f"an array of {array.dtype} has no numbers of up to 64 bits; return it as float32")
        if isinstance(given, np.ma.MaskedArray) and (hidden := int(np.ma.getmaskarray(given).sum())):
            own = f"a masked array hides {counted(hidden, 'number')}, and the values below are no answer"
            raise ValueError(f"{own}; return an array without a mask")
        if array.size > MOST_NUMBERS:
            raise ValueError(f"an array of {array.size} numbers is too large; at most {MOST_NUMBERS} are kept")
        kind = f"<f{array.dtype.itemsize}" if array.dtype.kind == "f" else "<f8"
        return cls(array.shape, kind, np.ascontiguousarray(array, dtype=kind).tobytes())

    @classmethod
    def each(cls, given: object, count: int) -> "list[Motion | ValueError]":
        """Return the motions of a batch, or why one is none; the batch may stand in a dict as ``actions``.

        Raises ValueError if it holds another number of answers.
        """
        many = _alone(given) if isinstance(given, Mapping) else given
        with raising(ValueError, f"a {type(given).__name__} holds no answers", of=TypeError):
            answers = list(cast("Iterable[object]", many))
        if len(answers) != count:
            few = f"{count} queries got {len(answers)} answers"
            raise ValueError(f"{few}; a callable with 'batch' returns a list of arrays, one for each")
        return [cls._or_why(one) for one in answers]

    @classmethod
    def _or_why(cls, given: object) -> "Motion | ValueError":
        try:
            return cls.of(given)
        except ValueError as error:
            return error

    @cached_property
    def array(self) -> Floats:
        """Return the numbers, in double precision."""
        return np.frombuffer(self.data, self.type).reshape(self.shape).astype(np.float64)

    @property
    def sha256(self) -> str:
        """Return the digest of the bytes."""
        return hashlib.sha256(self.data).hexdigest()

    @property
    def text(self) -> str:
        """Return the text that a ledger keeps."""
        kept = {"shape": list(self.shape), "type": self.type, "sha256": self.sha256}
        return json.dumps({"motion": {**kept, "base64": base64.b64encode(self.data).decode()}})

    @classmethod
    def read(cls, text: str) -> "Motion":
        """Return the motion in such a text; raises ValueError without one or its exact bytes."""
        try:
            kept = json.loads(text)["motion"]
            shape, kind = tuple(map(int, kept["shape"])), str(kept["type"])
            made = cls(shape, kind, base64.b64decode(kept["base64"], validate=True))
            known = kept["sha256"]
        except (ValueError, LookupError, TypeError, RecursionError, binascii.Error) as error:
            raise ValueError("not_a_motion") from error
        if kind not in _TYPES or any(one < 0 for one in shape):
            raise ValueError("not_a_motion")
        if made.sha256 != known or len(made.data) != math.prod(shape) * np.dtype(kind).itemsize:
            raise ValueError("other_bytes")
        return made

    def __str__(self) -> str:
        return f"motion {'×'.join(map(str, self.shape))} {self.sha256[:12]}"


@dataclass(frozen=True, slots=True)
class Dimension:
    """One number of a motion's step, or of a state.

    Differences count in units of ``scale``; None means the spread of the bank's logged motions.
    ``along`` is its axis of the world, by the bank's name. In the reflected world it is the number
    of ``mirrors`` (empty: its own) times ``sign``, about ``about``: a place x between 0 and 1 has
    sign -1 about .5. ``state`` is the index of its number in the state, if the state has it.
    """

    name: str
    unit: str = ""
    scale: float | None = None
    along: str = ""
    mirrors: str = ""
    sign: float = 1.0
    about: float = 0.0
    state: int | None = None

    def __post_init__(self) -> None:
        if not self.name or (self.scale is not None and not (np.isfinite(self.scale) and self.scale > 0)):
            raise SpecError(f"a dimension needs a name and a scale above 0; '{self.name}' has {self.scale}")
        if self.sign not in {1.0, -1.0} or not np.isfinite(self.about):
            raise SpecError(f"dimension '{self.name}': a reflection has sign 1 or -1 about a number")


def reflect(numbers: Floats, dimensions: Sequence[Dimension]) -> Floats:
    """Return numbers of shape (…, dimensions) in the reflected world."""
    place = {dimension.name: number for number, dimension in enumerate(dimensions)}
    taken = [place[dimension.mirrors or dimension.name] for dimension in dimensions]
    sign, about = (np.array([getattr(dimension, name) for dimension in dimensions]) for name in ("sign", "about"))
    return np.asarray(sign * (numbers[..., taken] - about) + about)


def require_mirrored(dimensions: Sequence[Dimension], what: str) -> None:
    """Raise SpecError if two dimensions have one name, or reflecting twice changes a number."""
    by_name = {dimension.name: dimension for dimension in dimensions}
    if len(by_name) < len(dimensions):
        raise SpecError(
            f"{what}: two dimensions have one name: {', '.join(dimension.name for dimension in dimensions)}"
        )
    for one in dimensions:
        if one.mirrors and (one.mirrors not in by_name or by_name[one.mirrors].mirrors != one.name):
            raise SpecError(f"{what}: '{one.name}' mirrors '{one.mirrors}', which must be there and mirror it too")
        if one.mirrors and _as_reflected(by_name[one.mirrors]) != _as_reflected(one):
            raise SpecError(f"{what}: '{one.name}' and '{one.mirrors}' mirror each other, and need one sign and about")


def _as_reflected(dimension: Dimension) -> tuple[float, float]:
    return dimension.sign, dimension.about


@dataclass(frozen=True)
class MotionSpace(SpaceDefaults):
    """Motions of ``horizon`` steps at ``rate_hz`` per second, in these ``dimensions``.

    ``state`` describes all numbers of the state in the controller's order; empty if unknown. A
    place (``absolute``, ``waypoints``) with an index in the state is measured relative to that
    number. Without ``mirrored`` the reflected motion is unknown. ``words`` are the pairs that an
    instruction exchanges under reflection, such as left and right. ``rotations`` are numbers of the
    motion or the state that are one rotation, and are compared by its angle.
    """

    who: ClassVar[str] = "policy"
    reader: ClassVar[int] = MOTION_READER
    readers: ClassVar[tuple[int, ...]] = (MOTION_READER,)
    actions: ClassVar[tuple[str, ...]] = ()
    name: str
    dimensions: tuple[Dimension, ...]
    horizon: int
    kind: Kind = "delta"
    rate_hz: float | None = None
    state: tuple[Dimension, ...] = ()
    mirrored: bool = False
    words: tuple[tuple[str, str], ...] = ()
    rotations: tuple[Rotation, ...] = ()

    def __post_init__(self) -> None:
        if self.horizon < 1 or not self.dimensions:
            raise SpecError(f"motion '{self.name}' needs a horizon of 1 or more and a dimension")
        require_mirrored(self.dimensions, f"motion '{self.name}'")
        require_mirrored(self.state, f"the state of motion '{self.name}'")
        for one in self.dimensions:
            if one.state is not None and not 0 <= one.state < len(self.state):
                raise SpecError(
                    f"motion '{self.name}': '{one.name}' belongs to number {one.state} of the state, which has no "
                    "such number"
                )
        if self.mirrored:
            self._require_reflected_alike()
        if self.rotations:
            self._require_rotations()

    def _require_rotations(self) -> None:
        """Raise SpecError if rotations overlap, exceed the numbers, or have no meaning here."""
        name, states = f"motion '{self.name}'", {one.first for one in self.rotations_of("state")}
        if self.mirrored:
            raise SpecError(f"{name}: the reflection of a rotation is not known: leave out [reflection]")
        if self.kind == "velocity" and self.rotations_of("motion"):
            raise SpecError(f"{name}: a speed of turning is no rotation but a vector: declare no rotation of it")
        for of, dimensions in (("motion", self.dimensions), ("state", self.state)):
            taken = [number for one in self.rotations if one.of == of for number in one.numbers]
            if len(set(taken)) < len(taken) or not set(taken) <= set(range(len(dimensions))):
                raise SpecError(f"{name}: two rotations of the {of} share a number, or one exceeds its numbers")
        for one in self.rotations:
            if one.state is not None and one.state not in states:
                raise SpecError(f"{name}: a rotation belongs to number {one.state} of the state, where none begins")
            scales = {self.dimensions[number].scale for number in one.numbers} if one.of == "motion" else {None}
            if len(scales) > 1:
                raise SpecError(f"{name}: the numbers of a rotation have one scale, in radians, or none")

    def rotations_of(self, of: Literal["motion", "state"]) -> tuple[Rotation, ...]:
        """Return the rotations of the motion or of the state, by their first numbers."""
        return tuple(sorted((one for one in self.rotations if one.of == of), key=lambda one: one.first))

    @cached_property
    def plain(self) -> tuple[int, ...]:
        """Return the dimensions that are no part of a rotation; `relative` gives them first."""
        taken = {number for one in self.rotations_of("motion") for number in one.numbers}
        return tuple(number for number in range(len(self.dimensions)) if number not in taken)

    @cached_property
    def parts(self) -> dict[str, tuple[int, ...]]:
        """Return the columns of `relative` by the name of their dimension or their rotation."""
        found: dict[str, tuple[int, ...]] = {
            self.dimensions[number].name: (place,) for place, number in enumerate(self.plain)
        }
        for turn, one in enumerate(self.rotations_of("motion")):
            first, last = (self.dimensions[number].name for number in (one.numbers[0], one.numbers[-1]))
            start = len(self.plain) + MATRIX * turn
            found[f"rotation {first} to {last}"] = tuple(range(start, start + MATRIX))
        return found

    @property
    def width(self) -> int:
        """Return how many numbers a step has as motions are compared (`relative`)."""
        return sum(map(len, self.parts.values()))

    def _require_reflected_alike(self) -> None:
        """Raise SpecError if a place and its number in the state are reflected differently."""
        by_name = {dimension.name: dimension for dimension in self.dimensions}
        for one in self.dimensions:
            if one.state is None or self.kind not in PLACES:
                continue
            own, other = self.state[one.state], by_name[one.mirrors or one.name].state
            theirs = None if other is None else self.state[other].name
            if _as_reflected(own) != _as_reflected(one) or (own.mirrors or own.name) != theirs:
                raise SpecError(
                    f"motion '{self.name}': the reflected '{one.name}' must be measured relative to the "
                    f"reflected '{own.name}' of the state: give both the same reflection"
                )

    @property
    def shape(self) -> tuple[int, int]:
        """Return the shape of a motion: steps and dimensions."""
        return self.horizon, len(self.dimensions)

    @property
    def form(self) -> str:
        """Return in words how an answer comes."""
        return "arrays"

    @property
    def axes(self) -> tuple[str, ...]:
        """Return the world's axes that have a dimension."""
        return tuple(dict.fromkeys(dimension.along for dimension in self.dimensions if dimension.along))

    def schema(self) -> dict[str, object]:
        """Return the JSON schema of the numbers; it changes with the space's meaning."""
        steps, wide = self.shape
        row = {"type": "array", "items": {"type": "number"}, "minItems": wide, "maxItems": wide}
        return {"type": "array", "items": row, "minItems": steps, "maxItems": steps, "description": self._words()}

    def _words(self) -> str:
        parts = (
            f"{dimension.name} ({dimension.unit})" if dimension.unit else dimension.name
            for dimension in self.dimensions
        )
        rate = "" if self.rate_hz is None else f", {self.rate_hz:g} Hz"
        turns = "" if not self.rotations else f"; rotations: {self.rotations_in_words()}"
        return f"{self.name}: {self.kind}{rate}: {', '.join(parts)}{turns}"

    def read(self, reply: Answer) -> Decision[Motion]:
        """Return the motion in a reply, if it has this shape and is finite."""
        if (missing := why_unanswered(reply.finish_reason, reply.error)) is not None:
            return Decision(None, missing)
        if not reply.text:
            return Decision(None, "empty")
        try:
            motion = Motion.read(reply.text)
        except ValueError as error:
            return unparsed(str(error))
        fault = self._fault(motion)
        return unparsed(fault) if fault else Decision(motion)

    def _fault(self, motion: Motion) -> str:
        if motion.shape != self.shape:
            return "wrong_shape"
        if not (np.abs(motion.array) <= LARGEST).all():
            return "not_finite"
        whole = not self.rotations or bool(np.isfinite(self.relative(motion.array, None)).all())
        return "" if whole else "not_a_rotation"

    def lacks(self, reply: Answer) -> str:
        """Return in words why a reply holds no motion; "" for a motion or an error."""
        decision = self.read(reply)
        if decision.action is not None or decision.missing == "error":
            return ""
        if decision.why == "wrong_shape":
            came = Motion.read(reply.text).shape
            return f"its shape is {came}, and that of the bank's motions {self.shape}: {self._mends(came)}"
        if decision.why == "not_finite":
            fine = np.abs(Motion.read(reply.text).array) <= LARGEST
            names = ", ".join(one.name for one, own in zip(self.dimensions, fine.T, strict=True) if not own.all())
            own = f"some of its values are not numbers (NaN, infinite, or beyond {LARGEST:g}), those of {names}"
            return f"{own}; its normalisation may lack its statistics"
        words = {
            "not_a_rotation": "its numbers of a rotation give none, as a quaternion of zeros does",
            "other_bytes": "its bytes do not match its digest",
            "not_a_motion": "it is no array",
        }
        return words.get(decision.why or "", f"it is {decision.missing}")

    def _mends(self, came: tuple[int, ...]) -> str:
        """Return in words how to correct an answer of another shape."""
        steps, wide = self.shape
        if len(came) > 2 and came[0] == 1:
            batch = "return the chunk alone, without the axis of the batch: [0]"
            return batch if came[1:] == self.shape else f"{batch}; then {self._mends(came[1:])}"
        exact = {
            (wide,): f"return all {steps} steps of the chunk, not one of them",
            (wide, steps): "return it with the steps first: .T",
            (steps * wide,): f"return it as .reshape{self.shape}",
        }
        if came in exact:
            return exact[came]
        if len(came) == 2 and came[0] >= steps and came[1] > wide:
            names = ", ".join(one.name for one in self.dimensions)
            padded = f"a step of the bank has {wide} numbers: {names}; if the others pad them, return [:, :{wide}]"
            return padded if came[0] == steps else f"{padded}; then {self._mends((came[0], wide))}"
        if len(came) == 2 and came[1] == wide and came[0]:
            return f"return {steps} steps, or import the bank with --horizon {came[0]}"
        if len(came) == 2 and came[0] == steps:
            return f"a step of the bank has {wide} numbers: {', '.join(one.name for one in self.dimensions)}"
        return f"return an array of {steps} steps of {wide} numbers"

    def relative(self, numbers: Floats, states: Floats | None) -> Floats:
        """Return motions as they are compared, places relative to their states.

        ``numbers`` has shape (…, steps, dimensions), ``states`` (…, numbers), and the result (…,
        steps, columns). A number that is no place, or has no number in the state, stays as it is.
        Plain numbers come first, then nine numbers of each rotation (`eyechart.spaces.rotations`).
        """
        shown = states if self.kind in PLACES else None
        if shown is None and not self.rotations_of("motion"):
            return numbers
        result = numbers.copy()
        for number, dimension in enumerate(self.dimensions):
            if dimension.state is not None and shown is not None:
                result[..., number] -= shown[..., dimension.state, None]
        turns = [self._turned(one, numbers, shown) for one in self.rotations_of("motion")]
        return np.concatenate([result[..., list(self.plain)], *turns], axis=-1) if turns else result

    def _turned(self, one: Rotation, numbers: Floats, states: Floats | None) -> Floats:
        """Return a rotation of motions, from the state's rotation on if it has one."""
        found = one.matrices(numbers)
        if states is None or one.state is None:
            return compared(found)
        (own,) = (each for each in self.rotations_of("state") if each.first == one.state)
        return compared(np.swapaxes(own.matrices(states), -1, -2)[..., None, :, :] @ found)

    def in_parts(self, numbers: Floats) -> Floats:
        """Return compared motions (…, columns) with one number a part, a rotation's angle."""
        every = [numbers[..., many] for many in map(list, self.parts.values())]
        found = [angle(one) if one.shape[-1] == MATRIX else one[..., 0] for one in every]
        return np.stack(found, axis=-1)

    def spreads(self, numbers: Floats) -> Floats:
        """Return the spread of each column of compared motions (…, columns); a rotation has one."""
        spread = np.asarray(numbers.reshape(-1, self.width).std(axis=0))
        for many in self.parts.values():
            if len(many) == MATRIX:
                spread[list(many)] = np.sqrt((spread[list(many)] ** 2).sum() / FREEDOM)
        return spread

    def scales(self, logged: Floats | None = None) -> Floats:
        """Return the scale of each column of `relative`: declared, or the log's spread.

        ``logged`` has shape (frames, steps, columns). The scale is 1 if neither exists: a dimension
        that never moved counts in its own unit.
        """
        spread = None if logged is None or not len(logged) else self.spreads(logged)
        own = self._declared_scales()
        found = np.ones(len(own)) if spread is None else np.where(spread > ONE_VALUE, spread, 1.0)
        return np.array([far if scale is None else scale for scale, far in zip(own, found, strict=True)])

    def unscaled(self, logged: Floats) -> frozenset[str]:
        """Return the parts of `relative` that have neither a declared scale nor a spread in the log.

        ``logged`` has shape (frames, steps, columns); without frames every undeclared part counts.
        """
        own, spread = self._declared_scales(), self.spreads(logged) if len(logged) else np.zeros(self.width)
        still = {place for place, scale in enumerate(own) if scale is None and spread[place] <= ONE_VALUE}
        return frozenset(name for name, many in self.parts.items() if still.issuperset(many))

    def _declared_scales(self) -> list[float | None]:
        """Return the declared scale of each column of `relative`, None without one."""
        own = [self.dimensions[number].scale for number in self.plain]
        for one in self.rotations_of("motion"):
            own += [self.dimensions[one.first].scale] * MATRIX
        return own

    def displacement(self, numbers: Floats, axis: str) -> Floats:
        """Return the displacement of compared motions (…, steps, columns) along an axis, shape (…).

        Deltas add up, velocities too by their rate; a place is that of the last step. A rotation
        has none.
        """
        along = [place for place, number in enumerate(self.plain) if self.dimensions[number].along == axis]
        rows = numbers[..., along].sum(axis=-1)
        if self.kind in PLACES:
            return np.asarray(rows[..., -1])
        return np.asarray(rows.sum(axis=-1) / (self.rate_hz or 1.0 if self.kind == "velocity" else 1.0))

    def distance(self, one: Motion, other: Motion) -> float:
        """Return the root mean square difference over steps and dimensions, in units of scale."""
        apart = (self.relative(one.array, None) - self.relative(other.array, None)) / self.scales()
        count = len(self.plain) + FREEDOM * len(self.rotations_of("motion"))
        if self.width == count:
            return float(np.sqrt(np.mean(apart**2)))
        return float(np.sqrt((apart**2).sum(axis=-1).mean() / count))

    def project(self, action: Motion, axis: str) -> float | None:
        """Return a motion's displacement along an axis of the world; None without a dimension."""
        return float(self.displacement(self.relative(action.array, None), axis)) if axis in self.axes else None

    def reflect(self, action: Motion) -> Motion | None:
        """Return the motion that the reflected world calls for; None if that is unknown."""
        return Motion.of(reflect(action.array, self.dimensions)) if self.mirrored else None

    def reflect_relative(self, numbers: Floats) -> Floats:
        """Return the result of `relative` in the reflected world; differences reflect about 0."""
        own = [
            replace(dimension, about=0.0) if self._is_relative(dimension) else dimension
            for dimension in self.dimensions
        ]
        return reflect(numbers, own)

    def _is_relative(self, one: Dimension) -> bool:
        return self.kind in PLACES and one.state is not None and bool(self.state)

    def reflect_text(self, text: str) -> str:
        """Return an instruction with its ``words`` exchanged as whole words, capitals kept."""
        pairs = {one.lower(): other for pair in self.words for one, other in (pair, pair[::-1])}
        if not pairs:
            return text
        every = "|".join(re.escape(pair) for pair in sorted(pairs, key=len, reverse=True))

        def other(found: re.Match[str]) -> str:
            own, said = found[0], pairs[found[0].lower()]
            if own.isupper() and len(own) > 1:
                return said.upper()
            return said[:1].upper() + said[1:] if own[:1].isupper() else said

        return re.sub(rf"(?<!\w)(?:{every})(?!\w)", other, text, flags=re.IGNORECASE)

    def symbol(self, action: Motion) -> str:
        """Return a motion in words: its first step."""
        first = action.array.reshape(-1, len(self.dimensions))[0]
        return ", ".join(f"{one.name} {number:.3g}" for one, number in zip(self.dimensions, first, strict=True))

    def role(self, symbol: str) -> str:
        """Return "other": no motion has a role."""
        del symbol
        return "other"

    def apart(self, other: "MotionSpace") -> dict[str, tuple[str, str]]:
        """Return the differences from another space in words, without those of reflection alone.

        Empty if both give the numbers the same meaning.
        """
        pairs = {
            "kind": (self.kind, other.kind),
            "horizon": (str(self.horizon), str(other.horizon)),
            "rate": tuple("none" if one.rate_hz is None else f"{one.rate_hz:g} Hz" for one in (self, other)),
            "dimensions": tuple(", ".join(each.name for each in one.dimensions) for one in (self, other)),
            "rotations": tuple(one.rotations_in_words() for one in (self, other)),
            "form of answers": (self.form, other.form),
        }
        if pairs["dimensions"][0] == pairs["dimensions"][1]:
            for mine, theirs in zip(self.dimensions, other.dimensions, strict=True):
                states = (self._state_of(mine), other._state_of(theirs))  # noqa: SLF001 - of its own kind
                pairs[f"the number of the state that '{mine.name}' is relative to"] = states
                for name in ("unit", "scale", "along"):
                    own = tuple(str(getattr(one, name) or "none") for one in (mine, theirs))
                    pairs[f"{name} of '{mine.name}'"] = (own[0], own[1])
        return {name: (one, two) for name, (one, two) in pairs.items() if one != two}

    def _state_of(self, one: Dimension) -> str:
        return "none" if one.state is None else self.state[one.state].name

    def rotations_in_words(self) -> str:
        """Return the rotations as `--rotation` declares them, "none" without any."""
        found = (f"{one.of}[{one.first}:{one.numbers.stop}]={one.representation}" for one in self.rotations)
        return ", ".join(sorted(found)) or "none"

    def wording(self) -> str:
        """Return a text that changes with the space."""
        return json.dumps(self.as_dict(), sort_keys=True)

    def written(self) -> dict[str, object]:
        """Return the space as plain JSON values, under its name in a prompt."""
        return {"motion": self.as_dict()}

    def as_dict(self) -> dict[str, object]:
        """Return the space as plain JSON values."""
        return to_json_fields(
            self,
            f"name horizon kind rate_hz mirrored {'words ' if self.words else ''}dimensions state"
            f"{' rotations' if self.rotations else ''}",
        )


def require_motions(space: AnySpace | None) -> MotionSpace:
    """Return the space of a run of policies."""
    assert isinstance(space, MotionSpace)
    return space
