"""Declared fields of an answer: read by a key, a pattern, or the words; strictly."""

import re
import time

import pytest

from eyechart.errors import SpecError
from eyechart.spaces.declared import AnswerSpace, answer_from
from eyechart.spaces.fields import AnswerField, FieldValues, candidates_of, read_answer_fields, read_fields
from eyechart.spaces.linear_pattern import LinearPattern

IDS = AnswerField("action", key="action", values=("0", "1", "2", "3", "4"))
HASHED = AnswerField("action", pattern=r"Response to user:\s*#+ *(-?\d+)", values=IDS.values)
SPEED = AnswerField("speed", kind="number", pattern=r"speed: ([-+\d.,eE]+)", unit="m/s")
ALONE = AnswerField("speed", kind="number", unit="m/s")
NESTED = AnswerField("speed", kind="number", key="plan.speed")
PAIRS = AnswerField("path", kind="vector", size=4)

READ = [
    (IDS, '{"action": 3}', "3"),
    (IDS, "{'action': 3}", "3"),
    (IDS, 'So I choose:\n```json\n{"why": "free", "action": "3"}\n```', "3"),
    (IDS, '{"action": 3} and once more {"action": 3}', "3"),
    (HASHED, "Final Answer: Deceleration\nResponse to user:#### 4", "4"),
    (SPEED, "speed: -2.5e1 m/s", -25.0),
    (SPEED, "speed: 3m/s, then", 3.0),
    (AnswerField("a", pattern=r"Steer: (\w+)", values=("L", "N")), "Steer: L / Brake: N", "L"),
    (SPEED, "speed: 3; steer: 2", 3.0),
    (ALONE, "−2", -2.0),
    (ALONE, "3.5 m/s.", 3.5),
    (NESTED, '{"speed": 9, "plan": {"speed": 2}}', 2.0),
    (NESTED, '{"plan": {"speed": "2"}}', 2.0),
    (PAIRS, "[(1, 2), (3, -4)]", (1.0, 2.0, 3.0, -4.0)),
    (PAIRS, "```\n[1, 2.5, 3e2, 4]\n```", (1.0, 2.5, 300.0, 4.0)),
    (AnswerField("path", kind="vector", size=2, key="v"), '{"v": [1, 2]}', (1.0, 2.0)),
    (AnswerField("steer", values=("left", "slight left")), "The action is slight left.", "slight left"),
]
UNREAD = [
    (IDS, "I go on.", "no_answer"),
    (IDS, '{"action": 1.5}', "other_value"),
    (IDS, '{"action": "-1"}', "other_value"),
    (IDS, '{"action": -1}', "other_value"),
    (IDS, '{"action": 3, "action": 2}', "several_values"),
    (IDS, "{'action': 3, 'action': 2}", "several_values"),
    (IDS, '[{"action": 1}, {"action": 2}]', "several_values"),
    (IDS, '{"action": 3} No: action: 4', "several_values"),
    (IDS, 'You said {"action": <n>}: {"action": 3}', "malformed"),
    (IDS, '{"action": 3', "malformed"),
    (IDS, '{"action": {"action": 3}}', "wrong_type"),
    (IDS, '{"action": [3]}', "wrong_type"),
    (IDS, '{"action": true}', "wrong_type"),
    (IDS, '{"action": null}', "wrong_type"),
    (IDS, '{"action": NaN}', "other_value"),
    (IDS, '{"result": {"action": 3}}', "no_answer"),
    (IDS, '{"action": 3, "error": "no image"}', "says_error"),
    (HASHED, "Response to user:#### 1.5", "part_of_a_word"),
    (HASHED, "Response to user:#### 4th", "part_of_a_word"),
    (HASHED, "Response to user:#### -4", "other_value"),
    (HASHED, "Response to user:#### 4 km/h", "other_unit"),
    (HASHED, "Response to user:#### 4\nResponse to user:#### 3", "several_values"),
    (AnswerField("a", pattern="(STOP|GO)", values=("STOP", "GO")), "NONSTOP", "part_of_a_word"),
    (AnswerField("a", pattern=r"steer.*?(\d)", values=("1", "2")), "steer -2", "part_of_a_word"),
    (AnswerField("a", pattern=r"Steer: (\w+)", values=("L", "N", "R")), "Steer: L, N or R", "several_values"),
    (AnswerField("a", pattern=r"Steer: (\w+)", values=("L", "N", "R")), "Steer: L/R", "several_values"),
    (HASHED, "Response to user:#### 4-5", "several_values"),
    (SPEED, "speed: 0 to 15 m/s", "several_values"),
    (SPEED, "speed: 0 m/s - 15 m/s", "several_values"),
    (SPEED, "speed: 3 km/h", "other_unit"),
    (SPEED, "speed: 3,5", "not_a_number"),
    (SPEED, "speed: 1,200", "not_a_number"),
    (SPEED, "speed: 1e999", "not_finite"),
    (ALONE, "NaN", "not_finite"),
    (ALONE, "1e40", "not_finite"),
    (ALONE, "about 3", "not_a_number"),
    (ALONE, "3 km/h", "other_unit"),
    (ALONE, "3 5", "not_a_number"),
    (NESTED, '{"plan": {"speed": ' + "9" * 400 + "}}", "not_finite"),
    (NESTED, '{"plan": {"speed": Infinity}}', "not_finite"),
    (PAIRS, "[1, 2, 3]", "wrong_size"),
    (PAIRS, "[1, [2], 3, 4]", "not_a_vector"),
    (PAIRS, "[1, 2, 3, 4", "not_a_vector"),
    (PAIRS, "1, 2, 3, 4", "not_a_vector"),
    (PAIRS, "[1, 2, 3, NaN]", "not_a_vector"),
    (PAIRS, "[1, 2, 3, 1e99]", "not_finite"),
    (PAIRS, "past [0, 0, 0, 0], next [1, 2, 3, 4]", "not_a_vector"),
]


