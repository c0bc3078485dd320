"""The page is one inert file: self-contained, the same every time, and honest about what it lacks."""

import base64
import hashlib
import io
import json
import re
import shutil
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import banks
import stand_ins
from eyechart.calls import Query, Reply
from eyechart.errors import LedgerError
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, write_run
from eyechart.models import ADAPTERS
from eyechart.report.page import SIGNS, PageSummary, VerdictSummary, asset, embedded_json, page_of
from eyechart.studies import battery as study
from eyechart.studies.battery import album
from eyechart.studies.battery.album import LEFT_OUT, encode_small, make_album
from eyechart.studies.battery.browser import LONGEST, collect_texts, frames_shown
from eyechart.studies.battery.page import make_page
from eyechart.studies.battery.subjects import subjects
from eyechart.studies.battery.summary import opening
from eyechart.studies.closed_loop.film import RED, TONES
from eyechart.verdicts import LABELS
from report_runs import HOSTILE, LONG, Reported, data_of, make_run, read_evidence, report


class Elements(HTMLParser):
    """Every element of a page with its attributes, and the text inside of it."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.inside: dict[str, list[str]] = {}
        self._open: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep an element."""
        self.found.append((tag, dict(attrs)))
        self._open.append(tag)

    def handle_data(self, data: str) -> None:
        """Keep text under the element that was opened last."""
        if self._open:
            self.inside.setdefault(self._open[-1], []).append(data)


def noisy(query: Query) -> Reply:
    """Answer as the noisy stand-in."""
    return stand_ins.noisy(query)


def test_the_page_asks_nothing_of_a_network(hostile: Reported) -> None:
    """No element loads anything but data, and the policy forbids what an element might."""
    elements = Elements(hostile.html)
    for tag, attributes in elements.found:
        for name, value in attributes.items():
            if name in {"src", "srcset", "data", "action", "poster"}:
                assert (value or "").startswith("data:"), (tag, name)
            if name in {"href", "xlink:href"}:
                assert (value or "").startswith("#"), (tag, name)
            assert not name.startswith("on"), (tag, name)
    assert not {"link", "iframe", "object", "embed", "base", "audio", "video"} & {tag for tag, _ in elements.found}
    assert "@import" not in hostile.html
    assert not re.search(r"url\((?!#)", hostile.html)


def test_the_policy_names_the_one_script(hostile: Reported) -> None:
    """default-src 'none', pictures from data, and the script by its hash."""
    html = hostile.html
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', html)
    assert policy is not None
    rules = dict(rule.strip().split(" ", 1) for rule in policy.group(1).replace("&#39;", "'").split(";"))
    scripts = re.findall(r"<script>(.*?)</script>", html, re.DOTALL)
    assert len(scripts) == 1
    digest = base64.b64encode(hashlib.sha256(scripts[0].encode()).digest()).decode()
    assert rules == {
        "default-src": "'none'",
        "img-src": "data:",
        "style-src": "'unsafe-inline'",
        "script-src": f"'sha256-{digest}'",
        "base-uri": "'none'",
        "form-action": "'none'",
    }


def test_hostile_replies_are_inert_and_word_for_word(hostile: Reported) -> None:
    """Nothing of them is markup in the page, and the browser of frames has every sign of them."""
    tags = [tag for tag, _ in Elements(hostile.html).found]
    assert tags.count("script") == 2
    assert "window.pwned" not in re.sub(
        r'<script type="application/json".*?</script>', "", hostile.html, flags=re.DOTALL
    )
    held = data_of(hostile.html)["texts"]
    assert {*HOSTILE, LONG, "", "STOP"} <= set(held)


def test_data_inside_a_script_cannot_end_it() -> None:
    """Signs that end an element or a line of a script are written as their escapes."""
    text = embedded_json({"a": "</script><!--&\u2028\u2029"})
    assert not set("<>&\u2028\u2029") & set(text)
    assert json.loads(text) == {"a": "</script><!--&\u2028\u2029"}


@pytest.mark.slow
def test_a_model_whose_name_is_markup_is_shown_as_text(bank: Path, tmp_path: Path) -> None:
    """In cards, tables and figures alike."""
    name = "<img src=x onerror=alert(1)>$x^2$&\"'{{1}}"
    made = report(make_run(bank, tmp_path / "run", {name: noisy}), tmp_path / "page.html").html
    assert "<img src=x" not in made
    assert "&lt;img src=x onerror=alert(1)&gt;$x^2$&amp;" in made


@pytest.mark.slow
def test_the_same_run_gives_the_same_bytes(hostile: Reported) -> None:
    """Figures, pictures and data included."""
    again = make_page(read_evidence([hostile.run], [hostile.bank]))
    assert again.html == hostile.made.html
    for section, many in hostile.made.drawings.items():
        assert [one.svg() for one in many] == [one.svg() for one in again.drawings[section]]
        assert [one.pdf() for one in many] == [one.pdf() for one in again.drawings[section]]


