"""What the documentation says is so: its commands and programs run, its links lead somewhere."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.system.program import ROOT, Run, run_command

PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *ROOT.glob("benchmarks/*.md")])
#: Pages whose programs and commands are run, in order, in one folder.
LESSONS = ["README.md", "docs/tutorial.md"]
#: What a lesson finds in its folder.
GIVEN = ("demos", "meshes")
#: Commands that install, or prepare the shell.
NOT_RUN = ("make", "source", "export")
#: Made by `make docs`, from docstrings.
GENERATED = {ROOT / "docs" / "python.md"}
#: A picture of the gallery, bytes.
SMALL = 60_000


@dataclass(frozen=True)
class Block:
    """A block of code, with the file name in backticks last named before it."""

    kind: str
    text: str
    name: str


def blocks(page: str) -> Iterator[Block]:
    """All blocks of code of a page."""
    name = ""
    for part in re.split(r"^(```.*?^```)$", (ROOT / page).read_text(), flags=re.S | re.M):
        if part.startswith("```"):
            kind, _, text = part[3:-3].partition("\n")
            yield Block(kind.strip(), text, name)
            name = ""
        elif named := re.findall(r"(?:Save this as|Then write) `([\w.]+)`", part):
            name = named[-1]


@pytest.fixture
def shell(tmp_path, monkeypatch) -> Path:
    """A folder with what lessons use of the repository, and the commands on the path."""
    for name in GIVEN:
        (tmp_path / name).symlink_to(ROOT / name)
    programs = tmp_path / ".bin"
    programs.mkdir()
    for name, arguments in (("python3", ""), ("fenics-contact", "-m fenics_contact ")):
        path = programs / name
        path.write_text(f'#!/bin/sh\nexec "{sys.executable}" {arguments}"$@"\n')
        path.chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("OMPI_MCA_rmaps_base_oversubscribe", "1")
    return tmp_path


def commands(text: str) -> list[str]:
    """The commands of a block that a test can run."""
    lines = (line.partition("  #")[0].strip() for line in text.splitlines())
    return [line for line in lines if line and not line.startswith(NOT_RUN)]


@pytest.mark.slow
@pytest.mark.parametrize("page", LESSONS)
def test_lessons_run_as_they_are_written(page, shell):
    found, count = Run(0, "", ""), 0
    for block in blocks(page):
        if block.kind in ("python", "toml") and block.name:
            (shell / block.name).write_text(block.text)
        elif block.kind == "python":
            found = run_command([sys.executable, "-c", block.text], shell)
        elif block.kind == "text":
            missing = [line for line in block.text.splitlines() if line not in found.out]
            assert missing == [], found.out
        elif block.kind == "sh" and (lines := commands(block.text)):
            found = run_command(["bash", "-ec", "\n".join(lines)], shell, time_out=300.0)
        assert found.code == 0, f"{block.text}\n{found.out}{found.err}"
        count += 1
    assert count >= 4
    assert list(shell.rglob("*.html"))


@pytest.mark.slow
def test_load_factor_of_the_readme(shell):
    (scene,) = (b for b in blocks("README.md") if b.kind == "toml")
    (shell / scene.name).write_text(scene.text)
    found = run_command(["fenics-contact", "solve", scene.name], shell)
    said = re.search(r"prints `(load factor = [\d.]+)`", (ROOT / "README.md").read_text())
    assert said is not None and said[1] in found.out


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_blocks_that_are_not_run_name_what_there_is(page):
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), flags=re.M)
    text = page.read_text()
    named = re.findall(r"(?:^|`)make ([a-z][\w-]*)", text, flags=re.M)
    assert set(named) <= set(targets)
    scripts = re.findall(r"python3 ((?:demos|docs|benchmarks|meshes)/[\w/]+\.py)", text)
    assert [name for name in scripts if not (ROOT / name).exists()] == []


def anchors(page: Path) -> set[str]:
    """Anchors of the headings of a page."""
    titles = re.findall(r"^#+ +(.*)$", page.read_text(), flags=re.M)
    words = (re.sub(r"[^\w\- ]", "", title.lower()) for title in titles)
    return {word.strip().replace(" ", "-") for word in words}


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_links_lead_somewhere(page):
    text = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.S | re.M)
    text = re.sub(r"`[^`\n]*`", "", text)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if link.startswith(("http:", "https:")):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists() or target in GENERATED, link
        if anchor:
            assert anchor in anchors(target), link


def test_gallery_shows_all_demos_in_small_pictures():
    text = (ROOT / "docs" / "gallery.md").read_text()
    demos = [path.name for path in (ROOT / "demos").glob("[0-9]*.py")]
    assert [name for name in demos if f"(../demos/{name})" not in text] == []
    shown = set(re.findall(r"\((gallery/[^)]+)\)", text))
    pictures = list((ROOT / "docs" / "gallery").iterdir())
    assert {f"gallery/{path.name}" for path in pictures} == shown
    assert max(path.stat().st_size for path in pictures) < SMALL


def test_site_has_all_pages():
    listed = (ROOT / "mkdocs.yml").read_text()
    for page in PAGES:
        assert f" {page.relative_to(ROOT)}\n" in listed, page.name