@pytest.mark.parametrize(("field", "text", "value"), READ)
def test_a_field_is_read_where_it_was_declared(field: AnswerField, text: str, value: object) -> None:
    """A reply's value comes back in its kind."""
    assert read_fields(text, [field]).values == (value,)


@pytest.mark.parametrize(("field", "text", "why"), UNREAD)
def test_what_is_not_one_value_is_no_answer(field: AnswerField, text: str, why: str) -> None:
    """The reason is one word, and names the field."""
    found = read_fields(text, [field])
    assert (found.values, found.why, found.field) == (None, why, field.name)


def test_several_fields_are_read_together_or_not_at_all() -> None:
    """A reply without one field's value has no answer."""
    both = (AnswerField("vx", kind="number", key="vx"), AnswerField("turn", key="turn", values=("left", "right")))
    assert read_fields('{"vx": 0.5, "turn": "Left"}', both).values == (0.5, "left")
    found = read_fields('{"vx": 0.5}', both)
    assert (found.why, found.field) == ("no_answer", "turn")


def test_a_number_belongs_to_the_first_range_that_holds() -> None:
    """A number outside all ranges is no answer."""
    field = AnswerField("speed", kind="number", key="v", values=("<= 0", "< 5", "5..30"), brake=("<= 0", "< 5"))
    assert [field.range_of(value) for value in (-1, 0, 0.1, 5, 30, 31)] == [
        "<= 0",
        "<= 0",
        "< 5",
        "5..30",
        "5..30",
        None,
    ]
    assert read_fields('{"v": 31}', [field]).why == "other_value"