def test_every_picture_stands_in_the_page_once(hostile: Reported) -> None:
    """real, real_repeat and the partners of shuffled are one picture; all blanks are one."""
    held = data_of(hostile.html)
    assert len(set(held["pictures"])) == len(held["pictures"])
    places = held["runs"][0]["pictures"]
    assert places["real"] == places["real_repeat"]
    assert len(set(places["blank"])) == 1
    assert set(places["shuffled"]) <= set(places["real"])
    assert set(places["text_only"]) == {-1}
    assert all(uri.startswith("data:image/webp;base64,") for uri in held["pictures"])


def test_every_call_stands_in_the_page_with_its_decision(hostile: Reported) -> None:
    """As many calls as were planned, each with the reply that the ledger holds."""
    held = data_of(hostile.html)["runs"][0]
    (run,) = read_evidence([hostile.run])
    for model in held["models"]:
        replies = run.replies[model["name"]]
        given = [call for calls in model["calls"].values() for call in calls if call is not None]
        assert len(given) == len(replies)
    hostile_model = held["models"][0]
    texts = data_of(hostile.html)["texts"]
    for place, frame in enumerate(held["frames"]):
        reply = run.replies["standin:hostile"][frame["id"], "real"]
        assert texts[hostile_model["calls"]["real"][place][0]] == reply.text


def test_a_missing_bank_leaves_a_page_without_pictures(bank: Path, tmp_path: Path) -> None:
    """It says so, and everything else is there."""
    moved = tmp_path / "bank"
    shutil.copytree(bank, moved)
    run = make_run(moved, tmp_path / "run", {"noisy": noisy})
    with_pictures = report(run, tmp_path / "a.html")
    shutil.rmtree(moved)
    without = report(run, tmp_path / "b.html")
    assert "Without pictures" in without.html
    assert "the bank &#39;bank&#39; is not there" in without.html
    assert "data:image" in with_pictures.html
    assert "data:image" not in without.html
    assert data_of(without.html)["texts"] == data_of(with_pictures.html)["texts"]
    found_again = report(run, tmp_path / "c.html", bank)
    assert found_again.made.html == with_pictures.made.html


@pytest.mark.slow
@pytest.mark.parametrize("how", ["geometry", "pixels", "damage"])
def test_pictures_that_the_run_did_not_see_are_not_shown(bank: Path, tmp_path: Path, how: str) -> None:
    """Another fingerprint, other pictures of the same geometry, and a changed file are each said."""
    run = make_run(bank, tmp_path / "run", {"noisy": noisy}, extent=study.BatterySelection(4))
    if how == "geometry":
        other, words = banks.build_bank(tmp_path / "other", steps=2).root, "has fingerprint"
    else:
        other, words = tmp_path / "other", "other pictures of the same geometry" if how == "pixels" else "is damaged"
        shutil.copytree(bank, other)
        file = next((other / "images").iterdir())
        second = sorted((other / "images").iterdir())[1]
        file.write_bytes(second.read_bytes() if file != second else file.read_bytes() + b"x")
        if how == "pixels":
            manifest = json.loads((other / "manifest.json").read_text())
            manifest["images"][f"images/{file.name}"] = hashlib.sha256(file.read_bytes()).hexdigest()
            (other / "manifest.json").write_text(json.dumps(manifest))
    html = report(run, tmp_path / "page.html", other).html
    assert "data:image" not in html
    assert words in html


def test_a_partial_run_says_that_it_is_partial(bank: Path, tmp_path: Path) -> None:
    """Unfinished calls are counted, and the verdict's notes say so."""
    down = Reply(error="connection", error_detail="<b>refused</b>")

    def half(query: Query) -> Reply:
        return down if query.seed % 2 else Reply("STOP", "stop")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("eyechart.run.random.random", lambda: -1.0)
        run = make_run(bank, tmp_path / "run", {"half": half}, extent=study.BatterySelection(6))
    made = report(run, tmp_path / "page.html").html
    assert '<span class="flag">partial</span>' in made
    assert "planned calls are finished" in made
    held = data_of(made)
    calls = [call for column in held["runs"][0]["models"][0]["calls"].values() for call in column if call]
    assert "error connection: <b>refused</b>" in [held["notes"][call[3]] for call in calls if call[3:]]


