"""A result on one page: report.html, made from result.json and the files beside it; and as PDF.

The page needs no other file. Its only script moves the blocks; without it, and in print, they are
shown displaced. All texts of the user are escaped. WeasyPrint makes the PDF.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

from fenics_contact.errors import InputError, OutputError
from fenics_contact.output.folder import replace_file
from fenics_contact.output.report.answer import first_page
from fenics_contact.output.report.content import (
    RECORD,
    Content,
    Labels,
    Sweep,
    read_content,
    read_sweep,
)
from fenics_contact.output.report.html import bullets, heading, paragraph, text
from fenics_contact.output.report.mechanism import SCRIPT, how_it_fails
from fenics_contact.output.report.sections import (
    computation,
    forces,
    load_factors,
    loads_and_groups,
    sensitivity,
    structure,
    sweep_parts,
    verification,
)
from fenics_contact.output.report.words import CRUSHING, ELASTIC, NOTES, STYLE

#: The page.
PAGE = "report.html"

#: A part of the page, as HTML.
Section = Callable[[Content], Iterator[str]]


def write_report(
    folder: Path,
    target: Path | None = None,
    pdf: Path | None = None,
    labels: Labels | None = None,
) -> list[Path]:
    """Write the page on the result, or the sweep, in a folder, on this rank.

    Args:
        folder: Where a result was written to, or a sweep.
        target: The page; report.html in the folder by default.
        pdf: The same as PDF, if it is wished.
        labels: Project and author.

    Returns:
        What was written.

    Raises:
        InputError: If the folder holds no result, or one of a version that kept less, if a file
            has another ending or its folder is read-only, or if WeasyPrint, which makes the PDF,
            is not installed. Nothing is written then.
        OutputError: If a file cannot be written.
    """
    target = target or folder / PAGE
    _check_targets({"-o": (target, ".html"), **({"--pdf": (pdf, ".pdf")} if pdf else {})})
    writer = pdf_writer() if pdf else None
    try:
        page = _made(folder, labels or Labels())
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{folder / RECORD} is damaged ({error!r}); solve the scene again"
        ) from error
    _replace(target, page.encode("utf-8"), "-o")
    if pdf:
        _replace(pdf, pdf_of(writer, page), "--pdf")
    return [target, *([pdf] if pdf else [])]


def _made(folder: Path, labels: Labels) -> str:
    """The page on what is in a folder, as HTML."""
    sweep = None if (folder / RECORD).exists() else read_sweep(folder)
    return report_page(read_content(folder, labels)) if sweep is None else sweep_page(sweep, labels)


def _check_targets(targets: Mapping[str, tuple[Path, str]]) -> None:
    """Refuse files of another ending, and where no file can be written, by their options."""
    for option, (target, ending) in targets.items():
        if target.suffix.lower() != ending:
            raise InputError(f"{option} {target}: a file that ends with {ending} is written")
        there = target.parent.is_dir()
        if target.is_dir() or (there and not os.access(target.parent, os.W_OK)):
            reason = "it is a folder" if target.is_dir() else "no right to, or a read-only disk"
            raise InputError(f"cannot write '{target}': {reason}; choose with {option}")


def _replace(target: Path, data: bytes, option: str) -> None:
    """Write a file that is complete whenever it is there."""
    try:
        replace_file(target, data)
    except OSError as error:
        reason = f"{error.strerror}; choose with {option}"
        raise OutputError(f"cannot write '{target}': {reason}") from None


def _warnings(content: Content) -> Iterator[str]:
    """Warnings of the run."""
    warnings = content.record["warnings"]
    yield heading("Warnings")
    yield bullets(warnings) if warnings else paragraph("None.")


def _notes(content: Content) -> Iterator[str]:
    """What readers should know of the theory."""
    yield heading("What to know when you use these numbers")
    yield bullets([*NOTES, CRUSHING if content.has_strength else ELASTIC])


#: Parts of the page in their order; each begins with its heading.
SECTIONS: tuple[Section, ...] = (
    first_page,
    loads_and_groups,
    how_it_fails,
    load_factors,
    forces,
    sensitivity,
    structure,
    _warnings,
    _notes,
    verification,
    computation,
)
#: Classes of parts: "break" begins on a new page in print.
KINDS: Mapping[Section, str] = {
    loads_and_groups: "break",
    verification: "break appendix",
    computation: "appendix",
}


def report_page(content: Content) -> str:
    """The page, as HTML."""
    parts = chain.from_iterable(_part(section, content) for section in SECTIONS)
    return _page(content.record["title"] or "Limit load", [*parts, f"<script>{SCRIPT}</script>"])


def sweep_page(sweep: Sweep, labels: Labels) -> str:
    """The page on a sweep alone, as HTML."""
    return _page(f"Sweep: {sweep.folder}", sweep_parts(sweep, labels.named()))


def _page(name: str, parts: Iterable[str]) -> str:
    """A page of parts with a title, as HTML."""
    title = text(name)
    head = f'<meta charset="utf-8"><title>{title}</title><style>{STYLE}</style>'
    body = "\n".join(parts)
    return f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head><body>\n{body}\n</body></html>\n'


def _part(section: Section, content: Content) -> Iterator[str]:
    """One part of the page."""
    kind = KINDS.get(section, "")
    yield f'<section class="{kind}">' if kind else "<section>"
    yield from section(content)
    yield "</section>"


MISSING = (
    "--pdf needs WeasyPrint, which is not there: install the Debian package 'weasyprint' (apt"
    " install weasyprint), or leave --pdf out and print the HTML page from a browser"
)


def pdf_writer() -> Any:
    """WeasyPrint, quiet.

    Raises:
        InputError: If it is not installed, or a library of it is missing.
    """
    try:
        import weasyprint
    except (ImportError, OSError) as error:
        raise InputError(MISSING) from error
    logging.getLogger("weasyprint").setLevel(logging.CRITICAL)
    logging.getLogger("fontTools").setLevel(logging.CRITICAL)
    return weasyprint


def pdf_of(writer: Any, page: str) -> bytes:
    """A page of HTML as PDF; nothing but what the page holds itself is read."""
    pdf: bytes = writer.HTML(string=page, url_fetcher=_data_fetcher(writer)).write_pdf()
    return pdf


def _data_fetcher(writer: Any) -> Any:
    """What WeasyPrint reads addresses with: those that are data themselves, and no other."""
    fetcher = getattr(writer, "URLFetcher", None)
    if fetcher is not None:  # from WeasyPrint 68 on
        return fetcher(allowed_protocols=("data",))

    def fetch(address: str) -> Any:
        if not address.startswith("data:"):
            raise ValueError("a report reads no other file")
        return writer.default_url_fetcher(address)

    return fetch
