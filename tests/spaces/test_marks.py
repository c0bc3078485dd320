"""Names that are numbers or letters: a sign or a fraction makes another number, a letter is no article."""

import json

import pytest

from eyechart.calls import Reply
from eyechart.errors import SpecError
from eyechart.spaces.discrete import Discrete

IDS = Discrete("ids", ("0", "1", "2", "3", "4"), (("0", "2"),), ("4",), ("1", "3"))

HALF = Discrete(
    "half",
    ("HARD_LEFT", "LEFT", "CENTRE", "RIGHT", "HARD_RIGHT"),
    (("LEFT", "RIGHT"), ("HARD_LEFT", "HARD_RIGHT")),
    (),
    ("CENTRE",),
    (("0", "CENTRE"), ("1", "RIGHT"), ("2", "HARD_RIGHT")),
)
SPEEDS = Discrete("speeds", ("0.5", "1", "1.5", "2"), (), ("0.5",), (), (("1.5 m/s", "1.5"), ("2 m/s", "2")))
LETTERS = Discrete("letters", ("A", "B", "C", "D", "E"), (), (), ())

FORMS = (
    "{}",
    "Action: {}",
    "Action:{}",
    "action={}",
    "Answer: {}.",
    "**{}**",
    "\\boxed{{{}}}",
    "<answer>{}</answer>",
    '{{"action": "{}"}}',
    "{{'action': {}}}",
    "I choose {}.",
    "So the answer is {}.",
    "Final answer: ({})",
    "The road is clear.\n#### {}",
)


def bins() -> Discrete:
    """Return a space whose names are numbers with signs."""
    return Discrete("bins", ("-2", "-1", "0", "1", "2"), (("-2", "2"), ("-1", "1")), (), ("0",))


def degrees() -> Discrete:
    """Return a space of angles, some of which may have their unit."""
    aliases = (("-15°", "-15"), ("15°", "15"), ("15 deg", "15"))
    return Discrete("degrees", ("-30", "-15", "0", "15", "30"), (), (), (), aliases)


def read(space: Discrete, text: str) -> str | None:
    """Return the action that is read in a reply, None where there is none."""
    return space.read(Reply(text, "stop", None)).action


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    "number", ["-2", "-1", "−2", "–2", "1.5", "0.3", "-0.5", "1,5", "2/3", "1-2", "12", "2e1", "2%", "-3"]
)
def test_a_number_with_another_sign_or_fraction_is_no_action(form: str, number: str) -> None:
    """Neither of ids, nor where words have the digits for aliases."""
    for space in (IDS, HALF):
        assert read(space, form.format(number)) is None


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("number", ["-2", "-1", "0", "1", "2"])
def test_a_number_is_read_with_its_sign(form: str, number: str) -> None:
    """Names with signs are names; a minus of typography is one, and a plus or a fraction of zeros changes nothing."""
    assert read(bins(), form.format(number)) == number
    assert read(bins(), form.format(number.replace("-", "\u2212"))) == number
    if number in {"1", "2"}:
        assert read(bins(), form.format(f"+{number}")) == number
        assert read(bins(), form.format(f"{number}.0")) == number


@pytest.mark.parametrize("value", [3, 3.0, "3", " 3 ", "3.0"])
@pytest.mark.parametrize(
    "key", ["action", "Action", "action_id", "choice", "next_action", "answer", "option", "cmd", "meta_action"]
)
def test_a_number_in_json_is_the_name_that_it_spells(key: str, value: object) -> None:
    """By itself, fenced, inside a call, beside a reason."""
    found = json.dumps({"reason": "2 cars are 1.5 m ahead", key: value})
    assert read(IDS, found) == "3"
    assert read(IDS, f"```json\n{found}\n```") == "3"
    assert read(IDS, json.dumps({"name": "act", "arguments": {key: value}})) == "3"


@pytest.mark.parametrize("value", [True, False, None, 3.5, -3, 33, [1, 2], [], {"x": 1}, 1e400, "3 cars"])
def test_another_value_in_json_is_no_action(value: object) -> None:
    """Neither true, which Python takes for 1, nor a number that no name spells."""
    assert read(IDS, json.dumps({"action": value})) is None


@pytest.mark.parametrize("key", ["count", "vehicle_count", "confidence", "distance_m", "lane", "step", "score"])
def test_a_number_under_another_key_is_no_action(key: str) -> None:
    """It counts or measures something."""
    assert read(IDS, json.dumps({key: 3})) is None


@pytest.mark.parametrize(
    "text",
    [
        "I would keep 2 m distance.",
        "So 3 vehicles are near.",
        "Answer: 3 vehicles are ahead",
        "action: 2 lanes to the left",
        "The car is 2.",
        "Lane 2 is free.",
        "There are 2.",
        "Between 1 and 3.",
        "It is 3:45.",
        "Choose 1-3.",
        "In step 3 the car slows.",
        "1. The road is clear.\n2. The lane is free.\n3. So we go on.",
        "Options: 0, 1, 2, 3, 4",
        "Rate: 3/4",
        "3 to 4 cars",
        "I am 3 % sure.",
    ],
)
def test_a_number_that_counts_measures_or_numbers_is_no_choice(text: str) -> None:
    """Whatever stands before it."""
    assert read(IDS, text) is None


