"""Puts together what `make docs` builds: copies of all pages, and a Python reference.

The pages keep their places in the repository. README.md is the start page. The Python reference is
made from the docstrings of the public names.
"""

import inspect
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import fenics_contact
from fenics_contact import meshing

ROOT = Path(__file__).resolve().parents[1]
#: What is copied: files, and folders with the kinds of files that pages show or lead to.
FILES = ("README.md", "CHANGELOG.md", "LICENSE", "CITATION.cff", "benchmarks/README.md")
FOLDERS = {
    "docs": ("*.md", "*.png", "*.svg"),
    "demos": ("*.py", "*.toml"),
    "benchmarks": ("*.png",),
}
#: Sections of a docstring, in Google's style.
SECTIONS = ("Args", "Attributes", "Returns", "Yields", "Raises", "Note")

HEAD = """# Python reference

This page is made from the docstrings of the program. Units are SI.
"""


def copied(target: Path) -> None:
    """Copy all pages and what they show."""
    shutil.rmtree(target, ignore_errors=True)
    found = [ROOT / name for name in FILES]
    for folder, kinds in FOLDERS.items():
        found += [path for kind in kinds for path in (ROOT / folder).rglob(kind)]
    for path in found:
        relative = path.relative_to(ROOT)
        if "output" not in relative.parts:
            (target / relative).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, target / relative)


def reference() -> Iterator[str]:
    """Lines of the Python reference."""
    yield HEAD
    yield "## `fenics_contact`\n"
    for name in sorted(fenics_contact.__all__, key=str.lower):
        thing = getattr(fenics_contact, name)
        if inspect.isclass(thing) or inspect.isfunction(thing):
            yield from entry(name, thing)
    yield "## `fenics_contact.meshing`\n"
    yield f"{paragraphs(meshing)}\n"
    for name, thing in public(meshing):
        yield from entry(name, thing)


def public(module: ModuleType) -> list[tuple[str, Any]]:
    """Functions of a module that users call."""
    functions = inspect.getmembers(module, inspect.isfunction)
    mine = [(n, f) for n, f in functions if f.__module__ == module.__name__]
    return [(name, thing) for name, thing in mine if not name.startswith("_")]


def entry(name: str, thing: Any) -> Iterator[str]:
    """Name, signature and docstring of a class or function, and the methods of a class."""
    failure = inspect.isclass(thing) and issubclass(thing, Exception)
    yield f"### `{name}`\n"
    if not failure:
        yield f"```python\n{signature(name, thing)}\n```\n"
    yield f"{paragraphs(thing)}\n"
    if failure or not inspect.isclass(thing):
        return
    members = [(n, m) for n, m in inspect.getmembers(thing) if not n.startswith("_")]
    properties = [(n, m) for n, m in members if isinstance(m, property)]
    methods = [(n, m) for n, m in members if inspect.isfunction(m) or inspect.ismethod(m)]
    lines = [f"- `{member}`: {first_line(value)}" for member, value in properties]
    lines += [f"- `{signature(member, value)}`: {first_line(value)}" for member, value in methods]
    if lines:
        yield "\n".join(["**Properties and methods**", "", *lines, ""])


def signature(name: str, thing: Any) -> str:
    """A call as one writes it, with types without their modules."""
    parts = []
    for item in inspect.signature(thing).parameters.values():
        if item.name in ("self", "cls"):
            continue
        parts.append(item.name if item.default is item.empty else f"{item.name}={short(item)}")
    return f"{name}({', '.join(parts)})"


def short(item: inspect.Parameter) -> str:
    """A default value, or three dots where it is made."""
    text = repr(item.default)
    return text if len(text) <= 20 and not text.startswith("<") else "..."


def first_line(thing: Any) -> str:
    """What a docstring says first."""
    return (inspect.getdoc(thing) or "").partition("\n\n")[0].replace("\n", " ")


def paragraphs(thing: Any) -> str:
    """A docstring as Markdown: sections as lists."""
    lines, section = [], False
    for line in (inspect.getdoc(thing) or "").splitlines():
        heading = line.rstrip(":") if line.endswith(":") else ""
        if heading in SECTIONS:
            section = True
            lines += [f"**{heading}**", ""]
        elif section and line.startswith("    ") and line[4:5] != " ":
            name, colon, text = line.strip().partition(":")
            simple = colon and " " not in name
            lines.append(f"- `{name}`:{text}" if simple else f"- {line.strip()}")
        elif section and line.startswith("     "):
            lines.append(f"  {line.strip()}")
        else:
            lines.append(line)
    return "\n".join(lines)


def main() -> None:
    """Fill the folder given, or build/pages."""
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "build" / "pages"
    copied(target)
    (target / "docs" / "python.md").write_text("\n".join(reference()))


if __name__ == "__main__":
    main()
