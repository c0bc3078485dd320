"""Every relative link of every Markdown file leads to a file, and to a heading of it, on a plain checkout."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NOT_OURS = {"build", "dist", "demo", "node_modules"}
"""Folders of a checkout that hold no page of the project; nor do hidden ones, nor docs/api, which is generated."""

_CODE = re.compile(r"^```.*?^```|^    .*?$|`[^`\n]*`", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\]\(([^)\s]+)\)")


def pages() -> list[Path]:
    """Return the Markdown files of the checkout."""
    result = []
    for path in sorted(ROOT.rglob("*.md")):
        folders = path.relative_to(ROOT).parts[:-1]
        if not any(name.startswith(".") or name in NOT_OURS for name in folders) and folders[:2] != ("docs", "api"):
            result.append(path)
    return result


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub and MyST make them."""
    prose = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    titles = re.findall(r"^#+ (.+)$", prose, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in titles}


def links(page: Path) -> list[str]:
    """Return the relative links of a page's prose, pictures too."""
    prose = _CODE.sub("", page.read_text(encoding="utf-8"))
    return [link for link in _LINK.findall(prose) if "://" not in link and not link.startswith("mailto:")]


def problem(page: Path, link: str) -> str | None:
    """Return what is wrong with a link, or None; links into docs/api lead to what make docs generates."""
    file, _, anchor = link.partition("#")
    target = (page.parent / file).resolve() if file else page
    if (ROOT / "docs" / "api") in target.parents:
        return None
    if not target.exists():
        return f"{page.relative_to(ROOT)}: {link} does not exist"
    if anchor and anchor not in anchors(target):
        return f"{page.relative_to(ROOT)}: {link} names no heading"
    return None


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_its_links_lead_somewhere(page: Path) -> None:
    """File and heading exist."""
    assert [found for link in links(page) if (found := problem(page, link))] == []


def test_links_are_found_and_broken_ones_told(tmp_path: Path) -> None:
    """Or the test above could not fail."""
    assert {ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "docs" / "index.md"} <= set(pages())
    assert sum(len(links(page)) for page in pages()) > 50
    page = ROOT / "README.md"
    assert problem(page, "docs/nowhere.md") == "README.md: docs/nowhere.md does not exist"
    assert problem(page, "docs/verdicts.md#nothing") == "README.md: docs/verdicts.md#nothing names no heading"
    assert problem(page, "docs/verdicts.md#the-papers-rules") is None
    (tmp_path / "page.md").write_text("[a](b.md) `[c](d.md)`\n```\n[e](f.md)\n```\n[g](https://h)\n")
    assert links(tmp_path / "page.md") == ["b.md"]
