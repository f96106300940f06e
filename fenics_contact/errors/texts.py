"""Texts of the user as pictures have them."""

from __future__ import annotations

import textwrap


def plain(text: str, most: int = 0) -> str:
    r"""A text in one line, of `most` characters if given, in which dollars are no mathematics.

    Matplotlib takes what is between two dollars as a formula, draws `\$` as a dollar, and leaves
    labels that begin with an underscore out of legends.
    """
    line = "".join(c if c.isprintable() else " " for c in text)
    if most:
        line = textwrap.shorten(line, most, placeholder=" ...")
    return f"{' ' * line.startswith('_')}{line}".replace("$", r"\$")
