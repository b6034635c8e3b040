"""Screenshots for the documents, taken from a running service: ``python -m tests.e2e.screenshots [FOLDER]``.

Each page in each state of the service at 1440x900; the most important states also in dark mode and at three more
sizes. The data are recorded in real time. The pictures are lossless WebP with few colours, so the folder is small.
"""

import io
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import Page, ViewportSize

from tests.e2e.browser import DESKTOP, TABLET, chromium
from tests.e2e.looks.journey import journey
from tests.e2e.service import running_service
from tests.e2e.test_accessibility import PHONE

FOLDER = Path(__file__).parents[2] / "docs" / "screenshots"
SUFFIX = ".webp"
WIDE = ViewportSize(width=1920, height=1080)
SHOTS = {"dark": (DESKTOP, "dark"), "tablet": (TABLET, "light"), "phone": (PHONE, "light"), "wide": (WIDE, "dark")}
"""What is taken beside the light picture at the usual size, by the end of its name: size and scheme."""

FURTHER = {
    "": (),
    "-viewer": ("dark",),
    **dict.fromkeys(
        ("-tripped", "-running", "-no-answer", "-result", "flight", "sign-in"), ("dark", "tablet", "phone")
    ),
    **dict.fromkeys(("-run", "runs-compared"), ("dark", "tablet", "phone", "wide")),
}
"""Which of them, by how the name of the state ends; of several ends the last one in the list counts."""

FREQUENT, RARE = 24, 40
"""Colours of areas, kept as they are, and of lines, chosen to cover all hues."""


def main() -> None:
    """Take all screenshots and delete those of pages that no longer exist."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for old in [*folder.glob("*.png"), *folder.glob(f"*{SUFFIX}")]:
        old.unlink()

    def look(page: Page, name: str) -> None:
        page.emulate_media(color_scheme="light")
        take(page, folder / f"{name}-light{SUFFIX}")
        further = [words for end, words in FURTHER.items() if name.endswith(end)][-1]
        for words in further:
            size, scheme = SHOTS[words]
            page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
            page.set_viewport_size(size)
            take(page, folder / f"{name}-{words}{SUFFIX}")
        page.set_viewport_size(DESKTOP)
        page.emulate_media(color_scheme="null")

    with tempfile.TemporaryDirectory() as data, running_service(Path(data)) as service, chromium() as browser:
        journey(browser, service, look)
    total = sum(path.stat().st_size for path in folder.glob(f"*{SUFFIX}"))
    print(f"{total / 1e6:.2f} MB in {folder}")


def take(page: Page, path: Path) -> None:
    """Store a screenshot of the page after it has been drawn."""
    page.evaluate("new Promise(drawn => requestAnimationFrame(() => requestAnimationFrame(drawn)))")
    path.write_bytes(compact(page.screenshot()))
    print(path.name)


def compact(png: bytes) -> bytes:
    """Reduce a picture to its most frequent colours and encode it as lossless WebP."""
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    colours, counts = np.unique(np.asarray(picture).reshape(-1, 3), axis=0, return_counts=True)
    areas = colours[np.argsort(-counts)[:FREQUENT]].ravel().tolist()
    lines = picture.quantize(RARE, method=Image.Quantize.MAXCOVERAGE).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette([*areas, *lines[: 3 * RARE]])
    few = picture.quantize(palette=palette, dither=Image.Dither.NONE)
    written = io.BytesIO()
    few.convert("RGB").save(written, "WEBP", lossless=True, quality=100, method=4)
    return written.getvalue()


if __name__ == "__main__":
    main()