@pytest.mark.parametrize(
    "text",
    [
        "option 3",
        "I choose option 3.",
        "#3",
        "(3)",
        "3.",
        "3: accelerate",
        "3. Accelerate",
        "Action 3",
        "Answer: option (3)",
    ],
)
def test_a_number_that_stands_as_an_option_is_a_choice(text: str) -> None:
    """With a word that says so, alone, or before what it means."""
    assert read(IDS, text) == "3"


@pytest.mark.parametrize(
    "text",
    [
        "Action: a hard right",
        "So a hard right.",
        "The car should take a slight right.",
        "A turn is needed.",
        "Answer: A car is ahead, steer right",
        "A careful driver would brake.",
        "Plan A is unclear.",
        "Vitamin C",
        "It is a B road.",
        "Vehicle B is near.",
        "E. coli",
        "C. elegans bacteria are visible.",
        "J. B. Goode",
        "Washington D. C.",
        "e. g. a car",
        "A. m.",
        "c. 20 metres",
        "It is 20 \u00b0C.",
        "a",
    ],
)
def test_an_article_and_other_things_of_one_letter_are_no_option(text: str) -> None:
    """But a letter by itself is one, in whatever case."""
    assert read(LETTERS, text) == ("A" if text == "a" else None)


@pytest.mark.parametrize(
    "text",
    [
        "B",
        "b",
        "(B)",
        "(b)",
        "b)",
        "B.",
        "B: steer right",
        "B) steer right",
        "**B**",
        "Answer: B",
        "Option B",
        "I would choose option B",
        "I choose option b.",
        "The answer is B.",
        "The answer is B because the road bends.",
        '{"option": "B"}',
        '{"choice": "b"}',
        "\\boxed{B}",
        "Not A but B.",
        "#### B",
        "B. turn left",
        "B. opens the door",
        "Not C. B.",
        "B. This is it",
        "B. 20 km/h",
        "B. medium speed",
        "I choose B. medium speed",
        "B. dangerous ahead, so slow",
        "In lane 2 B is best",
        "B. strikes a good balance",
        "1. B",
    ],
)
def test_a_letter_that_stands_as_an_option_is_a_choice(text: str) -> None:
    """By itself, behind a word that says so, with a bracket, in its own case."""
    assert read(LETTERS, text) == "B"


def test_a_number_with_a_unit_is_read_where_an_alias_has_the_unit() -> None:
    """The sign still counts."""
    assert read(SPEEDS, "Speed: 1.5") is None
    assert read(SPEEDS, "1.5 m/s") == "1.5"
    assert read(SPEEDS, "Action: 2 m/s") == "2"
    assert read(degrees(), "15°") == "15"
    assert read(degrees(), "-15°") == "-15"
    assert read(degrees(), "-15 deg") is None
    assert read(degrees(), "Answer: 1.5") is None
    assert read(degrees(), "1.5 deg") is None


@pytest.mark.parametrize("names", [("-30", "0", "+30"), ("-1.5", "0.5"), ("+5 deg", "-5 deg"), ("-30°", "30°")])
def test_a_name_may_be_a_number_with_its_sign(names: tuple[str, ...]) -> None:
    """And every name is read as itself."""
    space = Discrete("own", names, (), (), ())
    assert [read(space, f"Action: {name}") for name in names] == [*names]


@pytest.mark.parametrize("names", [("1", "+1"), ("1", "1.0"), ("-0", "0")])
def test_two_names_of_one_number_are_refused(names: tuple[str, ...]) -> None:
    """Nobody could tell which was meant."""
    with pytest.raises(SpecError, match="are the same number"):
        Discrete("own", names, (), (), ())


@pytest.mark.parametrize("name", ["-", "+", "--1", "- ", "\u2190", "forward(1.0)", ".", "-a"])
def test_signs_without_a_number_are_no_name(name: str) -> None:
    """As before."""
    with pytest.raises(SpecError, match="cannot be read"):
        Discrete("own", (name, "GO"), (), (), ())


def test_the_side_of_a_sign_is_what_an_alias_says() -> None:
    """Below zero is left, unless the words for a side are names of the other numbers."""
    names, pair = ("-1", "0", "1"), (("-1", "1"),)
    plain = Discrete("plain", names, pair, (), ())
    turned = Discrete("turned", names, pair, (), (), (("left", "1"), ("right", "-1")))
    for text, of_plain, of_turned in (
        ("-1 (left)", "-1", None),
        ("1 (left)", None, "1"),
        ("Action: -1 (right)", None, "-1"),
    ):
        assert (read(plain, text), read(turned, text)) == (of_plain, of_turned)