def test_an_empty_run_gives_a_page_without_a_claim(bank: Path, tmp_path: Path) -> None:
    """Planned, and not one call made: no number is made up."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(ADAPTERS, "standin", "stand_ins")
        planned = study.plan(bank, ["standin:noisy"], tmp_path / "run")
    (tmp_path / "run").mkdir()
    write_run(tmp_path / "run", planned.manifest, planned.plan.bank)
    with Ledger(tmp_path / "run" / LEDGER, create=True):
        pass
    made = report(tmp_path / "run", tmp_path / "page.html").html
    assert "not scorable" in made
    assert "Cannot say" in made
    assert data_of(made)["texts"] == []


def test_a_bank_without_gap_axis_and_counterfactuals_says_cannot_say(tmp_path: Path) -> None:
    """Sections that need what the bank lacks say so in words and show no figure."""
    root = banks.build_bank(tmp_path / "bank", axis="none", drawn=False).root
    made = report(make_run(root, tmp_path / "run", {"noisy": noisy}), tmp_path / "page.html")
    assert "the run has no answers to counterfactual pictures" in made.html
    assert made.made.drawings["mirror"] == []
    assert made.made.drawings["counterfactual"] == []
    assert len(made.made.drawings["gap"]) == 1


def test_counterfactual_pairs_stand_side_by_side_with_their_decisions(bank: Path, tmp_path: Path) -> None:
    """The moment's pictures, and below each the decision that it got."""
    made = report(make_run(bank, tmp_path / "run", {"steady": stand_ins.stop}), tmp_path / "page.html").html
    pair = made.partition('<div class="pair">')[2].partition('<div class="pair">')[0]
    assert re.findall(r"<figcaption><code>(.*?)</code>", pair) == [
        "lead_near",
        "lead_far",
        "real",
        "recoloured",
    ]
    assert pair.count('<img src="data:image/webp') == 4
    assert re.findall(r'<span class="chip brake">.*?</span>(\w+)</span>', pair) == ["STOP"] * 4
    assert re.search(r"0 of \d+ pairs are braked harder near", made)


@pytest.mark.parametrize("label", LABELS)
def test_a_label_has_the_same_sign_at_the_head_of_a_page_as_below(label: str) -> None:
    """Labels of one colour are told apart by their signs, so that the head may not show that of the colour."""
    said = VerdictSummary("m", label.replace("_", " "), LABELS[label].family)
    head = page_of("?", "r", [], answer=PageSummary("So.", [said])).html.decode()
    assert f'<span class="glyph" aria-hidden="true">{LABELS[label].glyph}</span><span><strong>' in head


@pytest.mark.slow
def test_the_tables_of_one_model_are_folded_too(bank: Path, tmp_path: Path) -> None:
    """What stands open is the answer, its example and its figures; numbers of every kind open one by one."""
    html = report(make_run(bank, tmp_path / "run", {"steady": stand_ins.stop}), tmp_path / "page.html", bank).html
    assert "<details open" not in html
    outside = re.sub(r"<details>.*?</details>", "", html, flags=re.DOTALL)
    for caption in ("Calls by condition, run</caption>", "unparsed_reference"):
        assert caption in html
        assert caption not in outside


def test_several_runs_stand_on_one_page(bank: Path, tmp_path: Path) -> None:
    """Each model is named with its run, and runs of one name are numbered."""
    one = make_run(bank, tmp_path / "a" / "run", {"noisy": noisy})
    other = make_run(bank, tmp_path / "b" / "run", {"noisy": noisy}, seed=3)
    evidence = read_evidence([one, other])
    assert [who.label for who in subjects(evidence)] == ["run (1) · standin:noisy", "run (2) · standin:noisy"]
    held = data_of(make_page(evidence).html.decode())
    assert [run["name"] for run in held["runs"]] == ["run (1)", "run (2)"]
    assert held["runs"][0]["pictures"]["real"] == held["runs"][1]["pictures"]["real"]


def test_a_folder_that_is_no_run_is_refused(tmp_path: Path) -> None:
    """By name."""
    with pytest.raises(LedgerError, match=r"run\.json does not exist"):
        read_evidence([tmp_path])


def test_pictures_are_made_smaller_until_they_fit(bank: Path, tmp_path: Path) -> None:
    """And what does not fit at all is left out, with a sentence."""
    evidence = read_evidence([make_run(bank, tmp_path / "run", {"noisy": noisy}, extent=study.BatterySelection(6))])
    shown = frames_shown(evidence)
    whole = make_album(evidence, shown)
    assert LEFT_OUT not in whole.places[0]["real"]
    some = make_album(evidence, shown, budget=900)
    assert LEFT_OUT in some.places[0]["noise"] + some.places[0]["mirrored"]
    assert any("left out" in note for note in some.notes)
    assert sum(len(base64.b64decode(uri.partition(",")[2])) for uri in some.uris) <= 900


