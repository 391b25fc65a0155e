"""Make the pictures of docs/gallery.md by running the code of that page; its PNGs become small WebPs in docs/gallery.

Needs the extra ``[video]`` and a Chromium. `python scripts/gallery.py FOLDER` writes into another folder.
"""

import os
import re
import shutil
import tempfile
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE, OUT = DOCS / "gallery.md", DOCS / "gallery"
LONGEST, QUALITY = 900, 82  # pixels, and of WebP of 100


def main(out: Path = OUT) -> list[Path]:
    """Run the page in an empty folder, and return the pictures written."""
    text, out = PAGE.read_text(encoding="utf-8"), Path(out).resolve()
    out.mkdir(parents=True, exist_ok=True)
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        for line in re.findall(r"<!-- files: (.+) -->", text):
            for name in line.split(", "):
                shutil.copy(DOCS.parent / name, folder)
        os.chdir(folder)
        try:
            exec(compile("\n".join(blocks(text)), str(PAGE), "exec"), {"__name__": "gallery"})  # our own page's code
            return [smaller(picture, out) for picture in sorted(Path().glob("*.png"))]
        finally:
            os.chdir(before)


def blocks(text: str) -> list[str]:
    """The page's programs, in its order."""
    return re.findall(r"^```python\n(.*?)^```", text, re.M | re.S)


def smaller(picture: Path, out: Path) -> Path:
    """A PNG as a WebP of the size that a page shows."""
    image = Image.open(picture).convert("RGB")
    image.thumbnail((LONGEST, LONGEST), Image.Resampling.LANCZOS)
    path = out / f"{picture.stem}.webp"
    image.save(path, quality=QUALITY, method=6)
    print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB")
    return path


if __name__ == "__main__":
    from arguments import run

    run(main, __doc__)
