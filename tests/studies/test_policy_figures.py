"""Figures of policies: no words upon a picture, no chart against a label, and what is drawn is said in words."""

from collections.abc import Iterator
from html import escape
from itertools import combinations
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from eyechart.report.charts import BLUE, INK, MUTED, VERMILLION, WAYS, shorten_middle, style, width_of
from eyechart.simulators import open_bank_simulator
from eyechart.spaces.motion import Dimension, MotionSpace
from eyechart.studies import policy
from eyechart.studies.policy import PolicySelection
from eyechart.studies.policy.figures import _LINES, MotionLine, curves, moments, paths, shares
from eyechart.studies.policy.page import in_a_sentence, made
from eyechart.studies.policy.scores import PolicyScore
from eyechart.studies.policy.tables import MEANINGS, meaning_table, meant_by
from eyechart.verdicts.policy_verdict import PolicyVerdict
from policies_by_hand import GOOD, IGNORED, NOT_ONE_BIT, OPEN, USED, share, verdict, without

STEPS = 16
JOINTS = (
    *("left_shoulder_pan.pos", "left_shoulder_lift.pos", "left_elbow_flex.pos", "left_wrist_flex.pos"),
    *("left_wrist_roll.pos", "left_gripper.pos", "left_spare_joint_of_a_long_name.pos"),
)
CAMERAS = ("observation.images.cam_high", "observation.images.cam_low", "left_wrist", "right_wrist")
WORDS = (
    "another episode's pictures",
    "the named object moved",
    "another instruction",
    "another episode's state",
    "pictures at a similar state",
)


def an_arm(joints: int, *, plane: bool = False) -> MotionSpace:
    """Return a space of so many joints, or of as many numbers along two axes of the world."""
    names = [name.replace("left", side) for side in ("left", "right", "third") for name in JOINTS][:joints]
    along = ("x", "y") if plane else ("",)
    dimensions = [Dimension(name, "degrees", along=along[turn % len(along)]) for turn, name in enumerate(names)]
    return MotionSpace("arm", tuple(dimensions), STEPS, rate_hz=30)


def some_lines(space: MotionSpace, count: int) -> list[MotionLine]:
    """Return its answer and so many others, of numbers that are large here and small there."""
    rng = np.random.default_rng(3)
    wide = 10.0 ** (np.arange(space.shape[1]) % 6 - 3)
    looks = [("its answer", INK, "-"), *((words, *how) for words, how in zip(WORDS, _LINES, strict=True))]
    return [MotionLine(*how, wide * rng.normal(size=space.shape).cumsum(axis=0)) for how in looks[: 1 + count]]


