"""What the documentation says is so: its programs, commands and scenes run, its keys are there.

`make docs` checks links. In the pages, blocks of code are of these kinds: `sh`, `python` and `toml`
are run, `text` and a comment `it collapses at ...` are what is printed, `py` is a sketch, `math` a
formula. "Save this as `NAME`" before a block makes a file of it; other scenes are parts of one, and
are checked.
"""

from __future__ import annotations

import dataclasses
import os
import re
import runpy
import sys
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args, get_type_hints

import pytest

import fenics_contact
from fenics_contact import Scene
from fenics_contact.meshing import polygons
from fenics_contact.scene.rules import Checked, is_of
from fenics_contact.scene.toml_tables import key_of
from fenics_contact.spatial import builders
from fenics_contact.spatial.scene import BlockScene
from tests.bank import sides
from tests.drawing import rectangle
from tests.system.program import ROOT, Run, changed, run_command, run_here, toml
from tests.system.test_drawing import write_dxf

PAGES = sorted(
    str(path.relative_to(ROOT))
    for pattern in ("*.md", "docs/*.md", "benchmarks/*.md")
    for path in ROOT.glob(pattern)
)
RUN = ("sh", "python", "toml")
#: Pages whose commands take more than a few seconds.
SLOW = (
    "README.md",
    "docs/tutorial.md",
    "docs/sweep.md",
    "docs/python.md",
    "docs/scene.md",
    "docs/fixed_point.md",
    "docs/spatial.md",
)
#: Commands that install, or prepare the shell.
NOT_RUN = ("make", "source", "export", "docker", "conda", "pip")
REFERENCE = ROOT / "docs" / "reference.md"
#: All pictures of the gallery, bytes.
SMALL = 550_000


@dataclass(frozen=True)
class Block:
    """A block of code, and the file that the text before it names."""

    kind: str
    text: str
    name: str

    @property
    def commands(self) -> list[str]:
        """Lines that a test can run."""
        lines = (line.partition("  #")[0].strip() for line in self.text.splitlines())
        return [line for line in lines if line and not line.startswith(NOT_RUN)]


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


def prose(page: str) -> str:
    """A page without its blocks of code."""
    return re.sub(r"^```.*?^```$", "", (ROOT / page).read_text(), flags=re.S | re.M)


def lessons() -> Iterator[Any]:
    """Pages with something to run."""
    for page in PAGES:
        if any(block.kind in RUN for block in blocks(page)):
            yield pytest.param(page, marks=pytest.mark.slow if page in SLOW else ())


@pytest.fixture
def shell(tmp_path, monkeypatch) -> Path:
    """A folder with what the pages use, and the commands on the path."""
    for name in ("demos", "meshes"):
        (tmp_path / name).symlink_to(ROOT / name)
    (example,) = (block for block in blocks("README.md") if block.kind == "toml")
    (tmp_path / example.name).write_text(example.text)
    programs = tmp_path / ".bin"
    programs.mkdir()
    for name, arguments in (("python3", ""), ("fenics-contact", "-m fenics_contact ")):
        path = programs / name
        path.write_text(f'#!/bin/sh\nexec "{sys.executable}" {arguments}"$@"\n')
        path.chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")
    return tmp_path


def write_wall(path: Path) -> None:
    """Three blocks on one another, 4 m x 3 m, with the groups that scenes of the pages name."""
    import gmsh

    courses = [rectangle(0, level, 4, level + 1) for level in range(3)]
    edges = {"base": (0, 0, 2, 0), "right_pier": (3, 0, 4, 0), "bed": (0, 1, 4, 1)}
    faces = {"left": (0, 0, 0, 3), "back": (4, 0, 4, 3), "top": (0, 3, 4, 3)}
    polygons(courses, 0.5, groups=sides(**edges, **faces))
    gmsh.write(str(path))
    gmsh.model.remove()


