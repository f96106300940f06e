"""The report as PDF, with project and author on page 1."""

from __future__ import annotations

import json
import re
import sys

import pytest

from fenics_contact.output.report.page import pdf_of
from tests.quick import slow
from tests.system.program import run_here, write_scene

OPTIONS = ["--pdf", "wall.pdf", "--project", "Town wall & gate", "--author", "A. Mason"]


@pytest.fixture
def solved(folder, capsys):
    """The folder of a result."""
    write_scene(folder, {"output.paraview": False}, "block")
    assert run_here(["solve", "scene.toml"], capsys).code == 0
    return folder / "scene"


def test_pdf_with_project_and_author(solved, capsys):
    pytest.importorskip("weasyprint", reason="no WeasyPrint: make browser")
    found = run_here(["report", "scene", *OPTIONS], capsys)
    assert (found.code, found.err) == (0, "")
    assert found.out == "written to scene/report.html\nwritten to wall.pdf\n"
    written = (solved.parent / "wall.pdf").read_bytes()
    assert written.startswith(b"%PDF-")
    assert 4 <= len(re.findall(rb"/Type /Page\b", written)) <= 10 and b"/Title" in written
    page = (solved / "report.html").read_text()
    assert "Project: Town wall &amp; gate" in page and "Author: A. Mason" in page


@pytest.mark.parametrize("tall", [True, *slow(False)])
def test_first_page_has_answer_picture_and_assumptions(tall, solved, capsys):
    """Also with the most assumptions that it lists, of several lines each."""
    weasyprint = pytest.importorskip("weasyprint", reason="no WeasyPrint: make browser")
    record = json.loads((solved / "result.json").read_text())
    scene = record["scene"]
    scene["size"] |= {"width": 1.0, "height": 5.0 if tall else 1.0}
    law = next(iter(scene["foundations"].values())) | {"cohesion": 5e4, "tensile_strength": 2e4}
    for kind, one in (("joints", law), ("materials", scene["materials"]["default"])):
        scene[kind] = {f"{kind} of the west front {number}": one for number in range(4)}
    (solved / "result.json").write_text(json.dumps(record))
    assert run_here(["report", "scene"], capsys).code == 0
    document = weasyprint.HTML(string=(solved / "report.html").read_text()).render()
    first, second = (document.copy([document.pages[k]]) for k in (0, 1))
    assert "Assumptions" in str(first.make_bookmark_tree())
    assert "Loads and groups" in str(second.make_bookmark_tree())  # what follows the table


def test_without_weasyprint_one_line_and_no_file(solved, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "weasyprint", None)
    found = run_here(["report", "scene", *OPTIONS], capsys)
    assert (found.code, found.out, found.err.count("\n")) == (2, "", 1)
    assert "--pdf needs WeasyPrint" in found.err and "pip install weasyprint" in found.err
    assert not (solved / "report.html").exists() and not (solved.parent / "wall.pdf").exists()


class EarlyWriter:
    """WeasyPrint before it had a class for what reads addresses."""

    default_url_fetcher = staticmethod(lambda address: f"read {address}")

    class HTML:
        def __init__(self, string, url_fetcher):
            self.fetch = url_fetcher

        def write_pdf(self):
            with pytest.raises(ValueError, match="no other file"):
                self.fetch("file:///etc/passwd")
            return f"{self.fetch('data:x')}".encode()


class QuickWriter(EarlyWriter):
    """WeasyPrint that writes nothing."""

    class HTML(EarlyWriter.HTML):
        def write_pdf(self):
            return b"%PDF-"


class LateWriter(EarlyWriter):
    """WeasyPrint with that class, and without the function."""

    default_url_fetcher = None

    class URLFetcher:
        def __init__(self, allowed_protocols):
            self.allowed = allowed_protocols

        def __call__(self, address):
            if address.split(":")[0] not in self.allowed:
                raise ValueError("no other file")
            return f"read {address}"


@pytest.mark.parametrize("writer", [EarlyWriter, LateWriter])
def test_the_pdf_reads_no_other_file_in_any_version_of_weasyprint(writer):
    assert pdf_of(writer, "<p></p>") == b"read data:x"


def test_4_where_the_pdf_cannot_be_written(solved, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "weasyprint", QuickWriter)
    found = run_here(["report", "scene", "--pdf", "no/wall.pdf"], capsys)
    assert found.code == 4 and "cannot write 'no/wall.pdf'" in found.err and "--pdf" in found.err