@pytest.mark.parametrize(
    ("table", "fault"),
    [
        ({}, "one list: fields"),
        ({"fields": []}, "no fields"),
        ({"fields": [{"kind": "name"}]}, "name"),
        ({"fields": [{"name": "a", "kind": "word"}]}, "kind"),
        ({"fields": [{"name": "a", "colour": 1}]}, "colour"),
        ({"fields": [{"name": "a b"}]}, "begins with a letter"),
        ({"fields": [{"name": "a", "key": "x", "pattern": "(x)"}]}, "a key and a pattern"),
        ({"fields": [{"name": "a", "key": "x."}]}, "empty part"),
        ({"fields": [{"name": "a", "pattern": "x"}]}, "0 groups"),
        ({"fields": [{"name": "a", "pattern": "(x)(y)"}]}, "2 groups"),
        ({"fields": [{"name": "a", "pattern": "(x"}]}, "no regular expression"),
        ({"fields": [{"name": "a", "pattern": r"(x)\1"}]}, "which this reader lacks"),
        ({"fields": [{"name": "a", "pattern": "(?=x)(x)"}]}, "which this reader lacks"),
        ({"fields": [{"name": "a", "pattern": "((?:x{1000}){1000})"}]}, "repeats too much"),
        ({"fields": [{"name": "a", "kind": "vector"}]}, "needs its size"),
        ({"fields": [{"name": "a", "kind": "vector", "size": 2, "unit": "m"}]}, "no values, from_column or unit"),
        ({"fields": [{"name": "a", "size": 2}]}, "only a vector"),
        ({"fields": [{"name": "a", "unit": "m"}]}, "a name has no unit"),
        ({"fields": [{"name": "a", "kind": "number", "values": ["slow"]}]}, "no range of numbers"),
        ({"fields": [{"name": "a", "kind": "number", "values": ["5..2"]}]}, "holds no number"),
        ({"fields": [{"name": "a", "kind": "number", "from_column": "x"}]}, 'kind = "name"'),
        ({"fields": [{"name": "a", "values": ["x", "X"]}]}, "another value's name"),
        ({"fields": [{"name": "a", "values": ["x", "-"]}]}, "cannot be read"),
        ({"fields": [{"name": "a", "values": ["x", "y"], "brake": ["z"]}]}, "brake names 'z'"),
        ({"fields": [{"name": "a", "values": ["x", "y"], "brake": ["x"], "proceed": ["x"]}]}, "cannot both"),
        ({"fields": [{"name": "a", "values": ["x", "y"], "from_column": "z"}]}, "not both"),
        ({"fields": [{"name": "a"}, {"name": "b", "key": "b"}]}, "needs a key or a pattern"),
        (
            {"fields": [{"name": "a", "key": "p.x"}, {"name": "b", "key": "p.x.y"}]},
            "key 'p.x.y' is inside 'p.x', which is the value of another field",
        ),
        ({"fields": [{"name": one, "pattern": "x: (a|b)"} for one in "ab"]}, "two fields have one pattern: x"),
        ({"fields": [{"name": "a", "key": "x"}, {"name": "b", "key": "x"}]}, "one key"),
    ],
)
def test_a_wrong_table_is_refused_by_its_fault(table: object, fault: str) -> None:
    """The error names the file, the field and the fault."""
    with pytest.raises(SpecError, match=r"^prompt\.toml: ") as refused:
        read_answer_fields(table, "prompt.toml")
    assert fault in str(refused.value)


def ranged(*values: str) -> dict[str, object]:
    """Return an [answer] of one number with these ranges."""
    return {"fields": [{"name": "v", "kind": "number", "values": list(values)}]}


