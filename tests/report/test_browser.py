"""The report's script, in a browser."""

from drpbench.problems import load_set
from drpbench.report.figures import COLLIDED
from drpbench.report.page import render
from drpbench.report.recordings import Kept

from .shown import DOT, EXPECTED, HOSTILE, some_results


def opened(browser, path, results, expected, **shown):
    path.write_text(render(results, expected, "results", **shown), encoding="utf-8")
    browser.errors.clear()
    browser.requests.clear()
    browser.open(path)
    asked = [address for address in browser.requests if not address.startswith("data:")]
    assert asked == [path.resolve().as_uri()]


LINES = (
    "[...document.querySelectorAll('#failed tr')].map(r => [...r.cells].map(c => c.textContent))"
)
RANKED = (
    "[...document.querySelectorAll('.measure[open] tbody tr')].filter(r => !r.hidden)"
    ".map(r => r.cells[1].textContent)"
)


def test_a_browser_draws_sorts_and_filters_without_complaint(browser, tmp_path):
    opened(browser, tmp_path / "report.html", some_results(), EXPECTED)
    js = browser.js
    assert js("document.querySelectorAll('#bars .card svg').length") == 2
    named = js("[...document.querySelectorAll('#bars svg .named title')].map(t => t.textContent)")
    assert set(named) == {HOSTILE, "good"}  # no bar is told by its colour alone
    assert js("document.querySelectorAll('#times .line, #errors .line').length") == 4
    assert js("document.querySelectorAll('#clearances svg').length") == 2

    assert js(RANKED) == ["good", HOSTILE + "†"]
    by_se, by_policy, by_rank = (
        f"document.querySelectorAll('.measure[open] thead button')[{place}].click()"
        for place in (2, 1, 0)
    )
    js(by_se)
    js(by_se)
    assert js(RANKED) == [HOSTILE + "†", "good"]
    assert js("document.querySelector('.measure[open] [aria-sort]').ariaSort") == "ascending"
    js(by_rank)
    assert js(RANKED) == ["good", HOSTILE + "†"]
    js(by_policy)
    assert js(RANKED) == [HOSTILE + "†", "good"]

    listed = js(LINES)
    assert len(listed) == 7 and listed[0][:5] == [
        "good",
        "FDO",
        "2",
        "box",
        "collided: hand at step 30",
    ]
    assert listed[0][7] == "drpbench replay results/good.json --id 2 --task FDO"
    assert listed[-1][:5] == [HOSTILE, "FDO", "1", "box", f"failed to run: {HOSTILE}"]
    js("document.querySelectorAll('.list thead button')[2].click()")  # by id
    assert [line[2] for line in js(LINES)] == ["0", "0", "1", "1", "2", "2", "3"]
    choose = "const c = {}; c.value = {}; c.dispatchEvent(new Event('change'))"
    js("{" + choose.format("document.querySelector('[data-filter=reason]')", COLLIDED) + "}")
    assert [line[:3] for line in js(LINES)] == [[HOSTILE, "FDO", "0"], ["good", "FDO", "2"]]
    js("{" + choose.format("document.getElementById('task')", 0) + "}")
    assert js(LINES) == [] and js("document.querySelectorAll('#bars .card').length") == 1
    assert js(
        "[...document.querySelectorAll('.measure[open] th[data-task]')].map(c => c.hidden)"
    ) == [
        False,
        True,
        True,
    ]

    js("document.getElementById('privileged').click()")
    assert js(RANKED) == ["good"] and js("document.querySelectorAll('#times .line').length") == 1
    js("document.querySelector('#policies input').click()")
    assert js(RANKED) == [] and "No policy" in js("document.getElementById('times').textContent")
    assert js("document.scripts.length") == 2
    assert browser.errors == []


def test_pictures_of_failures_open_the_recordings_beside_the_results(browser, tmp_path):
    episodes = {("FDO", 2): (0, 2), ("FDO", 1): (2,)}
    beside = {"good.json": Kept("runs/my%20good", episodes, ["FDO-grid-4.mp4"])}
    drawn = {("good.json", "FDO", 2): DOT, ("it's.json", "SE", 3): DOT}
    page = tmp_path / "report.html"
    opened(browser, page, some_results(), EXPECTED, recordings=beside, pictures=drawn)
    js = browser.js
    figures = (
        "[...document.querySelectorAll('#pictures figure')].map(f => [f.querySelector('img').alt,"
        " [...f.querySelectorAll('a')].map(a => a.getAttribute('href')), "
        "f.querySelector('code')?.textContent])"
    )
    video, recording = "runs/my%20good/FDO-00002.mp4", "runs/my%20good/FDO-00002.mcap"
    assert js(figures) == [
        ["good, FDO 2, collided: hand at step 30", [video, video, recording], None],
        [
            f"{HOSTILE}, SE 3, not reached",
            [],
            "drpbench replay 'results/it'\"'\"'s.json' --id 3 --task SE",
        ],
    ]
    assert js("[...document.images].every(i => i.complete && i.naturalWidth === 1)")
    assert js(
        "[...document.querySelectorAll('#failed a')].map(a => [a.getAttribute('href'), "
        "a.textContent])"
    ) == [[video, "video"], [recording, "recording"]]
    grids = "[...document.querySelectorAll('#failures > p a')].map(a => [a.href, a.textContent])"
    there = (tmp_path / "runs" / "my good" / "FDO-grid-4.mp4").as_uri()
    assert js(grids) == [[there, "runs/my good/FDO-grid-4.mp4"]]
    choose = (
        "{const c = document.getElementById('task'); c.value = 0; c.dispatchEvent(new "
        "Event('change'))}"
    )
    js(choose)
    assert [figure[2] is None for figure in js(figures)] == [False]
    assert browser.errors == []


def test_a_page_without_pictures_shows_no_gallery(browser, tmp_path):
    opened(browser, tmp_path / "report.html", some_results(), EXPECTED)
    assert browser.js("document.getElementById('pictures').clientHeight") == 0
    assert browser.js("document.querySelectorAll('#failures a, #failures img').length") == 0
    assert browser.errors == []


def test_a_phone_in_the_dark_sees_every_section_and_scrolls_only_tables(browser, tmp_path, shipped):
    browser.screen(390, 844, dark=True)
    opened(browser, tmp_path / "report.html", shipped, load_set().counts)
    assert browser.js("document.documentElement.scrollWidth") <= 390
    assert browser.js("getComputedStyle(document.body).backgroundColor") == "rgb(20, 23, 27)"
    assert browser.js("[...document.querySelectorAll('section')].every(s => s.clientHeight > 60)")
    listed = browser.js(LINES)
    assert len(listed) == 50
    browser.js("document.getElementById('later').click()")
    assert browser.js(LINES)[0] not in listed
    assert browser.errors == []


def test_the_browser_would_have_been_heard_complaining(browser, tmp_path):
    page = tmp_path / "wrong.html"
    page.write_text("<script>throw Error('noticed')</script>")
    browser.errors.clear()
    browser.open(page)
    assert "noticed" in "".join(browser.errors)
