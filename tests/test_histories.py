"""Banks that hold the instants before each frame: from the import to a verdict, a bundle and an export."""

import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import movers
from eyechart.bundle import validate, write_bundle
from eyechart.calls import Query, Reply
from eyechart.channels import partners
from eyechart.conditions import FROZEN, OVER, STEPPED, TABLE, asked_of, find_condition, is_available, show, sources
from eyechart.conditions.policies import conditions_of
from eyechart.errors import BankError, SourceError, SpecError
from eyechart.frames import BankWriter, Frame, FrameBank, Stimulus, check, decode, open_bank, same_moments
from eyechart.importing import Choices, import_table
from eyechart.models import OpenedModel, policy_callable, python_callable
from eyechart.modes import RequestMode
from eyechart.probe.policies import examine_policy
from eyechart.studies import battery, policy
from eyechart.studies.battery import BatterySettings
from eyechart.studies.policy.scores import judge
from faults import FaultServer

STEPS = 8
PROMPT = """
[[messages]]
role = "user"
text = "Before: {picture:top@-1}"
[[messages]]
role = "user"
text = "Now: {picture:top}, and from the side {picture:side}. Choose one of: {actions}."
"""


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of ten episodes with two instants before each frame."""
    return movers.mover_bank(tmp_path_factory.mktemp("two"), history=2)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of the same log without earlier instants."""
    return movers.mover_bank(tmp_path_factory.mktemp("none"), history=0)


def shown(seen: Stimulus) -> list[list[float]]:
    """Return the places that the top and the side picture of each instant show, the oldest first."""
    return [
        [float(movers.middle(decode(image, "a picture")[None])[0]) for image in one.images.values()]
        for one in (*seen.past, seen)
    ]


# The import


def test_a_frame_has_the_rows_before_it_oldest_first(bank: FrameBank) -> None:
    """With the pictures, the state and the words of each, as the log has them."""
    rows = {(row["drive"], row["step"]): row for row in movers.moved()}
    assert len(bank) == 10 * (STEPS - 2)
    for frame in bank:
        assert [one.step for one in frame.window] == [frame.step - 2, frame.step - 1, frame.step]
        for one in frame.window:
            row = rows[int(frame.episode), one.step]
            assert one.state["block"] == pytest.approx((row["x"], row["y"]), abs=1e-4)
            assert one.fields == {"task": f"go {int(frame.episode) % 2}"}
            assert [*one.pictures] == ["top", "side"]
        seen = shown(show("real", frame, bank, 0))
        assert np.allclose(seen, [one.state["block"] for one in frame.window], atol=0.01)
        assert all(one == one.instant() for one in frame.past)


def test_moments_at_the_start_of_an_episode_are_left_out_and_counted(bank: FrameBank) -> None:
    """Nothing is padded."""
    assert min(frame.step for frame in bank) == 2
    assert bank.manifest.settings["said"] == ["20 moments at the start of episodes left out: no 2 rows before them"]


def test_a_gap_before_a_moment_leaves_it_out_by_name(tmp_path: Path) -> None:
    """A row that the log lacks is not passed over: the instants would not be a step apart."""
    bank = movers.mover_bank(tmp_path, history=2, gaps=((1, 4), (3, 5)))
    assert {(frame.episode, frame.step) for frame in bank} == {
        (str(episode), step)
        for episode in range(10)
        for step in range(2, STEPS)
        if (episode, step) not in {(1, 4), (1, 5), (1, 6), (3, 5), (3, 6), (3, 7)}
    }
    _, gaps = bank.manifest.settings["said"]
    assert gaps == (
        "4 moments left out, with a gap in the rows before: step 5 of episode 1 (no step 4), "
        "step 6 of episode 1 (no step 4), step 6 of episode 3 (no step 5), step 7 of episode 3 (no step 5)"
    )


def test_every_counts_moments_with_the_log_s_rows_before_them(tmp_path: Path, plain: FrameBank) -> None:
    """They are those that have their rows; these come at the rate of the log, not of the frames."""
    few = movers.mover_bank(tmp_path, history=1, every=3)
    assert {frame.step for frame in few} == {1, 4, 7}
    for frame in few:
        assert [one.step for one in frame.window] == [frame.step - 1, frame.step]
        assert frame.motion == plain.frame(frame.id).motion
    assert len(check(few.root)) == 0


