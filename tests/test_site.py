"""The site: it is built without a warning, has every name and command, and its search answers."""

import json
import os
import re
import shlex
import subprocess
import sys
import time
import tomllib
from html import unescape
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import quote, unquote

import pytest
from filelock import FileLock
from support.browsers import chromium
from support.commands import commands_of
from support.lecture import answer, markdown
from support.pages import NAMES, ROOT, read

import fecloth as fc
from fecloth.cli.main import _parser
from fecloth.quantities.formula_functions import FUNCTIONS

NEEDS = ("sphinx", "pydata_sphinx_theme", "numpydoc", "myst_nb", "jupytext", "ipykernel")
MISSING = [name for name in NEEDS if find_spec(name) is None]
pytestmark = [
    pytest.mark.stories,
    pytest.mark.skipif(bool(MISSING), reason=f"needs {', '.join(MISSING)} of the extra [docs]"),
]

(COMMAND,) = re.findall(r"^ {4}\S*sphinx-build (.*)$", read("CONTRIBUTING.md"), re.MULTILINE)
REPOSITORY = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["urls"]["Repository"]


@pytest.fixture(scope="session")
def site(tmp_path_factory) -> Path:
    """The folder of the site, built once by the command of CONTRIBUTING.

    The pages of the lecture are not run here; tests/studies/test_lecture.py does it.
    """
    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:  # the folder of all workers
        shared = shared.parent
    folder, log = shared / "site", shared / "site.log"
    with FileLock(shared / "site.lock"):
        if not log.exists():
            options = [*shlex.split(COMMAND)[:-1], "-D", "nb_execution_mode=off"]
            command = [sys.executable, "-m", "sphinx", *options, str(folder)]
            start = time.perf_counter()
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
            seconds = f"built in {time.perf_counter() - start:.0f} s\n"
            log.write_text(f"{done.returncode}\n{seconds}{done.stderr}", encoding="utf-8")
    print(log.read_text(encoding="utf-8"))
    return folder


@pytest.fixture(scope="session")
def pages(site):
    """The text of each page by its path in the site."""
    texts = {path: path.read_text(encoding="utf-8") for path in site.rglob("*.html")}
    assert len(texts) > 20
    return {path.relative_to(site).as_posix(): text for path, text in texts.items()}


def test_it_is_built_without_a_warning(site):
    assert "-W" in COMMAND
    status, _, *errors = (site.parent / "site.log").read_text(encoding="utf-8").splitlines()
    assert (status, errors) == ("0", [])


def test_a_page_loads_nothing_from_elsewhere(site, pages):
    loads = r"<(?:script|link|img|iframe|source)\b[^>]*?(?:src|href)=\"(?:https?:)?//[^\"]*\""
    for name, text in pages.items():
        assert re.findall(loads, text) == [], name
    for style in site.rglob("*.css"):
        text = style.read_text(encoding="utf-8")
        assert re.findall(r"(?:url\(|@import\s)[\"']?(?:https?:)?//.*", text) == [], style


def test_every_page_written_by_hand_is_a_chapter():
    stubs = (ROOT / "docs").rglob("*.md")
    included = re.findall(r"\{include\} (?:\.\./)+(\S+)", "".join(f.read_text() for f in stubs))
    assert {name for name in NAMES if not name.startswith("docs/")} <= set(included)


def test_each_slide_of_the_lecture_is_a_chapter_and_a_notebook(site, pages):
    slides = sorted((ROOT / "studies" / "lecture").glob("[0-9]*.py"))
    assert slides
    for slide in slides:
        text = pages[f"lecture/{slide.stem}.html"]
        (link,) = re.findall(r"<a href=\"(\w+\.ipynb)\" download>", text)
        cells = json.loads((site / "lecture" / link).read_text(encoding="utf-8"))["cells"]
        assert [cell["cell_type"] for cell in cells].count("code") >= 3
        words = markdown(slide) + answer(slide)
        formulas = re.findall(r"(\$\$?)[^$]+\1", words)
        assert text.count("<math") == len(formulas) > 0, slide
        assert not re.search(r"frac\d", words), slide  # shown as a fraction of the number 12


