"""Small copies, in docs/gallery, of the pictures of demos/output that docs/gallery.md shows."""

import re
import shutil
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).resolve().parent
WIDTH, COLOURS = 680, 128  # pixels; for small files

shutil.rmtree(DOCS / "gallery", ignore_errors=True)
for name in re.findall(r"!\[[^]]*\]\(gallery/([^)]+)\)", (DOCS / "gallery.md").read_text()):
    picture = Image.open(DOCS.parent / "demos" / "output" / name).convert("RGB")
    picture.thumbnail((WIDTH, WIDTH))
    target = DOCS / "gallery" / name
    target.parent.mkdir(parents=True, exist_ok=True)
    # A step of k-means: without it shades of one colour are drawn as others.
    picture.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=1).save(target, optimize=True)
