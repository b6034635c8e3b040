"""A service that cannot start says so in one line: what is wrong, where, and what to do about it."""

import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from backend.auth.sessions import Tokens, load_tokens
from backend.cli import main

PORT_IN_WORDS = "valid integer"


def said_by(words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> str:
    """The one line with which a command ends that cannot do its work."""
    monkeypatch.setattr(sys, "argv", ["sinew", *words])
    monkeypatch.setattr("backend.cli.server.NOTICE_DELAY_S", 3600.0)  # however slow the machine is
    with pytest.raises(SystemExit) as ended:
        main()
    printed = capsys.readouterr()
    assert ended.value.code in (1, 2)
    assert printed.out == ""
    (line,) = printed.err.strip().splitlines()
    return line


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("ALLOWED_HOSTS", "http://rig.lab/", "without http://"),
        ("ALLOWED_HOSTS", '["rig.lab"', "rig.lab"),
        ("ALLOWED_HOSTS", "[1, 2]", "SINEW_ALLOWED_HOSTS"),
        ("PLANT", "toaster", "there is no plant toaster: there are simulator, rig and replay"),
        ("PARAMS", "nowhere", "nowhere"),
        ("HOST", "a..b", "a..b"),
        ("PORT", "eight", PORT_IN_WORDS),
        ("PORT", "70000", "65535"),
        ("REQUIRE_TOKEN", "perhaps", "boolean"),
        ("SHOW_LINK", "perhaps", "boolean"),
        ("DATABASE_URL", "junk", "SINEW_DATABASE_URL"),
        ("DATABASE_URL", "mongo://x:secret@y", "SINEW_DATABASE_URL"),
        ("DATABASE_URL", "mysql://x:secret@y/z", "SINEW_DATABASE_URL"),
        ("DATABASE_URL", "postgresql+psycopg://x:secret@127.0.0.1:eight/y", "SINEW_DATABASE_URL"),
        ("DATABASE_URL", "postgresql+psycopg://x:secret@127.0.0.1:1/y", "127.0.0.1"),
        ("DATABASE_URL", "sqlite:////nowhere/x.db", "/nowhere/x.db"),
        ("DATABASE_PASSWORD_FILE", "/nowhere/password", "/nowhere/password"),
    ],
)
def test_every_setting_of_the_environment_is_refused_in_a_sentence(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    name: str,
    value: str,
    words: str,
) -> None:
    monkeypatch.setenv(f"SINEW_{name}", value)
    port = [] if name == "PORT" else ["--port", "0"]
    line = said_by(["serve", "--data", str(tmp_path), *port], monkeypatch, capsys)
    assert words in line
    assert "secret" not in line


def an_empty_token(data: Path) -> None:
    (data / "token").touch()


def a_short_token(data: Path) -> None:
    (data / "viewer-token").write_text("abc\n")


def a_token_of_random_bytes(data: Path) -> None:
    (data / "token").write_bytes(bytes(range(128, 256)))


def a_folder_for_a_token(data: Path) -> None:
    (data / "token").mkdir()


def an_empty_database(data: Path) -> None:
    (data / "sinew.db").touch()


def something_else_for_a_database(data: Path) -> None:
    (data / "sinew.db").write_bytes(b"junk" * 4096)


def a_log_without_its_database(data: Path) -> None:
    (data / "sinew.db-wal").write_bytes(b"junk" * 4096)


@pytest.mark.parametrize(
    ("breaks", "words"),
    [
        (an_empty_token, "token holds no usable token; delete the file"),
        (a_short_token, "viewer-token holds no usable token; delete the file"),
        (a_token_of_random_bytes, "token holds no usable token; delete the file"),
        (a_folder_for_a_token, "token"),
        (an_empty_database, "sinew db restore"),
        (something_else_for_a_database, "sinew db restore"),
        (a_log_without_its_database, "sinew db restore"),
    ],
)
def test_a_broken_data_folder_is_told_with_the_way_back(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    breaks: Callable[[Path], None],
    words: str,
) -> None:
    breaks(tmp_path)
    before = {path: path.stat().st_size for path in tmp_path.iterdir() if path.is_file()}
    line = said_by(["serve", "--port", "0", "--data", str(tmp_path)], monkeypatch, capsys)
    assert words in line
    assert str(tmp_path) in line
    assert {path: path.stat().st_size for path in before} == before


