"""Makes docs/gallery.md and its pictures: runs the demos, and shows what they wrote.

`python3 docs/make_gallery.py` runs all demos (about two minutes); with `--no-run` it takes what
they wrote before.
"""

import ast
import subprocess
import sys
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).resolve().parent
DEMOS = DOCS.parent / "demos"
#: Width of a picture, pixels, and its number of colours: small files.
WIDTH, COLOURS = 720, 48

#: Pictures of every demo, below demos/output.
SHOWN = {
    "01_tilting_table": [
        "tilting_table/friction_0.2/collapse",
        "tilting_table/friction_0.8/collapse",
    ],
    "02_stack": ["stack/friction_0.7/collapse"],
    "03_wall_w3": ["w3/collapse", "w3/stress", "w3/capacity"],
    "04_six_lines": ["six_lines/thrust"],
    "05_arch": ["arch/collapse", "arch/thrust"],
    "06_wedge": ["wedge/friction_0.3/collapse"],
    "07_both_directions": ["buttress/towards/collapse", "buttress/towards/collapse_negative"],
    "08_methods": ["methods/auto_work/collapse"],
}

HEAD = """# Gallery

Every demo checks its numbers against a value known from elsewhere, and writes all files of a result
into `demos/output`. `make gallery` runs them all and makes this page. Run one with
`python3 demos/05_arch.py`.
"""


def described(path: Path) -> tuple[str, str]:
    """First line of a demo's docstring, and the rest of it."""
    first, _, rest = (ast.get_docstring(ast.parse(path.read_text())) or "").partition("\n")
    return first.rstrip("."), rest.strip()


def shrunk(source: Path, target: Path) -> None:
    """A small copy of a picture."""
    picture = Image.open(source).convert("RGB")
    picture.thumbnail((WIDTH, WIDTH))
    target.parent.mkdir(exist_ok=True)
    picture.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(
        target, optimize=True
    )


def entry(path: Path) -> str:
    """What the gallery says of a demo; its pictures are made."""
    title, text = described(path)
    lines = [f"## {title}", text, f"Program: [{path.name}](../demos/{path.name})"]
    for name in SHOWN[path.stem]:
        picture = Path("gallery") / f"{name.replace('/', '_')}.png"
        shrunk(DEMOS / "output" / f"{name}.png", DOCS / picture)
        lines.append(f"![{title}: {name.split('/')[-1].replace('_', ' ')}]({picture})")
    return "\n\n".join(filter(None, lines))


def main() -> None:
    """Run the demos, unless told otherwise, and write the page."""
    demos = sorted(DEMOS.glob("[0-9]*.py"))
    if "--no-run" not in sys.argv:
        for path in demos:
            print(path.name, flush=True)
            subprocess.run([sys.executable, path], check=True, stdout=subprocess.DEVNULL)
    for old in (DOCS / "gallery").glob("*.png"):
        old.unlink()
    (DOCS / "gallery.md").write_text("\n\n".join([HEAD.strip(), *map(entry, demos)]) + "\n")


if __name__ == "__main__":
    main()
