"""Motions in words: a model states a motion's numbers in declared fields, or as rows of numbers."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from dataclasses import fields as fields_of
from functools import cached_property
from typing import Self

import numpy as np

from eyechart.errors import SpecError, printable, raising
from eyechart.records import build
from eyechart.spaces.declared import place
from eyechart.spaces.fields import AnswerField, read_declared, require_fields
from eyechart.spaces.motion import Dimension, Motion, MotionSpace
from eyechart.spaces.space import Answer, Decision, unparsed, without_thinking

ROWS = "motion"
"""The key of an undeclared answer's rows in a JSON object."""
_QUOTED = 80


@dataclass(frozen=True)
class StatedMotionSpace(MotionSpace):
    """Motions that a model states in words.

    With ``fields`` each dimension is a field of its name: a number where the horizon is one step,
    else a vector of the steps. Or one vector holds the whole motion, a row a step. Without fields
    the reply is a JSON array of such rows, alone or as ``{"motion": …}``; one step is one row.
    Nothing is repeated or filled in. Raises SpecError if the fields are not the dimensions.
    """

    fields: tuple[AnswerField, ...] = ()

    @classmethod
    def of(cls, space: MotionSpace, fields: Sequence[AnswerField] = ()) -> Self:
        """Return the space of these motions, stated in these fields; a field's unit may be left out."""
        given = {one.name: getattr(space, one.name) for one in fields_of(MotionSpace)}
        units = {field_of(one): one.unit for one in space.dimensions}
        known = [
            replace(one, unit=units.get(one.name, "")) if one.kind == "number" and not one.unit else one
            for one in fields
        ]
        if len(known) == 1 and known[0].kind == "vector" and known[0].name not in units:
            known = [replace(known[0], width=known[0].width or len(space.dimensions))]
        return cls(**given, fields=tuple(known))

    @classmethod
    def read_from(cls, motion: MotionSpace, values: object) -> Self:
        """Return the space from a prompt's plain fields; raises SpecError that names the fault."""
        listed = values if isinstance(values, list) else []
        with raising(SpecError, "the prompt", of=(ValueError, SpecError)):
            return cls.of(motion, [build(AnswerField, one, f"field {number}") for number, one in enumerate(listed, 1)])

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.fields:
            require_fields(self.fields)
            self._require_numbers()
            self._require_dimensions()

    def _require_numbers(self) -> None:
        """Raise SpecError for a field that is a name."""
        for one in self.fields:
            if one.kind == "name":
                raise SpecError(
                    f"answer field '{one.name}' is a name, and a policy answers with numbers. A policy that answers "
                    "with names is a controller: 'eyechart run battery' with --prompt FILE asks it"
                )

    def _require_dimensions(self) -> None:
        """Raise SpecError unless the fields are the dimensions, each with its steps and its unit."""
        steps, wide = self.shape
        if self._is_whole:
            if (one := self.fields[0]).size != steps * wide or one.width != wide:
                raise SpecError(
                    f"answer field '{one.name}' has {one.size} numbers in rows of {one.width}, and a motion of the "
                    f"bank {steps} steps of {wide}: {self._numbers}; write size = {steps * wide}"
                )
            return
        units, found = {field_of(one): one.unit for one in self.dimensions}, [one.name for one in self.fields]
        if len(units) < len(self.dimensions):
            raise SpecError(
                f"several numbers of a step have one field's name: {self._numbers}, of "
                f"{', '.join(one.name for one in self.dimensions)}; declare one vector of all, size = {steps * wide}"
            )
        if sorted(found) != sorted(units):
            raise SpecError(
                f"the answer has the fields {', '.join(found)}, and a step of the bank's motions the numbers "
                f"{self._numbers}: declare a field of each name, or one vector of all"
            )
        for one in self.fields:
            if one.unit and units[one.name] and one.unit != units[one.name]:
                raise SpecError(
                    f"answer field '{one.name}' is in {one.unit}, and the bank's motions have it in "
                    f"{units[one.name]}: let the prompt ask for {units[one.name]}"
                )
            if (one.size or 1) != steps or (one.kind == "number" and steps > 1):
                raise SpecError(
                    f"answer field '{one.name}' is {one.size or 1} of the {steps} steps of a motion, and no step is "
                    f'repeated. Write kind = "vector", size = {steps}, or make a bank of one step (--horizon 1)'
                )

    @property
    def _numbers(self) -> str:
        return ", ".join(map(field_of, self.dimensions))

    @property
    def _is_whole(self) -> bool:
        """Return whether one field holds the whole motion."""
        names = set(map(field_of, self.dimensions))
        return len(self.fields) == 1 and self.fields[0].kind == "vector" and self.fields[0].name not in names

    @cached_property
    def _answer_fields(self) -> tuple[AnswerField, ...]:
        """Return the fields of an answer in JSON, each with its key."""
        steps, wide = self.shape
        fields = self.fields or (AnswerField(ROWS, "vector", size=steps * wide, width=wide),)
        return tuple(one if one.key or one.pattern else replace(one, key=one.name) for one in fields)

    @property
    def form(self) -> str:
        """Return in words how an answer comes."""
        return f"fields {', '.join(one.name for one in self.fields)}" if self.fields else "rows in words"

    def schema(self) -> dict[str, object]:
        """Return the JSON schema of an answer: an object with each field at its key."""
        result: dict[str, object] = {}
        for one in self._answer_fields:
            place(result, (one.key or one.name).split("."), one.schema())
        return result

    def read(self, reply: Answer) -> Decision[Motion]:
        """Return the motion in a reply's words, or the reason why there is none."""
        found = read_declared(
            reply.text, reply.finish_reason, reply.error, self._fields_in(without_thinking(reply.text))
        )
        if found.action is None:
            return Decision(None, found.missing, found.why)
        steps, wide = self.shape
        values = dict(zip((one.name for one in self._answer_fields), found.action, strict=True))
        if not self.fields or self._is_whole:
            (numbers,) = values.values()
            motion = Motion.of(np.reshape(numbers, (steps, wide)))
        else:
            columns = [np.reshape(values[field_of(one)], steps) for one in self.dimensions]
            motion = Motion.of(np.stack(columns, axis=1))
        fault = self._fault(motion)
        return unparsed(fault) if fault else Decision(motion)

    def _fields_in(self, text: str) -> tuple[AnswerField, ...]:
        """Return the fields as they stand in a text: a single one is the whole reply, or in JSON.

        A text without a digit holds no number, and is read as one that lacks the field.
        """
        if "{" in text or len(self._answer_fields) > 1 or re.search(r"\d", text) is None:
            return self._answer_fields
        (one,) = self._answer_fields
        own = self.fields[0] if self.fields else replace(one, key=None)
        return (own,)

    def lacks(self, reply: Answer) -> str:
        """Return in words why a reply holds no motion; "" for a motion, an error or a refusal."""
        decision = self.read(reply)
        if decision.action is not None or decision.missing in {"error", "refused"}:
            return ""
        if decision.missing == "truncated":
            return "it is cut off: raise --max-tokens"
        if decision.missing == "empty":
            return "it is empty"
        said = reply.text.strip()
        quoted = printable(said if len(said) <= _QUOTED else f"{said[:_QUOTED]}…")
        return f"it is read as {decision.why}: '{quoted}'"

    def wording(self) -> str:
        """Return a text that changes with the space."""
        return json.dumps(self.written(), sort_keys=True)

    def written(self) -> dict[str, object]:
        """Return the space as plain JSON values, under its names in a prompt."""
        return {**super().written(), "stated": [one.as_dict() for one in self.fields]}


def field_of(dimension: Dimension) -> str:
    """Return the name of a dimension's answer field: its own, with ``_`` for dots and other signs."""
    return re.sub(r"[^\w-]", "_", dimension.name)