@pytest.mark.parametrize(
    ("table", "fault"),
    [
        (ranged("< 5", "< 3"), "field 'v': the range '< 3' never holds: every number in it is in '< 5' before it"),
        (ranged("< 5", "<5"), "the range '<5' never holds: every number in it is in '< 5' before it"),
        (ranged("<= 5", "5..5"), "the range '5..5' never holds: every number in it is in '<= 5' before it"),
        (ranged("0..5", "5..9", "1..8"), "'1..8' never holds: every number in it is in '0..5' and '5..9' before it"),
        (ranged("< 5", ">= 5", "3..8"), "'3..8' never holds: every number in it is in '< 5' and '>= 5' before it"),
        (ranged("> 1", ">= 2"), "'>= 2' never holds: every number in it is in '> 1' before it"),
        (ranged("< 2", "> 1e31"), "'> 1e31' never holds: numbers beyond 1e+30 are not read"),
        ({"fields": [{"name": "v", "values": ["left"]}]}, "field 'v' has one value, 'left', so that every answer is"),
        (ranged("< 5", "< 5"), "values has '< 5' twice; leave one out"),
        ({"fields": [{"name": "v", "values": ["left", "right", "left"]}]}, "values has 'left' twice; leave one out"),
    ],
)
def test_what_no_reply_can_be_read_as_is_refused_by_its_name(table: object, fault: str) -> None:
    """In a file; a run of before, whose prompt has it, is read all the same."""
    with pytest.raises(SpecError, match=r"^prompt\.toml: ") as refused:
        answer_from(table, "prompt.toml", "prompt")
    assert fault in str(refused.value)
    if "twice" not in fault:
        assert AnswerSpace.from_dict(table).fields


@pytest.mark.parametrize(
    "values",
    [
        ("<= 0", "< 5", ">= 5"),
        ("0..5", "5..9"),
        ("3..8", "0..9"),
        ("< 5", "<= 5"),
        ("> 5", ">= 5"),
        ("5..5", "0..9"),
        ("< 2", "5..8"),
        ("0..30",),
    ],
)
def test_ranges_of_which_each_holds_somewhere_are_taken(values: tuple[str, ...]) -> None:
    """Overlaps are read by their order; a number between two ranges is no answer."""
    (field,) = answer_from(ranged(*values), "prompt.toml", "prompt").fields
    numbers = (-1.0, 0.0, 1.0, 3.0, 4.0, 5.0, 6.0, 8.0, 9.0, 40.0)
    assert {field.range_of(one) for one in numbers} - {None} == set(values)
    if values == ("< 2", "5..8"):
        assert (read_fields("3", [field]).values, read_fields("3", [field]).why) == (None, "other_value")


def test_a_field_is_written_as_it_was_declared() -> None:
    """What is written reads back as the same field."""
    declared = {
        "name": "steer",
        "kind": "name",
        "key": "control.steer",
        "values": ["left", "right", "none"],
        "mirror_pairs": [["left", "right"]],
        "aliases": [["l", "left"]],
    }
    (field,) = read_answer_fields({"fields": [{**declared, "aliases": {"l": "left"}}]}, "it")
    assert field.as_dict() == declared
    assert read_answer_fields({"fields": [declared]}, "it") == (field,)


def test_a_pattern_finds_what_pythons_own_finds() -> None:
    """The groups of all matches are equal."""
    patterns = [r"\b(STOP|GO)\b", r"x{2,4}?(y+)", r"(?im)^action: *(\S+)$", r"([^a-c\]]+)", r"(a|ab)(?:c|bcd)d*"]
    for text in ("ab GO go STOP.", "xxxyy xxxxxy", "hm\naction: b\nACTION: c", "a]b-c", "abcd", ""):
        for one in patterns:
            own = [found[1] for found in re.finditer(one, text)]
            assert [found.text for found in LinearPattern(one).search(text)] == own, (one, text)


def test_no_pattern_takes_long() -> None:
    """A pattern that takes Python's own expressions for ever is matched in linear time."""
    began = time.process_time()
    for one, sign in ((r"(?:(?:a*)*)*(b)", "a"), (r"a*a*a*a*(b)", "a"), (r"\s*(x)", " ")):
        assert not list(LinearPattern(one).search(sign * 20_000))
    assert time.process_time() - began < 5
    field = AnswerField("a", pattern="((?:a?){300}b)")
    assert read_fields("a" * 90_000, [field]).why == "too_long"