def test_links_lead_somewhere(site, pages):
    ids = {name: set(re.findall(r"\bid=\"([^\"]+)\"", text)) for name, text in pages.items()}
    for name, text in pages.items():
        for link in set(map(unescape, re.findall(r"<a\b[^>]*?href=\"([^\"]*)\"", text))):
            target, _, anchor = unquote(link).partition("#")
            if link.startswith(REPOSITORY):
                assert (ROOT / target.removeprefix(f"{REPOSITORY}/")).exists(), f"{name}: {link}"
            elif not re.match(r"\w+:", link):
                file = (site / name).parent.joinpath(target).resolve() if target else site / name
                assert file.is_file(), f"{name}: {link}"
                page = file.relative_to(site.resolve()).as_posix() if target else name
                is_source = name.startswith("_modules/")  # its links name no modules
                assert not anchor or is_source or anchor in ids[page], f"{name}: {link}"


def test_the_reference_has_every_public_name(pages):
    text = "".join(text for name, text in pages.items() if name.startswith("api/names/"))
    known = set(re.findall(r"id=\"(fecloth\.[\w.]+)\"", text))
    classes = {name for name in fc.__all__ if isinstance(getattr(fc, name), type)}
    assert {f"api/names/{name}.html" for name in classes} <= pages.keys()
    modules = {"stability", "study", "verify", "shapes"}  # their names stand there
    assert {f"fecloth.{name}" for name in fc.__all__ if name not in modules} <= known
    assert {f"fecloth.study.{name}" for name in ("converge", "Study", "COLOURS")} <= known
    assert {
        "fecloth.verify.check_term",
        "fecloth.shapes.Sphere",
        "fecloth.homogenisation",
    } - known == {
        "fecloth.homogenisation"  # its three functions are names of fecloth
    }


def test_formulas_and_the_fields_of_results_are_shown(pages):
    terms, runs = pages["api/names/BaraffWitkin.html"], pages["api/names/Result.html"]
    assert "½ k_u (|w_u| − b_u)²" in re.sub(r"<[^>]*>", "", terms)
    assert "Wall seconds by phase" in runs
    assert "Annotated" not in terms + runs


def test_the_list_of_commands_has_every_option(pages):
    text = unescape(re.sub(r"<[^>]*>", " ", pages["commands.html"]))
    for name, parser in commands_of(_parser()).items():
        assert f"fecloth {name}" in text
        for action in parser._actions:
            names = action.option_strings or [action.dest]
            assert set(names) <= set(re.findall(r"[\w-]+", text)), (name, names)


def test_the_functions_of_formulas_are_listed(pages):
    text = unescape(re.sub(r"<[^>]*>", "", pages["scenes.html"]))
    for name, function in FUNCTIONS.items():
        assert f"{name}({', '.join(function.arguments)})" in text


def test_the_gallery_has_a_picture_and_the_commands_of_each_scene(pages):
    scenes = {path.stem for path in (ROOT / "studies" / "scenes").glob("*.toml")}
    text = unescape(re.sub(r"<[^>]*>", "", pages["gallery.html"]))
    assert set(re.findall(r"fecloth demo (\w+)\n", text)) == scenes
    assert set(re.findall(r"fecloth render out/(\w+) -o \1\.png --field", text)) == scenes
    pictures = re.findall(r"<img [^>]*src=\"_images/(\w+)\.png\"", pages["gallery.html"])
    assert sorted(pictures) == sorted(2 * list(scenes))  # a thumbnail and a picture of each