def test_rows_out_of_order_are_no_window(tmp_path: Path) -> None:
    """The last row need not be the instant before."""
    folder = movers.source(tmp_path, episodes=3)
    head, *lines = (folder / "t.csv").read_text().splitlines()
    lines[2], lines[3] = lines[3], lines[2]
    (folder / "t.csv").write_text("\n".join([head, *lines]))
    chosen = Choices(columns={"file": "top"}, history=2)
    bank = import_table(folder, folder / "t.csv", tmp_path / "bank", chosen)
    assert [frame.step for frame in bank if frame.episode == "0"] == [6, 7]
    _, behind = bank.manifest.settings["said"]
    assert "4 moments left out, with a gap in the rows before: step 3 of episode 0 (no step 2), step 2 of " in behind
    assert "step 4 of episode 0 (its rows are not in the order of the steps)" in behind


def test_a_picture_is_stored_once_whatever_shows_it(bank: FrameBank) -> None:
    """As a frame's own and as that before others; and none that no frame shows."""
    files = {str(path.relative_to(bank.root)) for path in bank.root.rglob("*.png")}
    assert files == {*bank.manifest.images}
    assert len(files) == 2 * 10 * STEPS


@pytest.mark.parametrize("without", ["episode", "step"])
def test_a_history_needs_episodes_and_steps(tmp_path: Path, without: str) -> None:
    """Without them nothing says what came before."""
    folder = movers.source(tmp_path)
    chosen = Choices(columns={without: "", "file": "top"}, history=1)
    with pytest.raises(SourceError) as refused:
        import_table(folder, folder / "t.csv", tmp_path / "bank", chosen)
    assert str(refused.value).startswith(f"history needs the order of the rows: name the {without} with ")
    assert "row 1" not in str(refused.value)
    assert not (tmp_path / "bank").exists()


def test_a_log_without_so_many_rows_is_refused(tmp_path: Path) -> None:
    """And the limit of instants is said."""
    with pytest.raises(SourceError, match=r"history=8: t.csv has no moment with so many rows before it: 80 moments"):
        movers.mover_bank(tmp_path, history=STEPS)
    with pytest.raises(SpecError, match="history takes 0 to 50 instants"):
        Choices(history=51)


# The bank


def test_a_bank_without_a_history_is_as_ever(plain: FrameBank, bank: FrameBank) -> None:
    """No word of it in its files; a frame with a past is another moment."""
    assert "history" not in json.loads((plain.root / "manifest.json").read_text())
    assert '"past"' not in (plain.root / "metadata.jsonl").read_text()
    assert plain.manifest.history == 0
    assert same_moments(plain.manifest, bank.manifest) == ()
    assert bank.frames[0].geometry() == replace(bank.frames[0]).geometry()
    assert bank.frames[0].geometry() != replace(bank.frames[0], past=bank.frames[1].past).geometry()


