"""Pages of tables, tabs and figures: what is written, and what a browser makes of it."""

import json
import re

import pytest
from matplotlib.figure import Figure

from ccpin.pages.html_page import Section, render
from ccpin.pages.parts import bullets, embedded, figure, formula, paragraphs, table, tabs
from ccpin.pages.provenance import versions
from tests.support.browser import click, opened


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("q_1 + q_3", "q<sub>1</sub> + q<sub>3</sub>"),
        ("a_3a_4", "a<sub>3</sub>a<sub>4</sub>"),
        ("l_ci, k_pi", "l<sub>ci</sub>, k<sub>pi</sub>"),
        ("ψ_q′ and ψ̇_q′", "ψ<sub>q′</sub> and ψ̇<sub>q′</sub>"),
        ("x^2, e^{−11.2}, q_{d1}", "x<sup>2</sup>, e<sup>−11.2</sup>, q<sub>d1</sub>"),
        ("leg1_extension of slider_crank", "leg1_extension of slider_crank"),
        ("`x_1` < y", "<code>x_1</code> &lt; y"),
        ("<script>alert(1)</script>", "&lt;script&gt;alert(1)&lt;/script&gt;"),
    ],
)
def test_formula(text, written):
    """Indices of one letter are lowered, names are left alone, and what is special to HTML is escaped."""
    assert formula(text) == written


def page():
    drawn = Figure(figsize=(3, 2))
    drawn.add_subplot().plot([0, 1], [0, 1])
    inner = "<!DOCTYPE html><p id='inner'>&amp; \"quoted\"</p><script>document.title = 'ran'</script>"
    body = (
        paragraphs("one", "two_1")
        + bullets(["a", "b"])
        + table(("name", "value"), [("x_1", "1.5e-3 m"), ("y", "words")], ["there", "there"])
        + tabs("group", [("left", "<p>L</p>"), ("right", "<p>R</p>")], chosen=0)
        + tabs("other", [("left", "<p>L</p>"), ("right", "<p>R</p>")], chosen=0)
        + '<button data-all="right">all</button>'
        + figure(drawn, "A line.")
        + embedded(inner, "within")
    )
    return render("A <title>", "below", [Section("there", "Here & there", body, (("there", "again"),))])


def test_a_page_is_self_contained_and_escaped():
    """No address outside of the file, a policy that forbids any, and a title that is text."""
    written = page()
    assert "<title>A &lt;title&gt;</title>" in written
    assert "default-src 'none'" in written
    assert re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', written) == []
    assert written.count("data:image/svg+xml") == 1
    assert page() == written  # nothing depends on when it is written


def test_a_page_in_a_browser(tmp_path):
    """The figure loads, a tab's panel shows when its title is clicked, one button sets all, the inner page runs."""
    path = tmp_path / "page.html"
    path.write_text(page(), encoding="utf-8")
    shown = "[...document.querySelectorAll('.panel')].map(p => p.offsetParent !== null)"
    with opened(path.as_uri()) as browser:
        assert browser.evaluate("document.querySelector('img').naturalWidth") > 0
        assert browser.evaluate(shown) == [True, False, True, False]
        click(browser, 'label[for="group-1"]')
        assert browser.evaluate(shown) == [False, True, True, False]
        browser.evaluate("document.querySelector('button[data-all]').click()")
        assert browser.evaluate(shown) == [False, True, False, True]
        inner = "document.querySelector('iframe').contentDocument"
        browser.evaluate("document.querySelector('iframe').scrollIntoView()")
        look = f"const look = () => {inner}?.title === 'ran' ? done(1) : setTimeout(look, 20)"
        assert browser.evaluate(f"new Promise(done => {{ {look}; look(); }})") == 1
        assert browser.evaluate(f"{inner}.querySelector('#inner').textContent") == '& "quoted"'


def test_versions_are_plain_words():
    """Names and values, JSON-ready, ccpin's own among them, no path of this machine."""
    found = dict(versions())
    assert json.dumps(found)
    assert found["ccpin"] != "not installed"
    assert not any("/" in value for value in found.values())