def test_a_frames_own_names_come_from_its_column() -> None:
    """A list may be JSON, or stand with commas or in lines."""
    assert candidates_of("3, 5,7") == candidates_of('["3", 5, 7]') == candidates_of("3\n5\n7\n") == ("3", "5", "7")
    assert candidates_of(4) == ("4",)
    assert candidates_of("") == ()


def test_a_pattern_that_repeats_nothing_is_read_at_once() -> None:
    """However often it does: nothing is made of it."""
    for one in ("(x)(?:(?:a{0}){9999}){300}", "(x)(?:(?:(?:a{0}){9999}){9999}){9999}"):
        assert [found.text for found in LinearPattern(one).search("x")] == ["x"]


DRIVEN = AnswerField("speed", "number", pattern=r"[Ss]peed:? (-?\d+(?:\.\d+)?)", unit="m/s")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("speed 3 knots", "other_unit"),
        ("Speed: 3 miles per hour", "other_unit"),
        ("speed 3 m/s per second", "other_unit"),
        ("speed 3 metres", "other_unit"),
        ("speed 30 percent", "other_unit"),
        ("speed 1 200", "part_of_a_word"),
        ("speed 1,200", "part_of_a_word"),
        ("speed 1'200 m/s", "part_of_a_word"),
        ("not speed: 3", "no_answer"),
        ("I do not choose speed 3", "no_answer"),
        ("rather than speed 3", "no_answer"),
        ("speed 11 km/h, that is speed 3 m/s", "several_values"),
    ],
)
def test_a_number_that_means_another_one_is_no_answer(text: str, why: str) -> None:
    """Another unit, thousands that are cut off, and what is denied."""
    assert read_fields(text, [DRIVEN]) == FieldValues(None, why, "speed")


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ('{"speed": 5, "turn": "left"}\nWait, the lead is close. I change to 2 m/s.', None),
        ('{"speed": 5, "turn": "left"}\nActually no, 2 m/s.', None),
        ('{"speed": 5, "turn": "left"}\nSorry: −5.', None),
        ('{"speed": 5, "turn": "left"}\nOn second thought, turn right.', None),
        ('{"speed": 5, "turn": "left"}\nActually, Right!', None),
        ('{"speed": 5, "turn": "left"}\nActually the lead is 8 m ahead, 5 m/s is safe.', (5.0, "left")),
        ('{"speed": 5, "turn": "left"}\nI turn left, and not right. I wait 2 s before.', (5.0, "left")),
        ('{"speed": 5, "turn": "left"} The lead is actually very close.', (5.0, "left")),
        ('Wait, 9 m/s and right are unsafe. {"speed": 5, "turn": "left"}', (5.0, "left")),
    ],
)
def test_a_correction_behind_an_object_leaves_it_unread(text: str, values: object) -> None:
    """Though it does not name the field: of two values, nobody knows which is meant."""
    turn = AnswerField("turn", key="turn", values=("left", "right"))
    found = read_fields(text, [AnswerField("speed", "number", "speed", unit="m/s"), turn])
    assert (found.values, found.why) == (values, None if values else "several_values")


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ("speed 18 (km/h)", False),
        ("speed: 18 [in km/h]", False),
        ("speed: 18 in km/h", False),
        ("speed (km/h): 18", False),
        ("Speed in km/h: 18", False),
        ("speed: 5 m/s^2", False),
        ("speed: 5 (m/s)", True),
        ("speed (m/s): 5", True),
        ("Speed in m/s: 5", True),
        ("speed: 5 in the left lane (clear)", True),
        ("(gap 8 m) speed: 5", True),
    ],
)
def test_a_unit_in_brackets_or_behind_in_is_the_numbers_too(text: str, read: object) -> None:
    """Before the number and behind it."""
    field = AnswerField("speed", "number", pattern=r"[Ss]peed(?: \(.*\)| in \S+)?:? (-?\d+)", unit="m/s")
    assert read_fields(text, [field]).why == (None if read else "other_unit")


