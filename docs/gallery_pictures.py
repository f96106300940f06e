"""Small copies, in docs/gallery, of the pictures of demos/output that docs/gallery.md shows.

Those in docs/gallery/page_1 are made here: page 1 of the report on structures of tests/eight.py.
"""

import re
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from fenics_contact import limit_load
from fenics_contact.output.report.page import write_report

DOCS = Path(__file__).resolve().parent
WIDTH, COLOURS = 680, 128  # pixels; for small files

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


shutil.rmtree(DOCS / "gallery", ignore_errors=True)
for name in re.findall(r"!\[[^]]*\]\(gallery/([^)]+)\)", (DOCS / "gallery.md").read_text()):
    folder, _, stem = name.removesuffix(".png").rpartition("/")
    page = folder == "page_1"
    if page:
        picture = first_page(stem.replace("_", " "))
        picture.thumbnail((PAGE, 2 * PAGE))
    else:
        picture = Image.open(DOCS.parent / "demos" / "output" / name).convert("RGB")
        picture.thumbnail((WIDTH, WIDTH))
    colours = PAGE_COLOURS if page else COLOURS
    target = DOCS / "gallery" / name
    target.parent.mkdir(parents=True, exist_ok=True)
    # A step of k-means: without it shades of one colour are drawn as others.
    picture.quantize(colours, Image.Quantize.MAXCOVERAGE, kmeans=1).save(target, optimize=True)
