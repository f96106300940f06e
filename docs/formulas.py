"""Formulas and anchors of the pages, as mkdocs builds the site: a hook of mkdocs.yml.

Pages have formulas as code hosts read them: a block of code of the kind `math`, and code between
dollars within a line. Here they become scripts for MathJax, which `make docs` copies into the site.
"""

import html
import re
from collections.abc import Iterable
from typing import Any

LOADER = "mathjax/MathJax.js?config=TeX-AMS_SVG"
#: A formula of its own is broken into lines where the screen is narrow, one within a line is not.
BREAKS = """<script type="text/x-mathjax-config">
MathJax.Hub.Config({SVG: {linebreaks: {automatic: true}}, showMathMenu: false});
</script>"""
KINDS = (
    (r'<pre><code class="language-math">(.*?)</code></pre>', "; mode=display", "{}"),
    (r"\$<code>(.*?)</code>\$", "", r"\raise 0pt{{{}}}"),
)


def on_page_content(content: str, page: Any, **_: Any) -> str:
    """The text of a page: formulas are scripts with MathJax after them, pictures open in full."""
    content = re.sub(r'( id="|href="[^":]*#)(\d)', r"\1s\2", content)
    picture = r'<p>(<img [^>]*src="([^"]+)"[^>]*>)</p>'
    content = re.sub(picture, r'<p><a href="\2">\1</a></p>', content)
    rename(page.toc)
    plain = content
    for pattern, mode, form in KINDS:

        def script(found: re.Match[str], mode: str = mode, form: str = form) -> str:
            return f'<script type="math/tex{mode}">{form.format(html.unescape(found[1]))}</script>'

        content = re.sub(pattern, script, content, flags=re.DOTALL)
    if content == plain:
        return content
    return f'{content}\n{BREAKS}<script src="{"../" * page.url.count("/")}{LOADER}"></script>'


def rename(anchors: Iterable[Any]) -> None:
    """The theme's script fails at names of anchors that begin with a number."""
    for anchor in anchors:
        if anchor.id[:1].isdigit():
            anchor.id = f"s{anchor.id}"
        rename(anchor.children)