def test_a_declared_field_says_no_unit_of_another() -> None:
    """Whatever its name: a reply that holds what is asked for is read."""
    keys = {"speed": "m/s", "speed_kmh": "km/h"}
    fields = [AnswerField(key, "number", key, unit=unit) for key, unit in keys.items()]
    assert read_fields('{"speed": 5, "speed_kmh": 18}', fields).values == (5.0, 18.0)
    named = [fields[0], AnswerField("unit", key="unit", values=("m/s", "km/h"))]
    assert read_fields('{"speed": 5, "unit": "km/h"}', named).values == (5.0, "km/h")


def test_a_unit_around_a_number_within_an_object_is_its_own() -> None:
    """Of the object that holds the field's, or of one around that."""
    fields = [AnswerField("vx", "number", "move.vx", unit="m/s"), AnswerField("wz", "number", "move.wz", unit="rad/s")]
    for unit, values in (("km/h", None), ("m/s", (18.0, 0.0))):
        for text in ('{"move": {"vx": 18, "wz": 0}, "unit": "%s"}', '{"move": {"vx": 18, "wz": 0, "unit": "%s"}}'):
            assert read_fields(text % unit, fields).values == values


def test_of_two_units_the_one_that_a_pattern_names_is_read() -> None:
    """Under a key nobody knows which of both a number is in, so it is no answer."""
    text = "the angle in degrees is 11.5, in rad 0.2"
    named = AnswerField("angle", "number", pattern=r"in rad (-?\d+(?:\.\d+)?)", unit="rad")
    assert read_fields(text, [named]) == FieldValues((0.2,))
    keyed = AnswerField("angle", "number", key="angle", unit="rad")
    assert read_fields(f'{{"angle": 0.2}} ({text})', [keyed]) == FieldValues(None, "other_unit", "angle")


@pytest.mark.parametrize(
    "text", ["speed 3 m/s", "speed 3", "Speed: 3.0 m/s, as the lead is far", "speed 3 m/s. Not faster."]
)
def test_a_number_with_its_own_unit_is_read(text: str) -> None:
    """The unit of the field may follow, and words after it."""
    assert read_fields(text, [DRIVEN]) == FieldValues((3.0,))


def test_a_sign_in_words_is_not_lost() -> None:
    """Minus three is no three."""
    field = AnswerField("steer", "number", pattern=r"steer (?:minus |negative )?(\d+)")
    for text in ("steer minus 3", "steer negative 3"):
        assert read_fields(text, [field]) == FieldValues(None, "no_answer", "steer")


