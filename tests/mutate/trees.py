"""Copies of the project for mutants, with the machine code that is still valid after a change.

A compiled function contains the functions that it calls, also from other files. A changed file therefore invalidates
the code of all modules that import it, directly or indirectly; the remaining code is taken from the unchanged copy.
Nothing is shared: each mutant has its own folder for compiled code.
"""

import importlib
import multiprocessing
import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

import numba
import pytest
from numba.core.caching import _CacheLocator

from tests.imports import module_graph

ROOT = Path(__file__).parents[2]
COMPILED = (
    "plant",
    *(f"backend/{package}" for package in ("control", "identification", "tuning", "realtime")),
)
"""Where compiled functions stand."""

AT_MOST = 10.0
"""Times its limit of processor time that a run may last: what waits for something that never comes takes none."""

MOST_BYTES = 6 * 1024**3
"""Of memory: what takes more and more of it fails before the machine does."""


def tracked() -> list[str]:
    """Return the files of the project, including uncommitted ones."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True, text=True)
    return sorted(name for name in listed.stdout.split("\0") if (ROOT / name).is_file())


class Imports:
    """The imports between the modules of the project."""

    def __init__(self) -> None:
        self._graph = module_graph()

    def steps_to(self, path: str) -> dict[str, int]:
        """Return the distance of modules to a file in imports: itself 0, its importers 1, their importers 2."""
        here = path.removesuffix(".py").replace("/", ".").removesuffix(".__init__")
        steps, last = {here: 0}, {here}
        while last:
            last = {above for module in last for above in self._graph.find_modules_that_directly_import(module)} - set(
                steps
            )
            steps |= dict.fromkeys(last, max(steps.values()) + 1)
        return steps

    def touched_by(self, path: str) -> set[str]:
        """Return the file and its direct and indirect importers, as paths."""
        return {f"{module.replace('.', '/')}.py" for module in self.steps_to(path)}


class Tree:
    """A copy of the project at ``root``, with its compiled code."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.cache = root.with_name(f"{root.name}-compiled")

    def bring_up_to_date(self, files: Iterable[str]) -> None:
        """Copy the files that differ from the project, with their time stamps; delete removed ones."""
        wanted = set(files)
        for path in [path for path in self.root.rglob("*.py") if str(path.relative_to(self.root)) not in wanted]:
            path.unlink()
        for name in wanted:
            here, there = ROOT / name, self.root / name
            if not there.exists() or there.read_bytes() != here.read_bytes():
                there.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(here, there)
        self.cache.mkdir(exist_ok=True)

    @contextmanager
    def changed(self, path: str, text: str) -> Iterator[None]:
        """Replace the content of a file temporarily, with its compiled code removed."""
        file = self.root / path
        kept, times = file.read_bytes(), file.stat()
        shutil.rmtree(self.cache, ignore_errors=True)
        file.write_text(text, encoding="utf-8")
        os.utime(file, (times.st_atime, times.st_mtime + 10.0))  # Python compares time stamps in seconds
        try:
            yield
        finally:
            file.write_bytes(kept)
            os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))

    def take_over(self, base: "Tree", code_of_base: Path, touched: Collection[str]) -> None:
        """Take the compiled code of files that are not touched from the base; in the current process."""
        importlib.import_module("plant.compilation")
        target = Path(numba.config.CACHE_DIR)  # type: ignore[attr-defined]  # numba fills this module at run time
        for sources in (
            "plant",
            "backend/control",
            "backend/identification",
            "backend/tuning",
            "backend/realtime",
        ):
            old, new = (
                folder / _CacheLocator.get_suitable_cache_subpath(str(tree.root / sources / "any.py"))  # type: ignore[no-untyped-call]  # private of numba
                for tree, folder in ((base, code_of_base), (self, target))
            )
            untouched = [f.stem for f in (self.root / sources).glob("*.py") if f"{sources}/{f.name}" not in touched]
            new.mkdir(parents=True, exist_ok=True)
            for code in old.glob("*.nb?"):
                if code.name.split(".")[0] in untouched:
                    shutil.copy2(code, new)

    def run(self, command: list[str], limit_s: float) -> str:
        """Return the output of Python in this copy. Raises subprocess.SubprocessError."""
        environment = os.environ | {"PYTHONPATH": str(self.root), "XDG_CACHE_HOME": str(self.cache)}
        ended = subprocess.run(
            [sys.executable, *command], cwd=self.root, env=environment, capture_output=True, text=True, check=True,
            timeout=limit_s,
        )  # fmt: skip
        return ended.stdout

    def test(
        self, arguments: list[str], limit_s: float, base: "Tree | None" = None, touched: Collection[str] = ()
    ) -> tuple[int | None, str]:
        """Run pytest in this copy; return its exit code and output; the code is None after a timeout.

        ``limit_s`` is processor time, so that a busy machine causes no timeout.

        Compiled code of files that are not ``touched`` is taken from the base.
        """
        taken = None if base is None else (base, _code_of(base), touched)
        said = self.root.with_name(f"{self.root.name}.txt")
        said.write_text("", encoding="utf-8")
        process = _SERVER.Process(target=_pytest, args=(self, arguments, said, limit_s, taken))
        process.start()
        process.join(AT_MOST * limit_s)
        code, group = process.exitcode, process.pid
        assert group
        with suppress(ProcessLookupError):
            os.killpg(group, signal.SIGKILL)
        process.kill()
        process.join()
        return None if code == -signal.SIGXCPU else code, said.read_text(encoding="utf-8", errors="replace")

    def enter(self) -> None:
        """Make the current process run in this copy: loaded modules of the project are removed."""
        os.chdir(self.root)
        os.environ |= {"PYTHONPATH": str(self.root), "XDG_CACHE_HOME": str(self.cache), "PYTHONDONTWRITEBYTECODE": "1"}
        sys.dont_write_bytecode = True
        sys.path[:] = [str(self.root), *(path for path in sys.path if path not in ("", str(ROOT)))]
        for name in [name for name in sys.modules if name.partition(".")[0] in ("tests", "plant", "backend")]:
            del sys.modules[name]


_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(["numpy", "scipy.optimize", "scipy.signal", "numba", "control", "hypothesis", "pytest"])
"""Loading these takes longer than most mutants live: a process that has them is copied for each."""


def _pytest(
    tree: Tree, arguments: list[str], said: Path, limit_s: float, taken: tuple[Tree, Path, Collection[str]] | None
) -> None:
    os.setsid()
    resource.setrlimit(resource.RLIMIT_CPU, (round(limit_s), round(limit_s) + 5))
    resource.setrlimit(resource.RLIMIT_DATA, (MOST_BYTES, MOST_BYTES))
    with said.open("w") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    tree.enter()
    if taken is not None:
        tree.take_over(*taken)
    sys.exit(pytest.main(arguments))


@cache
def _code_of(tree: Tree) -> Path:
    """Return the folder of the compiled code of a copy; determined once."""
    return Path(tree.run(["-c", "import numba, plant.compilation; print(numba.config.CACHE_DIR)"], 120.0).strip())