def test_a_data_folder_that_is_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "data").touch()
    line = said_by(["serve", "--port", "0", "--data", str(tmp_path / "data")], monkeypatch, capsys)
    assert f"{tmp_path / 'data'} is a file or" in line


def test_a_data_folder_that_may_not_be_read(tmp_path: Path) -> None:
    closed = tmp_path / "data"
    closed.mkdir(0o000)
    serve = [sys.executable, "-m", "backend", "serve", "--port", "0", "--data", str(closed)]
    if os.geteuid() == 0:  # who owns all files is kept out by dropping what lets root in everywhere
        assert shutil.which("setpriv"), "this test needs setpriv (util-linux) when root runs it"
        serve = ["setpriv", "--bounding-set", "-dac_override,-dac_read_search", "--inh-caps", "-all", *serve]
    ended = subprocess.run(serve, capture_output=True, text=True, check=False)
    (line,) = ended.stderr.strip().splitlines()
    assert ended.returncode == 1
    assert str(closed) in line
    assert "change its owner or mode, or choose another --data" in line


def test_a_port_in_use(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        line = said_by(["serve", "--port", port, "--data", str(tmp_path)], monkeypatch, capsys)
    assert f"cannot listen on 127.0.0.1 port {port}" in line


_WITHOUT_NIDAQMX = "import sys; sys.modules['nidaqmx'] = None; from backend.cli import main; main()"


def test_all_but_a_card_works_without_the_extra() -> None:
    """Service, loop process, command line and reports come up where NI's package is not installed."""
    service = "backend.main, backend.app, backend.realtime.process"
    parts = f"{service}, backend.cli, backend.cli.rig, plant.factory, plant.conformance"
    code = f"import sys; sys.modules['nidaqmx'] = sys.modules['grpc'] = None; import {parts}"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("plant.wiring", "numba"),  # the command line reads its errors before each command
        ("plant.calibration", "numba"),
        ("plant.safety_card", "numpy"),  # the watchdog is a process of its own
        ("plant.interface", "numpy"),
        ("plant.rig", "grpc"),  # only a card at another machine needs it
    ],
)
def test_modules_of_the_plant_load_nothing_that_they_do_not_need(module: str, heavy: str) -> None:
    code = f"import sys; import {module}; print({heavy!r} in sys.modules)"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout == "False\n"


@pytest.mark.parametrize(
    ("start", "reason"),
    [
        (["-m", "backend"], "NI's driver is not on this machine: install NI-DAQmx"),
        (["-c", _WITHOUT_NIDAQMX], "NI's Python package, which is not installed: install Sinew with its extra rig"),
    ],
    ids=["without driver", "without extra"],
)
def test_a_plant_that_is_not_there_is_told_in_one_line(tmp_path: Path, start: list[str], reason: str) -> None:
    ended = subprocess.run(
        [sys.executable, *start, "serve", "--plant", "rig", "--port", "0", "--data", str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    (line,) = ended.stderr.strip().splitlines()
    assert ended.returncode == 1
    assert reason in line


@pytest.mark.parametrize("hosts", ["rig.lab, bench", '["rig.lab", "bench"]'])
def test_further_names_are_given_with_commas_or_as_json(monkeypatch: pytest.MonkeyPatch, hosts: str) -> None:
    from backend.settings import Settings

    monkeypatch.setenv("SINEW_ALLOWED_HOSTS", hosts)
    assert Settings().allowed_hosts == ("rig.lab", "bench")


@pytest.mark.parametrize(
    ("setting", "words", "shown"),
    [("", [], False), ("", ["--show-link"], True), ("true", [], True), ("true", ["--hide-link"], False)],
)
def test_a_log_holds_the_link_only_where_that_was_asked_for(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    setting: str,
    words: list[str],
    shown: bool,
) -> None:
    def answers(_settings: object, ready: Callable[[str, Tokens], None]) -> None:
        ready("http://127.0.0.1:8000", load_tokens(tmp_path))

    monkeypatch.setattr("backend.main.serve", answers)
    monkeypatch.setenv("SINEW_SHOW_LINK", setting)
    monkeypatch.setattr(sys, "argv", ["sinew", "serve", "--data", str(tmp_path), *words])
    with pytest.raises(SystemExit):
        main()
    printed = capsys.readouterr().out
    assert "http://127.0.0.1:8000" in printed
    assert (load_tokens(tmp_path).operator in printed) is shown
    assert shown or "sinew link --data" in printed
