"""The built site, as files: every page is near, links lead somewhere, search works, no page is wider than a phone."""

import re
import shutil
import subprocess
import sys
import time
from html.parser import HTMLParser
from urllib.parse import unquote, urlsplit

import pytest

from tests.support.browser import FAINT, click, opened, settle
from tests.support.places import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("site")]  # built once


class Parsed(HTMLParser):
    """What a page refers to, and the names of its places."""

    def __init__(self, text):
        super().__init__()
        self.links, self.sources, self.ids = [], [], set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        if tag == "a" and given.get("href"):
            self.links.append(given["href"])
        elif tag == "link" and given.get("rel") in ("icon", "stylesheet"):
            self.sources.append(given["href"])
        elif given.get("src"):
            self.sources.append(given["src"])
        self.ids.update(given[key] for key in ("id", "name") if given.get(key))


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, built strictly from a copy."""
    pytest.importorskip("zensical")
    pytest.importorskip("mkdocstrings")
    folder = tmp_path_factory.mktemp("site")
    shutil.copy(ROOT / "zensical.toml", folder)
    for part in ("docs", "src"):
        shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    command = [sys.executable, "-m", "zensical", "build", "--strict"]
    built = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    assert built.returncode == 0, built.stdout + built.stderr
    return folder / "build" / "site"


@pytest.fixture(scope="module")
def pages(site):
    """Every page by its path."""
    return {path: Parsed(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}


def target(page, link):
    """The file and the anchor that a local link leads to."""
    parts = urlsplit(link)
    return (page.parent / unquote(parts.path)).resolve() if parts.path else page, unquote(parts.fragment)


def local(link):
    return not urlsplit(link).scheme and not link.startswith("//")


def test_every_page_is_two_clicks_away(site, pages):
    """Every source has its page, and from the home page one link, or a link of that, leads to it."""
    written = {path.relative_to(ROOT / "docs").with_suffix(".html") for path in (ROOT / "docs").rglob("*.md")}
    near = {site / "index.html"}
    for _ in range(2):
        near |= {target(page, link)[0] for page in near for link in pages[page].links if local(link)} & {*pages}
    assert {page.relative_to(site) for page in near} >= written


def test_every_link_leads_somewhere(pages):
    """Local links and images are files, anchors are there; others are whole addresses."""
    for page, parsed in pages.items():
        for link in filter(local, parsed.links + parsed.sources):
            file, anchor = target(page, link)
            if page.name == "404.html" and link.startswith("/"):
                continue  # it is shown at any depth: its links begin at the server's root
            file = file / "index.html" if file.is_dir() else file
            assert file.is_file(), f"{page.name}: {link}"
            assert not anchor or file not in pages or anchor in pages[file].ids, f"{page.name}: {link}"
        for link in parsed.links:
            if not local(link):
                parts = urlsplit(link)
                assert parts.scheme in ("https", "http"), f"{page.name}: {link}"
                assert re.fullmatch(r"[\w-]+(\.[\w-]+)+(:\d+)?", parts.netloc), f"{page.name}: {link}"


def test_nothing_is_fetched_from_elsewhere(pages):
    """Scripts, styles and pictures are the site's own, and no snippet is left as it was written."""
    for page, parsed in pages.items():
        assert all(local(source) or source.startswith("data:") for source in parsed.sources), page.name
        assert "--8<--" not in page.read_text(encoding="utf-8").replace("&lt;", "<").replace("documents", ""), page.name


def test_search_finds_without_a_server(site):
    """Opened as a file, words typed into the search lead to the page about them."""
    with opened((site / "index.html").as_uri(), 1280, 800) as page:
        click(page, ".md-search__button")
        settle(page, 300)
        page.command("Input.insertText", {"text": "gravity compensation"})
        found = "[...document.activeElement.shadowRoot.querySelectorAll('a')].map(link => link.href)"
        deadline = time.monotonic() + 30
        while not (links := page.evaluate(found)):
            assert time.monotonic() < deadline
            time.sleep(0.1)
        assert any("PDSimpleGravity" in link for link in links)


@pytest.mark.parametrize("name", ["index", "tutorial", "howto/gains", "api/control", "glossary", "theorems/theorem_n"])
def test_a_page_fits_a_phone(site, name):
    """Tables and code scroll in themselves; the page does not."""
    with opened((site / f"{name}.html").as_uri(), 360, 740) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= 360


@pytest.mark.parametrize("dress", ["default", "slate"])
def test_words_stand_out_on_the_site(site, dress):
    """By light and by dark, 4.5 to 1; the mark behind headings shows only under the pointer."""
    with opened((site / "tutorial.html").as_uri(), 1280, 800) as page:
        page.evaluate(f"document.body.setAttribute('data-md-color-scheme', '{dress}')")
        settle(page, 600)
        assert page.evaluate(f"{FAINT}(4.5).filter(([what]) => !what.includes('headerlink'))") == []
        assert page.evaluate(f"{FAINT}(22).length") > 50