def test_replies_share_the_room_that_there_is(bank: Path, tmp_path: Path) -> None:
    """Short replies are whole, and the longest are cut alike."""

    def wordy(query: Query) -> Reply:
        return Reply("x" * (10 if query.seed % 3 else 1000 + query.seed % 500), "stop")

    evidence = read_evidence([make_run(bank, tmp_path / "run", {"wordy": wordy}, extent=study.BatterySelection(6))])
    texts = collect_texts(evidence, frames_shown(evidence), budget=4000)
    assert 10 < texts.limit < 1000
    assert sum(min(len(text), texts.limit) for text in texts.numbers) <= 4000
    assert texts.cut == sum(len(text) > texts.limit for text in texts.numbers) > 0
    assert collect_texts(evidence, frames_shown(evidence)).limit == LONGEST


def test_the_verdict_card_holds_what_bounds_the_verdict(bank: Path, tmp_path: Path) -> None:
    """Label, lateral, evidence, the paper's label, the statistic with n and p, trust and scope."""
    run = make_run(bank, tmp_path / "run", {"steady": stand_ins.stop})
    (evidence,) = read_evidence([run])
    verdict = evidence.verdicts["standin:steady"]
    card = report(run, tmp_path / "page.html").html.partition("<article")[2].partition("</article>")[0]
    found = evidence.score.models["standin:steady"].statistics[verdict.calibrated.decided_by]
    for words in (
        verdict.calibrated.label.replace("_", " "),
        verdict.lateral.label.replace("_", " "),
        verdict.evidence,
        verdict.calibrated.decided_by,
        f"<dd>{found.n}</dd>",
        verdict.trust,
        verdict.scope,
        *verdict.notes,
    ):
        assert words in unescape(card)


def test_a_plain_picture_is_kept_exactly_and_a_busy_one_in_fewer_bytes() -> None:
    """Drawings lose nothing; what would take many bytes is what is compressed with a loss."""
    plain = banks.draw(8.0, 3)
    code = encode_small(plain, 600, 82, lossless=True)
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(code)).convert("RGB")), plain)
    busy = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    assert len(encode_small(busy, 600, 82, lossless=True)) == len(encode_small(busy, 600, 82, lossless=False))


@pytest.mark.parametrize(("colours", "kinds"), [(200, [True, False]), (400, [False])])
def test_the_lossless_code_is_tried_on_few_colours_alone(
    colours: int, kinds: list[bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A picture of more colours than a table holds is longer in it, and it took most of a page's time."""
    tried: list[bool] = []
    made = album.webp
    monkeypatch.setattr(
        album, "webp", lambda image, **how: tried.append(bool(how.get("lossless"))) or made(image, **how)
    )
    numbers = np.random.default_rng(0).integers(0, colours, (80, 80))
    encode_small(np.stack([numbers % 20, numbers // 20, numbers * 0], axis=2).astype(np.uint8), 600, 82, lossless=True)
    assert tried == kinds


def test_pictures_stand_in_the_album_as_wide_as_its_rung(
    bank: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the widest do not fit, the next are taken, and none that was tried in another width."""
    evidence = read_evidence([make_run(bank, tmp_path / "run", {"noisy": noisy}, extent=study.BatterySelection(6))])
    shown = frames_shown(evidence)
    monkeypatch.setattr(album, "RUNGS", ((60, 100), (30, 45)))
    for budget, width in ((9_000_000, 60), (4_000, 30)):
        made = make_album(evidence, shown, budget=budget)
        uris = [made.uris[place] for place in made.places[0]["real"] if place >= 0]
        codes = [base64.b64decode(uri.partition(",")[2]) for uri in uris]
        assert {Image.open(io.BytesIO(code)).width for code in codes} == {width}


def test_an_action_has_a_sign_and_no_colour_of_right_or_wrong() -> None:
    """A right STOP is not red: red and green are for wrong and right alone, in chips, strips, films and figures."""
    rules = re.findall(r"([^{}]*\.(?:brake|proceed|other)\b[^{}]*)\{([^}]*)\}", asset("page.css") + asset("drives.css"))
    told = [(which, name) for which, rule in rules for name in ("red", "green", "vermillion", "blue") if name in rule]
    assert rules
    assert told == []
    assert SIGNS == {"brake": "■", "proceed": "▲", "other": "●"}
    assert {RED, "#4fd0a9"}.isdisjoint(colour for colour, _ in TONES.values())


def test_the_example_of_several_runs_is_answered_by_models_of_all(bank: Path, tmp_path: Path) -> None:
    """The first of each run in turns; a run of other conditions is named as one that is not in it."""
    runs = [
        make_run(bank, tmp_path / "one", {"steady": stand_ins.stop, "again": stand_ins.stop}),
        make_run(bank, tmp_path / "two", {"other": stand_ins.stop}),
    ]
    evidence = read_evidence(runs)
    everyone = subjects(evidence)
    said = opening(evidence, everyone, make_album(evidence, frames_shown(evidence)))
    assert [name.rpartition(":")[2] for name in said.models] == ["steady", "other", "again"]
    assert all(len(shot.answers) == len(said.models) for shot in said.shots)
