"""The report as PDF, by WeasyPrint, which is imported only here."""

from __future__ import annotations

import logging
from typing import Any

from fenics_contact.errors import InputError

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