def edited(bank: FrameBank, to: Path, number: int, change: object) -> Path:
    """Return a copy of a bank in which ``change`` was made of one row of its metadata."""
    shutil.copytree(bank.root, to)
    rows = [json.loads(line) for line in (to / "metadata.jsonl").read_text().splitlines()]
    change(rows[number])  # type: ignore[operator]
    (to / "metadata.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    return to


def test_an_instant_with_another_s_picture_is_found(bank: FrameBank, tmp_path: Path) -> None:
    """Exchanged in a row, both are pictures of the bank, and each is whole."""

    def exchange(row: dict[str, list[dict[str, str]]]) -> None:
        one, other = row["past"]
        one["file_name"], other["file_name"] = other["file_name"], one["file_name"]

    for number in (0, 3):
        (problem,) = check(edited(bank, tmp_path / str(number), number, exchange))
        assert "metadata.jsonl" in problem
        assert "shows" in problem


def test_an_instant_with_another_state_is_found(bank: FrameBank, tmp_path: Path) -> None:
    """The fingerprint covers what a controller may see of it."""

    def change(row: dict[str, list[dict[str, list[float]]]]) -> None:
        row["past"][0]["block"][0] += 0.1

    with pytest.raises(BankError, match="differs from the manifest's fingerprint"):
        open_bank(edited(bank, tmp_path / "bank", 3, change))


def test_a_row_with_fewer_instants_is_refused(bank: FrameBank, tmp_path: Path) -> None:
    """By its line."""
    with pytest.raises(BankError, match=r"line 1: .*'past' must list 2 instants before the frame"):
        open_bank(edited(bank, tmp_path / "bank", 0, lambda row: row["past"].pop()))


@pytest.mark.parametrize(
    ("past", "says"),
    [
        (lambda _: (), "has 0 instants before it, but the manifest declares 2"),
        (lambda frame: (frame, frame), "is no instant of its episode"),
        (lambda frame: (replace(frame.past[0], episode="9"), frame.past[1]), "is no instant of its episode"),
        (lambda frame: frame.past, "of its past was not added before it"),
    ],
)
def test_a_writer_takes_whole_windows_only(bank: FrameBank, tmp_path: Path, past: object, says: str) -> None:
    """Each with the frame at fault."""
    frame: Frame = bank.frames[0]
    with pytest.raises(BankError, match=says), BankWriter(tmp_path / "bank", bank.manifest) as writer:
        writer.add(replace(frame, past=past(frame)), bank.images(frame), {})  # type: ignore[operator]


# Conditions


def test_conditions_act_on_every_instant(bank: FrameBank) -> None:
    """Grey, noise, one pixel, a reflection and no picture; noise is drawn anew for each instant."""
    frame = bank.frames[7]
    real = show("real", frame, bank, 0)
    for name in ("blank", "noise", "nudged", "mirrored", "fog_3"):
        made = show(name, frame, bank, 0)
        assert len(made.past) == 2
        for own, one in zip((*real.past, real), (*made.past, made), strict=True):
            assert own.state == one.state
            assert all(own.images[camera] != one.images[camera] for camera in own.images)
    assert len({one.images["top"] for one in (*show("noise", frame, bank, 0).past, show("noise", frame, bank, 0))}) == 3
    assert np.allclose(shown(show("mirrored", frame, bank, 0)), 1 - np.array(shown(real)), atol=0.01)
    assert show("text_only", frame, bank, 0).pictures == ()
    over = show("blank@side", frame, bank, 0)
    for own, one in zip((*real.past, real), (*over.past, over), strict=True):
        assert (own.images["top"] == one.images["top"], own.images["side"] == one.images["side"]) == (True, False)


def test_every_condition_shows_the_whole_window(bank: FrameBank) -> None:
    """Of policies and of models; one that forgot the past would leave a policy without its input."""
    frame = bank.frames[7]
    names = {*conditions_of(bank)[0], *(one.name for one in asked_of("model")), *STEPPED}
    asked = [name for name in names if name in STEPPED or is_available(name, frame, bank)]
    made = {name: len(show(name, frame, bank, 0).past) for name in asked if find_needs(name) <= {"partner", "axis"}}
    assert {name for name, count in made.items() if count != 2} == set()
    assert made.keys() >= {"real", "blank", "noise", "shuffled", "text_only", "mirrored", "nudged", "swapped@state"}


def find_needs(name: str) -> frozenset[str]:
    """Return what a condition needs of a source."""
    return (TABLE.get(name.partition(OVER)[0]) or STEPPED[name]).needs - {"control"}


@pytest.mark.parametrize("name", ["shuffled", "swapped@cameras", "matched@cameras", "near@cameras"])
def test_a_partner_lends_its_whole_window(bank: FrameBank, name: str) -> None:
    """Pictures of one frame's instants, in their order; the state and the words stay."""
    done = 0
    for frame in bank:
        if name != "shuffled" and not is_available(name, frame, bank):
            continue
        made, done = show(name, frame, bank, 0), done + 1
        other = next(one for one in bank if one.past and bank.images(one) == dict(made.images))
        assert [dict(one.images) for one in made.past] == [bank.images(one) for one in other.past]
        assert [one.state for one in (*made.past, made)] == [one.state for one in frame.window]
        assert other.id != frame.id
        assert {file for one in other.window for file in one.pictures.values()} <= {*sources(name, frame, bank, 0)}
    assert done > 15


def test_a_channel_is_exchanged_at_every_instant(bank: FrameBank) -> None:
    """The state, one camera, or all but one channel."""
    frame, real = bank.frames[9], show("real", bank.frames[9], bank, 0)
    state = show("swapped@state", frame, bank, 0)
    other = next(
        one for one in bank if [dict(made.state) for made in (*state.past, state)] == [i.state for i in one.window]
    )
    assert other.episode != frame.episode
    assert state.pictures == real.pictures
    side = show("swapped@camera:side", frame, bank, 0)
    assert all(one.images["top"] == own.images["top"] for one, own in zip(side.past, real.past, strict=True))
    assert not any(one.images["side"] == own.images["side"] for one, own in zip(side.past, real.past, strict=True))
    kept = show("kept@state", frame, bank, 0)
    assert [one.state for one in kept.past] == [one.state for one in real.past]
    assert not {*kept.pictures} & {*real.pictures}


def test_frozen_shows_the_oldest_picture_at_every_instant(bank: FrameBank, plain: FrameBank) -> None:
    """A still camera; the state goes on. A bank of single instants cannot show it."""
    frame = bank.frames[4]
    made, first = show(FROZEN, frame, bank, 0), bank.images(frame.past[0])
    assert [dict(one.images) for one in (*made.past, made)] == [first] * 3
    assert [one.state for one in (*made.past, made)] == [one.state for one in frame.window]
    assert sources(FROZEN, frame, bank, 0) == tuple(frame.past[0].pictures.values())
    assert FROZEN in conditions_of(bank)[0]
    supplied, left_out = conditions_of(plain)
    assert FROZEN not in {*supplied, *left_out}
    with pytest.raises(BankError, match=r"condition 'frozen' cannot be shown: .*--history"):
        policy.plan(plain.root, ["python:arm_logs:by_front"], plain.root.parent / "run", conditions=(FROZEN,))


def test_a_picture_with_one_thing_changed_is_of_one_instant_and_refused(bank: FrameBank) -> None:
    """Only the last instant would have it, as a jump that no camera saw."""
    changed = replace(bank.frames[0], counterfactuals={"recoloured": bank.frames[0].pictures})
    other = replace(bank, frames=(changed, *bank.frames[1:]))
    assert not is_available("recoloured", changed, other)
    assert conditions_of(other)[1]["recoloured"] == "the bank holds earlier instants, and has no such pictures of them"
    with pytest.raises(BankError, match="no such pictures of them"):
        find_condition("recoloured").make(changed, other, 0)


def test_a_match_is_alike_in_speed_too(bank: FrameBank) -> None:
    """Two moments at one place may go apart: pictures of both are no pictures at a similar state."""
    places = partners(bank.frames, "matched", "cameras", bank.manifest.images, bank.manifest.motion)
    moves = np.array([np.diff([one.state["block"] for one in frame.window], axis=0).ravel() for frame in bank])
    have = np.flatnonzero(places >= 0)
    assert len(have) > 10
    apart = ((moves[have] - moves[places[have]]) ** 2).sum(axis=1) / moves.var(axis=0).sum()
    assert apart.max() < 1.2  # of 2, which two moments at random have


# Policies


def test_a_policy_that_reads_its_speed_from_two_states_uses_its_state(tmp_path: Path) -> None:
    """It is not constant, and looks at nothing."""
    verdict = verdict_of(tmp_path, movers.by_states)
    assert [*verdict["guards"]] == []
    assert (verdict["camera"], verdict["state"]) == ("ignores_camera", "state_shortcut")


def test_a_policy_that_reads_its_speed_from_two_pictures_uses_its_camera(tmp_path: Path) -> None:
    """What it sees, two states tell too: that is a pose with its speed, and no more."""
    verdict = verdict_of(tmp_path, movers.by_pictures)
    assert [*verdict["guards"]] == []
    assert (verdict["camera"], verdict["state"]) == ("pose_only", "ignores_state")
    assert verdict["frozen"] > 0.2


def verdict_of(folder: Path, act: object) -> dict[str, object]:
    """Return the labels and the failed guards of a policy on a bank with one instant before each frame."""
    bank = movers.mover_bank(folder / "log", episodes=12)
    planned = policy.plan(bank.root, [held(act)], folder / "run")
    policy.run(planned)
    scored = policy.score(folder / "run")
    (one,) = judge(scored).values()
    (model,) = scored.models.values()
    return {
        "guards": one.guards,
        "camera": one.axes["camera"].label,
        "state": one.axes["state"].label,
        "frozen": model.statistics["T.frozen"].value,
    }


def held(act: object, name: str = "python:movers:mine") -> OpenedModel:
    """Return a callable as an open policy."""
    mode = RequestMode(name)
    return OpenedModel(mode, policy_callable.hold(act, mode))  # type: ignore[arg-type]


def test_a_policy_gets_the_last_instants_that_it_declares(bank: FrameBank) -> None:
    """With the oldest first and the frame last; without a declaration the frame alone, as ever."""
    frame, query = bank.frames[5], Query("", "go", show("real", bank.frames[5], bank, 0), 1)
    states = np.array([one.state["block"] for one in frame.window])
    for history in (0, 1, 2):
        images, state = policy_callable.arrays_of(query.stimulus, history)
        assert images["top"].shape == ((12, 64, 3) if not history else (history + 1, 12, 64, 3))
        assert np.array_equal(state, states[-1] if not history else states[-1 - history :])
        bars = movers.middle(images["top"] if history else images["top"][None])
        assert np.allclose(bars, states[-1 - history :, 0], atol=0.01)
    with pytest.raises(ValueError, match="3 instants before it are asked for, and it has 2"):
        policy_callable.arrays_of(query.stimulus, 3)


def test_a_bank_with_too_few_instants_is_refused_before_any_call(plain: FrameBank, tmp_path: Path) -> None:
    """With the option to give; never is such a policy called constant."""
    says = (
        r"'python:movers:mine' declares history = 1, and the bank .* holds 0 instants before each frame; .*--history 1"
    )
    with pytest.raises(SpecError, match=says):
        policy.plan(plain.root, [held(movers.by_states)], tmp_path / "run")
    with pytest.raises(SpecError, match=says):
        examine_policy(held(movers.by_states), plain)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("history", [-1, 1.0, True, "1", 51])
def test_a_history_is_a_whole_number(history: object) -> None:
    """Of a policy and of a controller."""

    def act(images: object, state: object, instruction: object) -> object: ...

    def ask(prompt: object, images: object, state: object) -> object: ...

    act.history = ask.history = history  # type: ignore[attr-defined]
    for opener, one in ((policy_callable.hold, act), (python_callable.hold, ask)):
        with pytest.raises(SpecError, match=r"declares history = .*; it must be a whole number from 0 to 50"):
            opener(one, RequestMode("python:movers:mine"))


def test_the_doctor_asks_with_windows(tmp_path: Path) -> None:
    """A channel is exchanged at every instant, so that one that is read through its changes is found."""
    bank = movers.mover_bank(tmp_path)
    found = {one.name: one.fine for one in examine_policy(held(movers.by_pictures), bank).findings}
    assert [found[name] for name in ("motions", "cameras", "camera:top", "camera:side", "constant")] == [True] * 5
    assert found["state"] is False


# Prompts and controllers


def test_a_prompt_shows_the_instant_before_in_its_place(bank: FrameBank, plain: FrameBank, tmp_path: Path) -> None:
    """Both pictures reach the server in their order, under every condition; the run is bundled and validates."""
    (tmp_path / "ask.toml").write_text(PROMPT)
    conditions = ("real", "blank", "shuffled", FROZEN, "text_only")
    with FaultServer() as server:
        mode = RequestMode("openai:m", base_url=server.base_url, timeout_s=20.0)
        asked = {"prompt": str(tmp_path / "ask.toml"), "conditions": conditions}
        few = battery.BatterySelection(3)
        assert battery.run(battery.plan(bank.root, [mode], tmp_path / "run", extent=few, **asked)).whole  # type: ignore[arg-type]
        more = battery.plan(bank.root, [mode], tmp_path / "run", extent=battery.BatterySelection(5), **asked)  # type: ignore[arg-type]
        assert more.left() == 2 * len(conditions)
        assert battery.run(more).whole
        with pytest.raises(SpecError, match=r"1 instant before a frame; .*eyechart frames import' and --history 1"):
            battery.plan(plain.root, [mode], tmp_path / "other", **asked)  # type: ignore[arg-type]
    sent = [pictures_of(one["messages"]) for one in server.asked]
    frames = battery.score(tmp_path / "run").manifest.frames or [frame.id for frame in more.plan.frames]
    for frame in map(bank.frame, frames):
        now = bank.images(frame)
        first, before = (bank.images(one) for one in frame.past)
        assert [uri(before["top"]), uri(now["top"]), uri(now["side"])] in sent
        assert [uri(first["top"]), uri(first["top"]), uri(first["side"])] in sent
    assert sent.count([]) == 5
    write_bundle(tmp_path / "run", tmp_path / "run.zip", banks=[bank.root])
    assert validate(tmp_path / "run.zip").holds


def pictures_of(messages: object) -> list[str]:
    """Return the pictures of a request's messages, in order."""
    contents = [message["content"] for message in messages if isinstance(message["content"], list)]  # type: ignore[attr-defined]
    return [part["image_url"]["url"] for content in contents for part in content if part["type"] == "image_url"]


def uri(picture: bytes) -> str:
    """Return a picture as a request carries it."""
    import base64  # noqa: PLC0415 - here alone

    return f"data:image/png;base64,{base64.b64encode(picture).decode()}"


def test_a_controller_gets_lists_of_its_window(bank: FrameBank, plain: FrameBank, tmp_path: Path) -> None:
    """Pictures by camera and states by name; a callable of one image cannot declare a history."""
    seen: list[tuple[Mapping[str, list[bytes]], Mapping[str, list[tuple[float, ...]]]]] = []

    def ask(prompt: str, images: Mapping[str, list[bytes]], state: Mapping[str, list[tuple[float, ...]]]) -> Reply:
        del prompt
        seen.append((images, state))
        return Reply("GO", "stop")

    def one_image(prompt: str, image: bytes) -> str:
        del prompt, image
        return "GO"

    ask.history = one_image.history = 2  # type: ignore[attr-defined]
    mode = RequestMode("python:movers:asked")
    opened = OpenedModel(mode, python_callable.hold(ask, mode))
    with pytest.raises(SpecError, match=r"let it take \(prompt, images, state\)"):
        python_callable.hold(one_image, mode)
    how = {"conditions": ("real",), "extent": battery.BatterySelection(2)}
    with pytest.raises(SpecError, match="--history 2"):
        battery.plan(plain.root, [opened], tmp_path / "other", **how)  # type: ignore[arg-type]
    planned = battery.plan(bank.root, [opened], tmp_path / "run", **how)  # type: ignore[arg-type]
    assert battery.run(planned).whole
    frames = planned.plan.frames
    assert sorted(given["block"] for _, given in seen) == sorted(
        [one.state["block"] for one in frame.window] for frame in frames
    )
    assert {tuple(given["top"]) for given, _ in seen} == {
        tuple(bank.images(one)["top"] for one in frame.window) for frame in frames
    }


def test_an_export_carries_the_pictures_of_earlier_instants(bank: FrameBank, tmp_path: Path) -> None:
    """Its answers come back to a run of the same requests."""
    (tmp_path / "ask.toml").write_text(PROMPT)
    asked = battery.questions_of(bank.root, BatterySettings(str(tmp_path / "ask.toml"), ("real", FROZEN)))
    battery.write_questions(asked, tmp_path / "asked")
    rows = [json.loads(line) for line in (tmp_path / "asked" / "asked.jsonl").read_text().splitlines()]
    assert len(rows) == 2 * len(bank)
    for (_, query), row in zip(asked.queries(), rows, strict=True):
        assert row["request_sha256"] == query.sha256()
        assert len(query.pictures) == 3


def test_a_run_of_policies_is_bundled_with_its_earlier_pictures(tmp_path: Path) -> None:
    """It resumes, and validates."""
    bank = movers.mover_bank(tmp_path / "log", episodes=4, length=4)
    planned = policy.plan(
        bank.root, [held(movers.by_pictures)], tmp_path / "run", extent=policy.PolicySelection(limit=8)
    )
    policy.run(planned)
    more = policy.plan(bank.root, [held(movers.by_pictures)], tmp_path / "run")
    assert 0 < more.counts()[1] < more.counts()[0]
    policy.run(more)
    write_bundle(tmp_path / "run", tmp_path / "run.zip", banks=[bank.root])
    assert validate(tmp_path / "run.zip").holds
