"""Small copies, in docs/gallery, of the pictures of demos/output that docs/gallery.md shows.

Those in docs/gallery/page_1 are made here: page 1 of the report on structures of tests/eight.py. Of
structures in space the oblique view is shown.
"""

import re
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image

from fenics_contact import limit_load
from fenics_contact.output.report.page import write_report

DOCS = Path(__file__).resolve().parent
WIDTH, COLOURS = 680, 112  # pixels; for small files

SPACE, SPACE_COLOURS = 304, 24  # pixels of structures in space

PAGE, PAGE_COLOURS = 440, 16  # pixels of page 1

sys.path.insert(0, str(DOCS.parent))
from tests.eight import EIGHT  # noqa: E402


def first_page(name: str) -> Image.Image:
    """Page 1 of the report on one of the structures; needs WeasyPrint and pypdfium2."""
    import pypdfium2

    with TemporaryDirectory() as made:
        folder = Path(made) / "out"
        limit_load(EIGHT[name]()).write(folder)
        write_report(folder, pdf=folder / "page.pdf")
        page = pypdfium2.PdfDocument(folder / "page.pdf")[0]
        return page.render(scale=2.0).to_pil().convert("RGB")


def parts(dark: np.ndarray, gap: int) -> list[np.ndarray]:
    """Runs of lines that have something dark, at least so far apart."""
    lines = np.flatnonzero(dark)
    return np.split(lines, np.flatnonzero(np.diff(lines) > gap) + 1)


def oblique_view(picture: Image.Image) -> Image.Image:
    """The last view of a structure in space, of three or one, without titles and legend."""
    low = picture.height // 8  # below the titles
    dark = np.asarray(picture.convert("L"))[low:] < 250
    *_, rows = (run for run in parts(dark.any(axis=1), 4) if len(run) > low)
    columns = parts(dark[rows].any(axis=0), 6)[-1]
    rows = max(parts(dark[:, columns].any(axis=1), 4), key=len)
    return picture.crop((columns[0], low + rows[0], columns[-1] + 1, low + rows[-1] + 1))


shutil.rmtree(DOCS / "gallery", ignore_errors=True)
for name in re.findall(r"!\[[^]]*\]\(gallery/([^)]+)\)", (DOCS / "gallery.md").read_text()):
    folder, _, stem = name.removesuffix(".png").rpartition("/")
    if folder == "page_1":
        picture = first_page(stem.replace("_", " "))
        picture.thumbnail((PAGE, 2 * PAGE))
        colours = PAGE_COLOURS
    else:
        picture = Image.open(DOCS.parent / "demos" / "output" / name).convert("RGB")
        space = folder.startswith("builders")
        picture = oblique_view(picture) if space else picture
        width, colours = (SPACE, SPACE_COLOURS) if space else (WIDTH, COLOURS)
        if stem == "beyond":  # lines and grey blocks
            width, colours = PAGE, PAGE_COLOURS
        if stem == "stresses":
            width, colours = SPACE, 12
        picture.thumbnail((width, width))
    target = DOCS / "gallery" / name
    target.parent.mkdir(parents=True, exist_ok=True)
    # A step of k-means: without it shades of one colour are drawn as others.
    picture.quantize(colours, Image.Quantize.MAXCOVERAGE, kmeans=1).save(target, optimize=True)
