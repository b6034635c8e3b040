"""Run the tests of one mutant."""

import hashlib
import json
import re
import threading
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from tests.mutate.belonging import belonging_to, live_tests, live_tests_of, reaching
from tests.mutate.mutants import Mutant
from tests.mutate.trees import ROOT, Imports, Tree

PYTEST = ["-x", "-q", "-rfE", "--tb=no", "-p", "no:schemathesis", "-p", "no:cacheprovider"]
PURE, LIVE = ("-m", "not live"), ("-m", "live and not page")
NO_TESTS = 5
EVERY = 1000
"""Imports between a file and a test; no test is further away."""

FIRST = 3
"""Files of tests that most mutants do not outlive: to load the others takes longer."""

BATCH = 12
"""Files of tests that share one limit of processor time: all that reach a file may rightly take longer than it."""

_FAILED = r"^(?:FAILED|ERROR) (([^\s:]+)\S*)"
SURVIVED, HUNG = "survived", "hung"


class Memory:
    """Results of earlier runs in a file: durations of tests without changes, and detected mutants."""

    def __init__(self, path: Path) -> None:
        self._path, self._lock = path, threading.Lock()
        self._known: dict[str, float | str] = json.loads(path.read_text("utf-8")) if path.exists() else {}

    def get(self, key: str) -> float | str | None:
        return self._known.get(key)

    def put(self, key: str, value: float | str) -> None:
        with self._lock:
            self._known[key] = value
            self._path.write_text(json.dumps(self._known, indent=1), encoding="utf-8")


def digest(files: Iterable[str]) -> str:
    """Return a value that identifies the state of some files."""
    content = b"".join(name.encode() + (ROOT / name).read_bytes() for name in sorted(files))
    return hashlib.sha256(content).hexdigest()[:16]


class Trials:
    """Trials of mutants: ``base`` is the unchanged copy, in which the durations are measured."""

    def __init__(self, base: Tree, memory: Memory, sources: str, limit_s: float, most_steps: int) -> None:
        self._base, self._memory, self._sources = base, memory, sources
        self._limit_s, self._most_steps = limit_s, most_steps
        self._imports, self._lock = Imports(), threading.Lock()

    def verdict(self, mutant: Mutant, tree: Tree) -> str:
        """Return the test that detected a mutant, or that it survived. Raises ValueError if a test fails without it."""
        text = (ROOT / mutant.path).read_text(encoding="utf-8")
        with tree.changed(mutant.path, mutant.of(text)):
            for some, lane in self._stages(mutant.path):
                for begin in range(0, len(some), BATCH):
                    batch = some[begin : begin + BATCH]
                    if killed_by := self._killed_by(batch, lane, tree, self._imports.touched_by(mutant.path)):
                        return killed_by
        return SURVIVED

    def _stages(self, path: str) -> Iterator[tuple[list[str], tuple[str, ...]]]:
        """Yield the tests that can reach a file, the near and fast ones first, with their lane."""
        steps = self._imports.steps_to(path)
        away = {test: n for test, n in reaching(steps).items() if n <= self._most_steps}
        near = belonging_to(path, away)
        tests = sorted(away, key=lambda test: (test not in near, away[test], self._seconds(test)))
        yield tests[:FIRST], PURE
        yield tests[FIRST : len(near)], PURE
        own = live_tests_of(path)
        yield own, LIVE
        yield tests[max(FIRST, len(near)) :], PURE
        if self._most_steps == EVERY:
            yield [test for test in live_tests() if test not in own], LIVE

    def _killed_by(self, tests: list[str], lane: tuple[str, ...], tree: Tree, touched: set[str]) -> str:
        code, said = tree.test([*PYTEST, *lane, *tests], self._limit_s, self._base, touched)
        if lane is LIVE and code not in (0, NO_TESTS):  # a failure caused by a busy machine does not repeat
            failed = re.search(_FAILED, said, re.MULTILINE)
            again = tests if failed is None else [failed[1]]
            code, said = tree.test([*PYTEST, *again], self._limit_s, self._base, touched)
        if code is None:
            self._require_within_limit(tests, lane)
            return f"{HUNG} for {self._limit_s:.0f} s"
        if code in (0, NO_TESTS):
            return ""
        failed = re.search(_FAILED, said, re.MULTILINE)
        if failed is None:
            return f"exit code {code}: {said[-300:]}"
        self._require_green(failed[2], lane)
        return failed[1]

    def _require_green(self, test: str, lane: tuple[str, ...]) -> None:
        with self._lock:
            if self._memory.get(self._key(test)) is None:
                begun = time.monotonic()
                code, said = self._base.test([*PYTEST, *lane, test], self._limit_s)
                if code not in (0, NO_TESTS):
                    raise ValueError(f"{test} fails with nothing changed:\n{said}")
                self._memory.put(self._key(test), time.monotonic() - begun)

    def _require_within_limit(self, tests: list[str], lane: tuple[str, ...]) -> None:
        """Raise ValueError if these tests exceed the limit without a mutant."""
        with self._lock:
            code, _ = self._base.test([*PYTEST, *lane, *tests], self._limit_s)
        if code is None:
            raise ValueError(f"{' '.join(tests)} take longer than {self._limit_s:.0f} s with nothing changed")

    def _seconds(self, test: str) -> float:
        """Return the duration of a file of tests; unknown ones are estimated as one second per 1000 characters."""
        return float(self._memory.get(self._key(test)) or len((ROOT / test).read_bytes()) / 1e3)

    def _key(self, test: str) -> str:
        return f"{test} {digest([test])} on {self._sources}"
