"""The command line where terminal, environment or data folder are unusual."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from backend.cli.options import load_settings
from backend.storage import runs
from backend.storage.database import FILE_NAME, Database, open_database
from plant.parameters import ParameterError, load_parameters
from plant.wiring import WiringError, load_wiring
from tests.storage.test_lineage import NEW_RUN

SINEW = str(Path(sys.executable).with_name("sinew"))
SHIPPED = Path(__file__).parents[2] / "plant"


def sinew(*words: str, before: tuple[str, ...] = (), **environment: str) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(
        [*before, SINEW, *words], env={**os.environ, **environment}, capture_output=True, check=False, timeout=300
    )


@pytest.mark.parametrize("encoding", ["latin-1", "cp1252", "ascii", "utf-8"])
def test_a_terminal_without_the_character_gets_its_escape(encoding: str, tmp_path: Path) -> None:
    ended = sinew("experiments", "text", "lambda_sweep", "--data", str(tmp_path), PYTHONIOENCODING=encoding)
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert ("λ" if encoding == "utf-8" else "\\u03bb") in ended.stdout.decode(encoding)


@pytest.mark.parametrize("words", [("doctor",), ("serve", "--port", "0"), ("experiment", "tracking")])
def test_numba_told_to_compile_nothing_is_refused_in_a_line(words: tuple[str, ...], tmp_path: Path) -> None:
    ended = sinew(*words, "--data", str(tmp_path / "data"), NUMBA_DISABLE_JIT="1")
    assert ended.returncode == 1
    (line,) = ended.stderr.decode().splitlines()
    assert "NUMBA_DISABLE_JIT" in line
    assert not (tmp_path / "data").exists()


def test_a_tilde_that_no_shell_has_replaced_is_the_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("SINEW_DATA", "~/x")
    assert load_settings().data == tmp_path / "x"
    assert load_settings(data=Path("~/y")).data == tmp_path / "y"


@pytest.mark.parametrize("name", ["what?mode=ro", "50%20", "a#b", "a b&c=d", "[ü]", "sqlite:", "?", "file:x"])
def test_the_database_lies_in_the_folder_whatever_that_is_called(tmp_path: Path, name: str) -> None:
    folder = tmp_path / name
    with_run(folder)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    database = open_database(folder)
    assert database.file == folder.resolve() / FILE_NAME
    again, arguments = database.__reduce__()
    other: Database = again(*arguments)
    with other.reading() as session:
        assert [run.id for run in runs.find(session)] == [1]
    other.close()
    database.close()


def with_run(folder: Path) -> None:
    database = open_database(folder)
    with database.session() as session:
        runs.create(session, NEW_RUN)
    database.close()


def test_a_read_only_data_folder_is_told_with_a_remedy(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    with_run(folder)
    folder.chmod(0o500)
    (folder / FILE_NAME).chmod(0o400)
    before: tuple[str, ...] = ()
    if os.geteuid() == 0:  # who may write everywhere gives that up
        assert shutil.which("setpriv"), "this test needs setpriv (util-linux) when root runs it"
        before = ("setpriv", "--bounding-set", "-dac_override", "--inh-caps", "-all")
    ended = sinew("runs", "list", "--data", str(folder), before=before)
    folder.chmod(0o700)
    assert ended.returncode == 1
    (line,) = ended.stderr.decode().splitlines()
    assert str(folder) in line
    assert "read-only" in line
    assert "--data" in line


def test_80_columns_show_the_whole_moment_at_which_a_run_began(tmp_path: Path) -> None:
    with_run(tmp_path)
    database = open_database(tmp_path)
    with database.reading() as session:
        began = runs.get(session, 1).started_at
    database.close()
    ended = sinew("runs", "list", "--data", str(tmp_path), COLUMNS="80", PYTHONIOENCODING="utf-8")
    assert f"{began:%Y-%m-%d %H:%M}" in ended.stdout.decode()


def test_parameters_and_wirings_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    for read, shipped in ((load_parameters, "lab"), (load_wiring, "pcie-6323")):
        (source,) = SHIPPED.rglob(f"{shipped}.toml")
        file = tmp_path / source.name
        file.write_bytes(b"\xef\xbb\xbf" + source.read_bytes())
        assert read(file) == read(shipped)


def test_a_file_with_a_name_that_no_run_could_keep_is_refused(tmp_path: Path) -> None:
    file = tmp_path / f"{'x' * 201}.toml"
    file.write_text("")
    with pytest.raises(ParameterError, match=r"201 characters, 200 are the most"):
        load_parameters(file)
    with pytest.raises(WiringError, match=r"201 characters, 200 are the most"):
        load_wiring(file)