def by_dotted_key(tables: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Keys and values of nested tables."""
    for key, value in tables.items():
        if isinstance(value, Mapping):
            yield from by_dotted_key(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value


def done(block: Block, shell: Path, capsys: Any) -> Run:
    """What a block of code leaves behind."""
    if block.name:
        (shell / block.name).write_text(block.text)
        return Run(0, "", "")
    if block.kind == "python":
        return run_command([sys.executable, "-c", block.text], shell)
    if block.kind == "sh":
        return run_command(["bash", "-ec", "\n".join(block.commands)], shell, time_out=300.0)
    write_wall(shell / "wall.msh")
    part = dict(by_dotted_key(tomllib.loads(block.text)))
    whole = {"mesh.file": "wall.msh", "foundations.right_pier.friction": 0.5, **part}
    (shell / "part.toml").write_text(toml(changed(whole)))
    return run_here(["check", shell / "part.toml"], capsys)


@pytest.mark.parametrize("page", lessons())
def test_pages_run_as_they_are_written(page, shell, capsys):
    if page == "docs/scene.md":
        write_dxf(shell / "facade.dxf", [(rectangle(0, 0, 1000, 500), "stone")])
    found = Run(0, "", "")
    for block in blocks(page):
        if block.kind == "text":
            missing = [line for line in block.text.splitlines() if line not in found.out]
            assert missing == [], found.out
        elif block.kind in RUN:
            found = done(block, shell, capsys)
            assert found.code == 0, f"{block.text}\n{found.out}{found.err}"
            said = re.findall(r"# (it collapses at [\d.]+ g)", block.text)
            assert all(line in found.out for line in said), found.out


@pytest.mark.parametrize("page", PAGES)
def test_other_blocks_hold_no_commands(page):
    assert {block.kind for block in blocks(page)} <= {*RUN, "text", "py", "math", ""}
    rest = [line for b in blocks(page) if b.kind in ("", "text") for line in b.text.splitlines()]
    assert [line for line in rest if re.match(r"(fenics-contact|python3|mpirun|make) ", line)] == []


@pytest.mark.parametrize("page", PAGES)
def test_files_and_targets_are_there(page):
    text = (ROOT / page).read_text()
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), flags=re.M)
    assert set(re.findall(r"(?:^|`)make ([a-z][\w-]*)", text, flags=re.M)) <= set(targets)
    scripts = re.findall(r"(?:python3|pvpython) ([\w/]+\.py)", text)
    assert [name for name in scripts if "/" in name and not (ROOT / name).exists()] == []


def test_one_version_number():
    cited = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(), flags=re.M)
    assert cited is not None
    assert cited[1] == fenics_contact.__version__


@pytest.mark.parametrize("page", PAGES)
def test_commands_in_the_text_are_known(page, capsys):
    for command in re.findall(r"`fenics-contact ([^`]+)`", prose(page)):
        name, *options = command.split()
        found = run_here([name, *(() if name.startswith("--") else ["--help"])], capsys)
        assert found.code == 0, command
        assert all(option in found.out for option in options if option.startswith("-")), command
    for value in re.findall(r"--set ([a-z][\w.-]+=[^`\s]+)`", prose(page)):
        Scene.from_file(ROOT / "demos" / "03_wall_w3.toml", overrides=[value])


@pytest.mark.parametrize("page", PAGES)
def test_options_in_the_text_are_known(page):
    for table, key in re.findall(r"`(solve|output)\.(\w+)", prose(page)):
        options = {field.name: field for field in dataclasses.fields(Scene)}[table].default_factory
        assert hasattr(options(), key), f"{table}.{key}"


def keys(table: type, scene: tuple[str, ...]) -> Iterator[str]:
    """All keys of a scene file of some kinds, without the tables that they are in."""
    hints = get_type_hints(table)
    for item in dataclasses.fields(table):
        if not is_of(item, scene):
            continue
        yield key_of(item.name)
        for part in (hint := hints[item.name], *get_args(hint)):
            if isinstance(part, type) and issubclass(part, Checked):
                yield from keys(part, scene)


def test_scene_reference_has_all_keys():
    text = (ROOT / "docs" / "scene.md").read_text()
    found = set(keys(Scene, ("mesh", "plane")))
    assert {"young", "width", "tolerance", "capacity"} <= found
    assert [name for name in found if not re.search(rf"[`.\n]{name}\b", text)] == []


def test_page_on_space_has_all_keys_and_builders():
    text = (ROOT / "docs" / "spatial.md").read_text()
    # Keys that a page on the plane tells of, or that space refuses; and what a file is told of.
    elsewhere = {"law", "bound", "gap", "opened", "glued", "title", "live", "dead", "poisson"}
    elsewhere |= {"notes", "read", "units", "capacity", "confidence_factor", "demand"}
    found = set(keys(BlockScene, ("blocks", "plane", "space")))
    for name, function in vars(builders).items():
        if getattr(function, "__module__", "") == builders.__name__ and name[0].islower():
            found |= {name, *function.__annotations__} - {"return"}
    assert {"dome", "oculus", "quick", "prestress"} <= found
    missing = [name for name in found - elsewhere if not re.search(rf"[`.\n]{name}\b", text)]
    assert missing == []


def test_python_page_has_all_names():
    text = (ROOT / "docs" / "python.md").read_text()
    assert [name for name in fenics_contact.__all__ if f"`{name}`" not in text] == []
    listed = re.findall(r"^::: fenics_contact\S*\.(\w+)$", REFERENCE.read_text(), flags=re.M)
    assert set(fenics_contact.__all__) - {"__version__"} <= set(listed)


def test_gallery_shows_all_demos_in_small_pictures():
    text = (ROOT / "docs" / "gallery.md").read_text()
    demos = [path.name for path in (ROOT / "demos").glob("*.[pi]*") if path.is_file()]
    assert [name for name in demos if f"(../demos/{name})" not in text] == []
    pictures = set((ROOT / "docs" / "gallery").rglob("*.png"))
    assert pictures == {ROOT / "docs" / name for name in re.findall(r"\((gallery/[^)]+)\)", text)}
    assert sum(path.stat().st_size for path in pictures) < SMALL


def test_formulas_of_the_site_need_no_remote_address():
    hook = runpy.run_path(str(ROOT / "docs" / "formulas.py"))["on_page_content"]
    anchor = SimpleNamespace(id="2-the-problem", children=[])
    page = SimpleNamespace(url="docs/method.html", toc=[anchor])
    text = '<h2 id="2-the-problem">A</h2>$<code>a &lt; b</code>$'
    block = '<pre><code class="language-math">a = b\n</code></pre>'
    found = hook(text + block, page=page)
    assert anchor.id == "s2-the-problem" and 'id="s2-the-problem"' in found
    assert '<script type="math/tex">\\raise 0pt{a < b}</script>' in found
    assert '<script type="math/tex; mode=display">a = b\n</script>' in found
    assert re.findall(r'src="([^"]+)"', found) == ["../mathjax/MathJax.js?config=TeX-AMS_SVG"]
    assert hook("<p>words</p>", page=page) == "<p>words</p>"