def test_the_package_index_and_a_wheel_can_follow_every_link(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs" / "extensions")
    links = import_module("absolute_links")
    package = [file.relative_to(ROOT).as_posix() for file in ROOT.glob("fecloth/**/*.md")]
    followed = 0
    for page in ("README.md", *package):
        text = links.absolute(read(page), "https://host/repo", page)
        for image, _, name, _ in links.LINK.findall(text):
            target = ((ROOT / page).parent / name).resolve()
            assert not image, (page, name)
            assert page != "README.md" or not target.exists(), name
            assert not target.exists() or target.is_relative_to(ROOT / "fecloth"), (page, name)
        for link in re.findall(r"\]\(https://host/repo/([^)?#]*)", text):
            followed += 1
            assert (ROOT / link).exists(), (page, link)
    assert followed > 40


@pytest.fixture
def public_names(monkeypatch):
    """The extension that lists them."""
    monkeypatch.syspath_prepend(ROOT / "docs" / "extensions")
    return import_module("public_names")


def test_a_public_name_on_no_page_ends_the_build(public_names, monkeypatch, tmp_path):
    for page in public_names.PAGES.glob("*.rst"):
        text = page.read_text(encoding="utf-8").replace("reference:: terms", "reference:: none")
        (tmp_path / page.name).write_text(text, encoding="utf-8")
    monkeypatch.setattr(public_names, "PAGES", tmp_path)
    with pytest.raises(Exception, match="no page .* has the package of fecloth.BaraffWitkin, "):
        public_names.require_all(None)


@pytest.mark.parametrize("width", [390, 1280])
def test_a_page_begins_above_the_fold_and_does_not_scroll_sideways(width, site, pages, browser):
    page = browser.new_page(viewport={"width": width, "height": 800})
    look = """() => [document.documentElement.scrollWidth - innerWidth,
                     document.querySelector('h1').getBoundingClientRect().bottom]"""
    shown = [name for name in pages if not name.startswith(("_", "api/names"))]
    for name in [*shown, "api/names/System.html", "api/names/study.converge.html"]:
        page.goto((site / name).as_uri())
        beyond, bottom = page.evaluate(look)
        assert (beyond, name) == (0, name)
        assert 0 < bottom < 600, name
    page.close()


# --- the search -----------------------------------------------------------------------------------

QUESTIONS = {  # what is typed: page and words of its answer
    "moved pin": ("scenes.html", "A pin follows the changes of its motion"),
    "restart a run": ("runs.html", "continues the run in that folder"),
    "drop a cloth on a table": ("contact.html", 'shape = { type = "Plane"'),
    "own stress-strain curve": ("terms.html", "Each row must need more stress than the row before"),
    "arguments of smoothstep": ("scenes.html", "smoothstep(a, b, t)"),
    "cite fecloth": ("readme.html", "A citation names fecloth"),
    "export to Blender": ("blender.html", "fecloth export out/flag"),
    "which element": ("recommend.html", "Linear triangles (P1) are the default"),
    "why is the report amber": ("runs.html", "came to its end with warnings"),
    "how to start a cluster": ("studies.html", "dask scheduler --host"),
}


@pytest.fixture(scope="module")  # as in test_web_page: two cannot be open at once
def browser():
    yield from chromium()


@pytest.fixture(scope="module")
def page(browser):
    return browser.new_page()


@pytest.mark.parametrize("question", QUESTIONS)
def test_the_search_answers(question, site, page):
    """From a file, on the first page of results; the section that it leads to has the answer."""
    wanted, words = QUESTIONS[question]
    start = time.perf_counter()
    page.goto(f"{(site / 'search.html').as_uri()}?q={quote(question)}")
    page.wait_for_selector("#results li")
    links = page.eval_on_selector_all("#results a", "all => all.map(a => a.getAttribute('href'))")
    seconds = time.perf_counter() - start
    assert 0 < len(links) <= 10
    answers = [
        link for link in links if link.startswith(f"{wanted}#") and words in told(page, site, link)
    ]
    assert answers, links
    print(f"{question}: result {links.index(answers[0]) + 1}, {seconds:.1f} s")


def told(page, site, link):
    """The text of the section that a result leads to."""
    page.goto(f"{site.as_uri()}/{link}")
    text = page.evaluate("document.getElementById(decodeURI(location.hash.slice(1))).innerText")
    return " ".join(text.split())
