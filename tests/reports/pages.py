"""Images of the pages of a report's PDF, by the engine, template and inputs of the PDF."""

import io
from typing import Any

import numpy as np
import typst
from matplotlib.image import imread

from backend.reports.model import Report
from backend.reports.pdf import fonts, typeset

HEIGHT_MM, TOP_MM, BOTTOM_MM = 297.0, 22.0, 277.0
"""Of a page, and where its text begins and ends."""


def filled_shares(report: Report) -> list[float]:
    """Return the printed share of the text height of each page, without its largest empty part.

    A page with content at the bottom and an empty middle is not full.
    """
    template, inputs = typeset(report)
    made: Any = typst.compile(template, format="png", ppi=40, font_paths=fonts(), sys_inputs=inputs)
    return [filled_share(picture) for picture in (made if isinstance(made, list) else [made])]


def filled_share(picture: bytes) -> float:
    grey: Any = imread(io.BytesIO(picture))[..., :3].mean(axis=2)
    first, last = (round(grey.shape[0] * edge / HEIGHT_MM) for edge in (TOP_MM, BOTTOM_MM))
    printed = np.flatnonzero((grey[first:last] < 0.9).any(axis=1))
    if printed.size == 0:
        return 0.0
    edges = np.concatenate([[-1], printed, [last - first]])
    return 1.0 - (int(np.diff(edges).max()) - 1) / int(last - first)
