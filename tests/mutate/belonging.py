"""Assign tests to source files: tests that import them directly or indirectly, and all tests that start a service."""

from functools import cache

from tests.conftest import ONLY_COMPUTES, PAGE
from tests.imports import imported
from tests.mutate.trees import ROOT

TESTED_IN = {
    "plant": ("tests/plant", "tests/closed_loop"),
    "backend/control": ("tests/control", "tests/closed_loop", "tests/realtime"),
    "backend/identification": ("tests/identification",),
    "backend/tuning": ("tests/tuning", "tests/closed_loop"),
    "backend/realtime": ("tests/realtime",),
}
"""What is changed, and where it is tested."""


_ELSEWHERE = {"packaging", "mutate"}
"""Packages of tests that need the whole checkout, with its built page and its history; a copy has neither."""


def sources() -> list[str]:
    """Return the mutated source files as paths in the project; files that only the installation runs are excluded."""
    files = [path for package in TESTED_IN for path in sorted((ROOT / package).glob("*.py"))]
    return [str(path.relative_to(ROOT)) for path in files if path.name != "compile_ahead.py"]


def files_of_tests() -> list[str]:
    """Return the files of tests that only compute."""
    names = sorted(ONLY_COMPUTES - _ELSEWHERE)
    folders = [ROOT / "tests" / name for name in names if (ROOT / "tests" / name).is_dir()]
    return [str(path.relative_to(ROOT)) for folder in folders for path in sorted(folder.glob("test_*.py"))]


def reaching(steps: dict[str, int]) -> dict[str, int]:
    """Return the files of computing tests that reach a source file, with their distance in imports.

    ``steps`` has the distances of the modules. Tests that import the file, also by shared modules, have distance 0.
    """
    away = {test: min((steps[m] for m in _imported(test) if m in steps), default=None) for test in files_of_tests()}
    return {test: n for test, n in away.items() if n is not None}


def belonging_to(path: str, away: dict[str, int]) -> list[str]:
    """Return the tests in ``away`` that import a source file directly, or are in the folder of its package."""
    folders = tuple(f"{folder}/" for folder in TESTED_IN[path.rpartition("/")[0]])
    return [test for test, n in away.items() if n == 0 or test.startswith(folders)]


@cache
def live_tests() -> list[str]:
    """Return all files of tests except browser tests: a test that starts a service reaches every source file."""
    files = [file for file in sorted((ROOT / "tests").glob("**/test_*.py")) if not {PAGE, *_ELSEWHERE} & {*file.parts}]
    return [str(file.relative_to(ROOT)) for file in files]


def live_tests_of(path: str) -> list[str]:
    """Return the live tests that import a source file directly, which test its timing and processes."""
    module = path.removesuffix(".py").replace("/", ".")
    return [name for name in live_tests() if module in imported(ROOT / name)]


@cache
def _imported(test: str) -> frozenset[str]:
    seen: set[str] = set()
    open_files = [test]
    while open_files:
        file = open_files.pop()
        for module in imported(ROOT / file):
            if module not in seen:
                seen.add(module)
                shared = module.replace(".", "/") + ".py"
                if module.startswith("tests.") and (ROOT / shared).exists():
                    open_files.append(shared)
    return frozenset(seen)