def boxes(figure: Figure) -> tuple[dict[str, Bbox], dict[str, Bbox]]:
    """Return where the texts of a figure stand, and its pictures, in pixels."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    drawn = canvas.get_renderer()
    shown = [text for legend in figure.legends for text in legend.get_texts()]
    shown += [text for axes in figure.axes for text in _texts(axes) if text.get_text()]
    texts = {f"{text.get_text()} {number}": text.get_window_extent(drawn) for number, text in enumerate(shown)}
    pictures = [image for axes in figure.axes for image in axes.images]
    return texts, {f"picture {number}": picture.get_window_extent(drawn) for number, picture in enumerate(pictures)}


def _texts(axes: Axes) -> Iterator[Text]:
    """Yield the texts of one chart that are drawn: labels of ticks beyond its axes are not."""
    yield from (axes.title, *axes.texts)
    for axis in (axes.xaxis, axes.yaxis) if axes.axison else ():
        low, high = sorted(axis.get_view_interval())
        yield axis.label
        for tick in axis.get_major_ticks():
            if tick.label1.get_visible() and low - 1e-9 <= tick.get_loc() <= high + 1e-9:
                yield tick.label1


def collisions(figure: Figure, texts: dict[str, Bbox], pictures: dict[str, Bbox]) -> Iterator[tuple[str, str]]:
    """Yield which of the boxes of a figure lie upon one another, upon a picture, or beyond the figure."""
    whole = figure.bbox
    for (name, one), (other_name, other) in combinations((texts | pictures).items(), 2):
        if min(one.x1, other.x1) - max(one.x0, other.x0) > 1 and min(one.y1, other.y1) - max(one.y0, other.y0) > 1:
            yield name, other_name
    for name, one in (texts | pictures).items():
        if one.x0 < whole.x0 - 1 or one.x1 > whole.x1 + 1 or one.y0 < whole.y0 - 1 or one.y1 > whole.y1 + 1:
            yield name, "the edge"


@pytest.mark.parametrize("plane", [False, True], ids=["joints", "plane"])
@pytest.mark.parametrize("cameras", [0, 1, 4])
@pytest.mark.parametrize("joints", [1, 6, 20])
def test_no_words_lie_upon_a_picture_nor_upon_others(joints: int, cameras: int, plane: bool) -> None:  # noqa: FBT001
    """Of any number of joints, with names as robots have them, and cameras as data sets name them."""
    if plane and joints < 2:
        return
    space = an_arm(joints, plane=plane)
    seen = {name: np.zeros((48, 64, 3)) for name in CAMERAS[:cameras]}
    for count in (1, len(_LINES)):
        lines = some_lines(space, count)
        with style():
            figure = paths(seen, space, lines) if plane else curves(seen, space, lines, np.ones(len(space.dimensions)))
            texts, pictures = boxes(figure)
        assert list(collisions(figure, texts, pictures)) == []
        assert len(pictures) == cameras
        if not plane:
            titles = [text.get_text() for axes in figure.axes[cameras:] for text in axes.texts]
            assert all(title.startswith(("left", "right", "third")) for title in titles)
            assert len(titles) == len(set(titles)) == len(space.dimensions)
        assert sum(name.startswith(("its answer", *WORDS)) for name in texts) == 1 + count


def test_a_name_is_shortened_to_its_room() -> None:
    """Both ends stay; one with room stands whole."""
    assert shorten_middle("top", 1.0, 8) == "top"
    short = shorten_middle("left_spare_joint_of_a_long_name.pos", 1.0, 8)
    assert short.startswith("left")
    assert short.endswith("pos")
    assert width_of(short, 8) <= 1.0 < width_of(short + "xxx", 8)


def test_what_hardly_differs_is_drawn_alike() -> None:
    """An axis spans at least the scale of its number."""
    space = an_arm(1)
    lines = some_lines(space, 1)
    flat = [
        MotionLine(line.words, line.colour, line.dashes, np.full(space.shape, 1e-6 * turn))
        for turn, line in enumerate(lines)
    ]
    with style():
        figure = curves({}, space, flat, np.array([2.0]))
    low, high = figure.axes[0].get_ylim()
    assert high - low >= 2.0


def test_no_two_lines_of_a_figure_look_alike() -> None:
    """Neither by colour nor by dashes; grey, which cannot be told from grey in the dark, is none of them."""
    assert len({colour for colour, _ in _LINES}) == len({str(dashes) for _, dashes in _LINES}) == len(_LINES) == 5
    assert {colour for colour, _ in _LINES} <= set(WAYS.values()) - {WAYS["grey"]}


def colours(judged: PolicyVerdict, statistics: dict[str, Any]) -> dict[str, tuple[str, bool]]:
    """Return the colour of each row of a chart of shares, and whether its dot is full."""
    (drawing,) = shares(judged, SimpleNamespace(statistics=statistics))  # type: ignore[arg-type]
    axes = drawing.figure.axes[0]
    names = [yticklabel.get_text() for yticklabel in axes.get_yticklabels()]
    dots = [collection for collection in axes.collections if len(collection.get_offsets()) == 1]
    edges = [to_hex(dot.get_edgecolor()[0]) for dot in dots]
    faces = [to_hex(dot.get_facecolor()[0]) for dot in dots]
    return {name: (edge, edge == face) for name, edge, face in zip(names, edges, faces, strict=True)}


def test_a_chart_does_not_say_what_its_label_does_not() -> None:
    """A camera that changes not one bit is undecided: its rows are hollow, and so are used ones whose axis is open."""
    changed = {"T.swapped@camera:wrist": NOT_ONE_BIT, "T.matched@camera:wrist": NOT_ONE_BIT, "told": IGNORED}
    judged = verdict(**changed, named=None, follow=None)
    assert judged.cameras["wrist"].label == "undecided"
    asked = {
        **GOOD,
        **changed,
        "T.swapped@cameras": USED,
        "T.swapped@state": USED,
        "T.blank@top": OPEN,
        "T.blank": IGNORED,
    }
    found = colours(judged, asked)
    assert found["cameras: another episode's"] == (BLUE, True)
    assert found["cameras: grey"] == (VERMILLION, True)
    assert found["wrist: another episode's"] == found["wrist: at a similar state"] == (MUTED, False)
    assert found["top: grey"] == (MUTED, False)
    shown = {"T.swapped@cameras": USED, "T.matched@cameras": OPEN}
    used = colours(verdict(matched=OPEN), shown)
    assert used["cameras: another episode's"] == (BLUE, True)
    assert used["cameras: at a similar state"] == (MUTED, False)
    pose = verdict(matched=None, asked=without("matched@cameras"))
    assert pose.camera.label == "undecided"
    assert colours(pose, shown)["cameras: another episode's"] == (MUTED, False)
    (drawing,) = shares(pose, SimpleNamespace(statistics=shown))  # type: ignore[arg-type]
    assert "because the verdict is undecided, whatever the interval: cameras. The line below says why" in drawing.note
    for words in ("Shaded, 0 to 0.02: too small", "dashed line, 0.1:", "stretched near 0 (square root)"):
        assert words in drawing.note
    assert "one above 1" not in drawing.note
    (more,) = shares(verdict(), SimpleNamespace(statistics={"T.swapped@cameras": share(0.9, 1.4)}))  # type: ignore[arg-type]
    assert "Above 1, the exchange changes its answer more than another moment does" in more.note


def test_the_page_says_in_a_sentence_who_looks() -> None:
    """In the order in which policies stand, each by its name where they are few."""
    few = [("a", "Yes"), ("b", "deaf"), ("c", "Yes"), ("d", "none")]
    assert (
        in_a_sentence(few) == "Of 4 policies, 2 look (a, c), 1 looks but does not listen (b) and 1 gets no verdict (d)."
    )
    assert in_a_sentence([*few, ("e", "No")]).endswith("1 gets no verdict and 1 does not look.")
    assert in_a_sentence([("a", "No"), ("b", "No")]) == "Of 2 policies, 2 do not look (a, b)."


@pytest.fixture(scope="module")
def scored(tmp_path_factory: pytest.TempPathFactory) -> PolicyScore:
    """Return a run of a policy that looks and of one that draws, with every subset of the channels."""
    folder = tmp_path_factory.mktemp("figures")
    bank = open_bank_simulator("tabletop").build(folder / "bank", seeds=(0, 1), steps=4)
    specs = ["python:arms:reach", "python:arms:unsteady"]
    policy.run(policy.plan(bank.root, specs, folder / "run", extent=PolicySelection(shapley=True)))
    return policy.score(folder / "run")


@pytest.mark.slow
def test_every_statistic_is_explained(scored: PolicyScore) -> None:
    """Whatever a run prints has its line in the table of meanings."""
    names = {meant_by(name) for model in scored.models.values() for name in model.statistics}
    assert names - set(MEANINGS) == set()
    assert {row[0] for row in meaning_table(scored).rows} == names


@pytest.mark.slow
def test_a_moment_says_whose_it_is_and_how_it_is_read(scored: PolicyScore) -> None:
    """The policy, the moment, what it is told, what a line is, and which way y points; at most five lines a figure."""
    spec = "python:arms:reach"
    drawn = moments(spec, scored.models[spec], None)
    assert {moment.name.partition("-")[0] for moment in drawn} == {"moment", "pictures", "world"}
    for one in drawn:
        assert one.title.startswith(f"{spec} at ")
        assert "told “reach the" in one.title
        assert "Each line is the path of its motion (8 steps" in one.note
        assert "from the ring on; y points down, as in a picture" in one.note
        assert one.description.count(",") < 1 + len(_LINES)
    assert "at which other pictures change its answer most" in drawn[0].note
    assert "The first of 4 answers is drawn." in moments("u", scored.models["python:arms:unsteady"], None)[0].note


@pytest.mark.slow
def test_the_page_draws_each_moment_once(scored: PolicyScore) -> None:
    """The one at its head is not drawn again below, and no two figures of a policy are of one moment."""
    spec = "python:arms:reach"
    titles = [moment.title for moment in moments(spec, scored.models[spec], None)]
    assert len(set(titles)) == len(titles) >= 4
    head, _, rest = made([(scored, None)]).page.html.decode().partition('id="part-1"')
    first, *others = map(escape, titles)
    assert first in head
    assert first not in rest
    assert all(one in rest for one in others)


@pytest.mark.slow
def test_the_page_names_the_policy_at_its_head_and_folds_its_statistics(scored: PolicyScore) -> None:
    """The first figure is of who is named first; tables of statistics are closed; costs hold what is known."""
    html = made([(scored, None)]).page.html.decode()
    head = html.partition('id="part-1"')[0]
    assert head.index("python:arms:reach") < head.index("python:arms:unsteady")
    assert '<title id="in-short-title">python:arms:reach at ' in head
    assert "y points down, as in a picture" in head.partition("in-short-title")[2]
    for name in ("what each statistic is", "python:arms:reach", "how much of each dimension"):
        assert f"<details><summary><bdi>{name}</bdi></summary>" in html
    costs = html[html.index('<table class="costs">') :].partition("</thead>")[0]
    assert ">calls</th>" in costs
    for gone in ("tokens in", "reasoning", "first byte", ">cost<", "energy"):
        assert gone not in costs