def test_an_example_is_no_answer_and_a_correction_in_words_is_heard() -> None:
    """Only what the reply means counts, in whatever capitals it says it again."""
    field = AnswerField("speed", "number", key="speed")
    for text in ('{"speed": 3}. Actually Speed is 4', '{"speed": 3}\nThe speed should be 4.', '{"speed": 3} Speed: 4'):
        assert read_fields(text, [field]) == FieldValues(None, "several_values", "speed")
    assert read_fields('Example: {"speed": 3}.', [field]) == FieldValues(None, "no_answer", "speed")
    assert read_fields('For example {"speed": 3}. My answer: {"speed": 4}', [field]) == FieldValues((4.0,))
    assert read_fields('{"speed": 3} The speed of the lead is unknown.', [field]) == FieldValues((3.0,))


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ('{"speed": 5, "speed_unit": "km/h", "steer": 0.1}', False),
        ('{"speed": 5, "steer": 0.1, "units": {"speed": "km/h", "steer": "rad"}}', False),
        ('{"speed": 5, "steer": 0.1, "steer unit": "deg"}', False),
        ('{"speed": 5, "speed_unit": "m/s", "steer": 0.1, "steer_unit": "rad"}', True),
        ('{"speed": 5, "steer": 0.1, "unit": "m/s and rad"}', True),
        ('{"speed": 5, "steer": 0.1, "unit_test": "km/h"}', True),
        ('{"speed": 5, "steer": 0.1} (steer in degrees)', False),
        ('{"speed": 5, "steer": 0.1}, where `steer` is given in deg.', False),
        ('I state speed (km/h) and steer (rad): {"speed": 5, "steer": 0.1}', False),
        ('{"speed": 5, "steer": 0.1} (Steer in radians, speed [m/s])', True),
        ('{"speed": 5, "steer": 0.1} I steer in the left lane, speed in check.', True),
        ('{"speed": 5, "steer": 0.1} (in degrees)', False),
        ('{"speed": 5, "steer": 0.1} (in rad)', True),
        ('{"speed": 18, "steer": 0.1, "unit": "km/h"}', False),
        ('{"speed": 18, "steer": 0.1, "Units": "km/h and rad"}', False),
        ('{"speed": 18, "steer": 0.1, "units": ["km/h", "rad"]}', False),
        ('{"speed": 18, "steer": 0.1, "unit": {"Speed": "km/h"}}', False),
        ('{"speed": 5, "steer": 0.1, "units": {"speed": "metres per second", "gap": "ft"}}', True),
        ('{"speed": 18, "steer": 0.1, "unit_of_speed": "km/h"}', False),
        ('{"speed": 18, "steer": 0.1, "linear_unit": "km/h"}', False),
        ('{"speed": 18, "steer": 0.1, "speed_kmh": 18}', False),
        ('{"speed": 5, "steer": 0.1, "speed (km/h)": 18}', False),
        ('{"speed": 5, "steer": 0.1, "speed_mps": 5, "steer_rad": 0.1, "speed_min": 0, "speed_max": 9}', True),
        ('{"speed": 5, "steer": 0.1, "gap": 20, "gap_unit": "ft", "community": "m"}', True),
        ('Units: km/h and rad. {"speed": 18, "steer": 0.1}', False),
        ('{"speed": 5, "steer": 0.1}, speed in metres per second / steer in rad / as usual', True),
        ('{"speed": 5, "steer": 0.1} (speed in meters per second squared)', False),
        ('{"speed": 5, "steer": 0.1} (steer in rad/s)', False),
    ],
)
def test_a_unit_that_stands_beside_a_number_is_the_fields_own(text: str, read: object) -> None:
    """As one does that follows the number; of several fields, a unit that names none must be that of one."""
    fields = [AnswerField("speed", "number", "speed", unit="m/s"), AnswerField("steer", "number", "steer", unit="rad")]
    found = read_fields(text, fields)
    assert (found.values, found.why) == ((5.0, 0.1), None) if read else (None, "other_unit")
    for own in ('{"speed": 5, "unit": "km/h"}', '{"speed": 5} (in km/h)', 'Units: km/h. {"speed": 5}'):
        assert read_fields(own, fields[:1]).why == "other_unit"
    assert read_fields('{"speed": 5} (in m/s)', fields[:1]).values == (5.0,)


@pytest.mark.parametrize(
    ("unit", "spelled"),
    [
        *(("m/s²", one) for one in ("m/s²", "m/s^2", "m / s2", "metres per second squared")),
        *(("%", one) for one in ("%", "percent")),
        *(("km/h", one) for one in ("km/h", "kph", "kilometres per hour", "km per hour")),
        *(("kn", one) for one in ("kn", "knots")),
        *(("mph", one) for one in ("mph", "miles per hour")),
    ],
)
def test_the_words_around_an_object_may_spell_the_fields_unit_in_another_way(unit: str, spelled: str) -> None:
    """It is the same unit, and the answer counts."""
    field = AnswerField("push", "number", "push", unit=unit)
    assert read_fields(f'The push in {spelled}: {{"push": 5}}', [field]).values == (5.0,)
