"""What was computed once for a tuning outlives the process: a start neither loads python-control nor computes anew.

A file beside the compiled functions, named after the sources and the libraries that compute: with others it is another
file. Whoever finds it damaged, or of another form, computes anew.
"""

import hashlib
import json
import logging
import sys
from importlib.metadata import version
from pathlib import Path

from backend.data_folder import write_private
from backend.tuning.robustness import FIGURES
from plant.compiled import CACHE

_SOURCES = ("plant/*.py", "backend/control/*.py", "backend/tuning/*.py")
_LIBRARIES = ("numpy", "scipy", "control", "numba")
_ROOT = Path(__file__).resolve().parents[2]
_log = logging.getLogger(__name__)


class KeptFigures:
    """The file of ``remembered.FIGURES`` in a ``folder``, that of caches where none is given; None without either."""

    def __init__(self, folder: Path | None = None) -> None:
        place = folder or (None if CACHE is None else CACHE.parent)
        self.file = None if place is None else place / f"figures-{_digest_of_what_computes()[:16]}.json"
        self._kept: dict[str, tuple[float, ...]] = {}

    def restore(self) -> None:
        """Remember what is kept, if it can be read."""
        if self.file is None:
            return
        try:
            self._kept = _read(self.file.read_text(encoding="ascii"))
        except FileNotFoundError:
            return
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
            _log.warning("%s cannot be used, its figures are computed anew: %s", self.file, error)
            return
        FIGURES.update(self._kept)

    def keep(self) -> None:
        """Write down what is remembered, where that is not what the file holds; a disk that refuses is no matter."""
        present = dict(FIGURES)
        if self.file is None or present == self._kept:
            return
        content = {key: list(figures) for key, figures in present.items()}
        try:
            self.file.parent.mkdir(parents=True, exist_ok=True)
            write_private(self.file, json.dumps({"figures": content, "digest": _digest(content)}))
        except OSError as error:
            _log.info("%s cannot be written, the next start takes longer: %s", self.file, error)
        else:
            self._kept = present


def _read(text: str) -> dict[str, tuple[float, ...]]:
    """Return the figures of a file. Raises ValueError and its like where it is damaged."""
    document = json.loads(text)
    content = document["figures"]
    if document["digest"] != _digest(content):
        raise ValueError("its digest is another one")
    return {str(key): tuple(map(float, figures)) for key, figures in content.items()}


def _digest(content: object) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _digest_of_what_computes() -> str:
    digest = hashlib.sha256(sys.version.encode())
    for library in _LIBRARIES:
        digest.update(f"{library} {version(library)} ".encode())
    for pattern in _SOURCES:
        for source in sorted(_ROOT.glob(pattern)):
            digest.update(source.read_bytes())
    return digest.hexdigest()
