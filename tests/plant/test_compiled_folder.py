"""Where machine code is kept: for an account with a home, without one, and where nothing can be written."""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from backend.storage import events
from backend.storage.database import open_database

STRANGER = 54_321
"""Number of an account that is in no password file."""
SHOWS = """
import subprocess, sys
from plant import compilation

@compilation.compiled
def more(x):
    return x + 1.0

assert more(1.0) == 2.0
print(compilation.CACHE, flush=True)
if sys.argv[1:]:
    subprocess.run([sys.executable, __file__], check=True)
"""


def as_stranger() -> Sequence[str]:
    """Return what runs a program as an account without name or home, who may read all and write nothing.

    Only root can become another account; elsewhere the tests' own account takes its place.
    """
    if os.geteuid() != 0:
        return ()
    numbers = (f"--reuid={STRANGER}", f"--regid={STRANGER}", "--clear-groups")
    return ("setpriv", *numbers, "--inh-caps=+dac_read_search", "--ambient-caps=+dac_read_search")


@pytest.fixture
def open_folder(tmp_path: Path) -> Path:
    """A folder where every account may write."""
    folder = tmp_path / "open"
    folder.mkdir()
    folder.chmod(0o777)
    return folder


@pytest.fixture
def closed(tmp_path: Path) -> Path:
    """A path where no folder can be made, by root neither."""
    file = tmp_path / "closed"
    file.write_text("")
    return file / "below"


@pytest.fixture
def program(tmp_path: Path) -> Path:
    """A file with a compiled function, that prints where its code is kept."""
    file = tmp_path / "shows.py"
    file.write_text(SHOWS)
    return file


def kept_in(program: Path, *words: str, **environment: object) -> tuple[list[str], list[str]]:
    """Return the lines that a process, and with ``words`` one that it starts, prints and says."""
    given = {"PATH": os.environ["PATH"], **{name: str(value) for name, value in environment.items()}}
    ended = subprocess.run(
        [*as_stranger(), sys.executable, str(program), *words], env=given, cwd="/", capture_output=True, text=True
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout.splitlines(), ended.stderr.splitlines()


def test_the_cache_of_the_account_is_used_without_a_word(program: Path, open_folder: Path) -> None:
    (folder,), said = kept_in(program, HOME=open_folder)
    assert Path(folder).parent == open_folder / ".cache" / "sinew"
    assert said == []
    (folder,), said = kept_in(program, HOME=open_folder, XDG_CACHE_HOME=open_folder / "other")
    assert (Path(folder).parent, said) == (open_folder / "other" / "sinew", [])


def test_a_folder_named_for_numba_comes_first(program: Path, open_folder: Path) -> None:
    (folder,), said = kept_in(program, HOME=open_folder, NUMBA_CACHE_DIR=open_folder / "named")
    assert (Path(folder).parent, said) == (open_folder / "named", [])


def test_the_data_folder_takes_its_place_and_one_line_says_so(program: Path, open_folder: Path, closed: Path) -> None:
    data = open_folder / "data"
    data.mkdir(mode=0o777)
    data.chmod(0o777)
    found, said = kept_in(program, "both", HOME=closed, SINEW_CACHE_FALLBACK=data)
    assert {Path(folder).parent for folder in found} == {data / "cache"}
    assert len(found) == 2
    assert len(said) == 1
    assert str(data / "cache") in said[0]


def test_a_temporary_folder_of_the_account_comes_after_it(program: Path, open_folder: Path, closed: Path) -> None:
    found, said = kept_in(
        program, "both", HOME=closed, TMPDIR=open_folder, SINEW_CACHE_FALLBACK=open_folder / "missing"
    )
    (place,) = {Path(folder).parent for folder in found}
    assert place.parent == open_folder
    assert place.stat().st_mode & 0o077 == 0
    assert len(said) == 1
    assert str(place) in said[0]
    assert not (open_folder / "missing").exists()


def test_code_that_another_account_could_have_put_there_is_not_run(
    program: Path, open_folder: Path, closed: Path
) -> None:
    user = STRANGER if os.geteuid() == 0 else os.geteuid()
    place = open_folder / f"sinew-{user}"
    place.mkdir()
    place.chmod(0o777)
    (folder,), _ = kept_in(program, HOME=closed, TMPDIR=open_folder)
    assert folder == "None"


def test_without_any_folder_it_stays_in_memory_and_one_line_says_so(
    program: Path, closed: Path, open_folder: Path
) -> None:
    place = open_folder / f"sinew-{STRANGER if os.geteuid() == 0 else os.geteuid()}"
    place.write_text("a file where the folder would be")
    found, said = kept_in(program, "both", HOME=closed, TMPDIR=open_folder)
    assert found == ["None", "None"]
    assert len(said) == 1
    assert "NUMBA_CACHE_DIR" in said[0]


def by_stranger(folder: Path, *words: str) -> str:
    """Return what a command prints that an account without name and home gives."""
    sinew = str(Path(sys.executable).with_name("sinew"))
    ended = subprocess.run(
        [*as_stranger(), sinew, *words, "--data", str(folder / "data")],
        env={"PATH": os.environ["PATH"], "TMPDIR": str(folder), "PYTHONIOENCODING": "utf-8"},
        cwd="/",
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def test_an_account_without_name_and_home_is_recorded_by_its_number(open_folder: Path) -> None:
    by_stranger(open_folder, "db", "backup")
    database = open_database(open_folder / "data")
    with database.reading() as session:
        (event,) = events.find(session)
    database.close()
    if os.geteuid() == 0:
        assert event.who == str(STRANGER)
    by_stranger(open_folder, "doctor")


def test_an_account_without_name_and_home_plays_an_experiment(open_folder: Path) -> None:
    words = ["experiment", "sequence", "--set", 'segments=[{"duration_s": 0.5, "q_ref": 0.0, "S_ref": 10}]']
    assert "completed" in by_stranger(open_folder, *words)


HITS = SHOWS + "\nprint(sum(more.stats.cache_hits.values()), sum(more.stats.cache_misses.values()))\n"


def test_what_an_image_has_compiled_is_copied_and_not_compiled_again(program: Path, open_folder: Path) -> None:
    program.write_text(HITS)
    (folder, first), said = kept_in(program, XDG_CACHE_HOME=open_folder / "image")
    assert (first, said) == ("0 1", [])
    prepared = Path(folder).parent
    (prepared / "figures-1.json").write_text("{}")
    (copied, second), said = kept_in(program, XDG_CACHE_HOME=open_folder / "volume", SINEW_CACHE_PREPARED=prepared)
    assert (second, said) == ("1 0", [])
    assert Path(copied).parent == open_folder / "volume" / "sinew"
    assert (Path(copied).parent / "figures-1.json").read_text() == "{}"
    _, third = kept_in(program, XDG_CACHE_HOME=open_folder / "other", SINEW_CACHE_PREPARED=open_folder / "nowhere")[0]
    assert third == "0 1"
