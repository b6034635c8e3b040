"""Which tests `make test` leaves to `make test-thorough`: those that `thorough.toml` names, with the reasons.

Both run on the same tree with the same lanes. The first is what each change passes, the second what each version does:
more cases of what the first has tried once.
"""

import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

LISTED = Path(__file__).with_name("thorough.toml")


@dataclass(frozen=True)
class Left:
    """Tests that are left out, why, and those of them that are not.

    A test is named by its file, by file and function, or by its whole name with parameters, as pytest writes it.
    """

    tests: tuple[str, ...]
    because: str
    but: tuple[str, ...] = ()

    def names(self, test: str) -> bool:
        return _among(test, self.tests) and not _among(test, self.but)


@cache
def left_out() -> tuple[Left, ...]:
    """Return what is left out, in the order of the file."""
    listed = tomllib.loads(LISTED.read_text(encoding="utf-8"))["left"]
    return tuple(Left(tuple(each["tests"]), each["because"], tuple(each.get("but", ()))) for each in listed)


def is_thorough(test: str) -> bool:
    """Return whether a test, by its whole name, is left out."""
    return any(left.names(test) for left in left_out())


def whole_files() -> set[str]:
    """Return the files of which nothing is run: they need not even be imported."""
    return {name for left in left_out() for name in left.tests if "::" not in name} - {
        name.partition("::")[0] for left in left_out() for name in left.but
    }


def renamed(there: set[str]) -> list[str]:
    """Return names with parameters that a whole run did not find, though it has others of the same function."""
    functions = {test.partition("[")[0] for test in there}
    named = {name for left in left_out() for name in (*left.tests, *left.but) if "[" in name}
    return sorted(name for name in named - there if name.partition("[")[0] in functions)


def _among(test: str, names: tuple[str, ...]) -> bool:
    return any(test == name or test.startswith((f"{name}::", f"{name}[")) for name in names)
