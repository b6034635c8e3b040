"""Pictures for the documentation, taken from the running system: ``python -m tests.e2e.screenshots [FOLDER]``.

Each page in each state of the service, in the light and in the dark, and on a phone where its layout is another one;
all data are made on the way, in real time. The pictures have the colours that a page needs, no more: they are kept
with the sources.
"""

import io
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page

from tests.e2e.browser import DESKTOP, chromium
from tests.e2e.looks.journey import journey
from tests.e2e.service import running_service
from tests.e2e.test_accessibility import PHONE

FOLDER = Path(__file__).parents[2] / "docs" / "screenshots"
ON_A_PHONE = ("-idle", "-running", "-run", "-tripped", "-result", "flight", "runs-compared", "sign-in")
"""Pages whose name ends like this are taken on a phone too."""

COLOURS = 256


def main() -> None:
    """Take all pictures; those of pages that are no more go."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.png"):
        old.unlink()

    def look(page: Page, name: str) -> None:
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
            take(page, folder / f"{name}-{scheme}.png")
        page.emulate_media(color_scheme="light")
        if name.endswith(ON_A_PHONE):
            page.set_viewport_size(PHONE)
            take(page, folder / f"{name}-phone.png")
            page.set_viewport_size(DESKTOP)
        page.emulate_media(color_scheme="null")

    with tempfile.TemporaryDirectory() as data, running_service(Path(data)) as service, chromium() as browser:
        journey(browser, service, look)


def take(page: Page, path: Path) -> None:
    """Keep what the page shows, once it has been drawn."""
    page.evaluate("new Promise(drawn => requestAnimationFrame(() => requestAnimationFrame(drawn)))")
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    few = picture.quantize(COLOURS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    few.save(path, optimize=True)
    print(path.name)


if __name__ == "__main__":
    main()
