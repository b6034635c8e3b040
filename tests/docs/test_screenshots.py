"""The screenshots of the documents are small enough for the repository."""

import io

import numpy as np
from PIL import Image, ImageDraw

from tests.e2e.screenshots import FOLDER, FREQUENT, RARE, compact

MOST_BYTES = 4_000_000


def test_the_total_size_of_the_screenshots_is_limited() -> None:
    total = sum(path.stat().st_size for path in FOLDER.iterdir())
    assert total <= MOST_BYTES, f"{total / 1e6:.1f} MB: take them anew with make screenshots"


def test_compression_retains_size_and_sharp_edges_with_few_colours() -> None:
    drawn = Image.new("RGB", (640, 400), "#f6f7f9")
    pen = ImageDraw.Draw(drawn)
    for hue in range(200):
        pen.rectangle((3 * hue, 300, 3 * hue + 2, 400), fill=(hue, 255 - hue, 128))
    pen.text((20, 20), "STOP 12.5 V", fill="#111111")
    png = io.BytesIO()
    drawn.save(png, "PNG")
    kept = Image.open(io.BytesIO(compact(png.getvalue())))
    assert kept.size == drawn.size
    pixels = np.asarray(kept.convert("RGB"))
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) <= FREQUENT + RARE
    assert pixels[:40, :120].max(axis=2).min() < 60  # the pixels of the text
