"""``sinew serve``: addresses, and starts that are rejected."""

import errno
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from pydantic import ValidationError

from backend.auth import messages as auth_messages
from backend.auth.sessions import Tokens, load_tokens
from backend.cli import main
from backend.cli.server import link
from backend.data_folder import lock_for_service, read_service_address, read_service_addresses
from backend.messages import data_folder_is_a_file, data_folder_not_permitted
from backend.public_url import LOOPBACK, PublicUrl, parse_networks, parse_public_url
from backend.server import messages as server_messages
from backend.server.listening import describe_served_addresses, listening_socket
from backend.settings import Settings
from plant.messages import card_package_not_installed, driver_not_installed, unknown_plant

# The addresses of a service: the public URL, the trusted proxies, the addresses of --host, the links.


@pytest.mark.parametrize(
    ("text", "read", "origin"),
    [
        ("https://rig.lab/sinew/", PublicUrl("https", "rig.lab", 443, "/sinew"), "https://rig.lab"),
        ("HTTPS://Rig.Lab", PublicUrl("https", "rig.lab", 443), "https://rig.lab"),
        ("http://127.0.0.1:18442", PublicUrl("http", "127.0.0.1", 18442), "http://127.0.0.1:18442"),
        ("http://rig.lab:80/a/b", PublicUrl("http", "rig.lab", 80, "/a/b"), "http://rig.lab"),
        ("https://[::1]:8443/", PublicUrl("https", "[::1]", 8443), "https://[::1]:8443"),
    ],
)
def test_a_public_url_is_scheme_host_port_and_prefix(text: str, read: PublicUrl, origin: str) -> None:
    assert parse_public_url(text) == read
    assert read.origin == origin
    assert parse_public_url(f"{read}/") == read


@pytest.mark.parametrize(
    "text",
    [
        "",
        "rig.lab",
        "//rig.lab/",
        "ftp://rig.lab",
        "https://",
        "https://a@rig.lab",
        "https://rig.lab/?x=1",
        "https://rig.lab/#x",
        "https://rig.lab/../x",
        "https://rig.lab/a b",
        "https://rig.lab/%2e",
        "https://rig.lab//x",
        "https://rig.lab:0",
        "https://rig.lab:99999",
        "https://rig.lab:x",
        "https://rig lab",
        "https://rig.lab\r\nX: y",
    ],
)
def test_an_invalid_public_url_is_rejected(text: str) -> None:
    with pytest.raises(ValidationError, match=r"https://rig\.lab/sinew/"):
        Settings(public_url=text)


def test_trusted_proxies_default_to_the_local_computer() -> None:
    alone, named = (
        Settings(public_url="https://rig.lab"),
        Settings(public_url="http://a", trusted_proxies=("10.0.0.0/8",)),
    )
    assert Settings().public is None
    assert alone.public == replace(parse_public_url("https://rig.lab"), proxies=LOOPBACK)
    assert named.public is not None
    assert [named.public.is_trusted_proxy(address) for address in ("10.2.3.4", "127.0.0.1", "::1", "x")] == [
        True,
        False,
        False,
        False,
    ]
    assert parse_networks(["10.0.0.5"])[0].num_addresses == 1


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"trusted_proxies": ("10.0.0.1",)}, "public_url"),
        ({"public_url": "http://a", "trusted_proxies": ("rig.lab",)}, "rig.lab"),
        ({"public_url": "http://a", "trusted_proxies": ("10.0.0.1/8",)}, "host bits"),
        ({"public_url": "http://a", "require_token": False}, "require_token"),
    ],
)
def test_invalid_proxies_and_public_services_without_tokens_are_rejected(
    settings: dict[str, object], named: str
) -> None:
    with pytest.raises(ValidationError, match=named):
        Settings.model_validate(settings)


def test_proxies_in_the_environment_are_separated_by_commas(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SINEW_PUBLIC_URL", "https://rig.lab/sinew")
    monkeypatch.setenv("SINEW_TRUSTED_PROXIES", "10.0.0.5, 10.1.0.0/16")
    assert (Settings().public_url, Settings().trusted_proxies) == (
        "https://rig.lab/sinew/",
        ("10.0.0.5", "10.1.0.0/16"),
    )


@pytest.mark.parametrize(
    ("host", "served", "refused"),
    [("::", ["127.0.0.1", "::1"], []), ("0.0.0.0", ["127.0.0.1"], ["::1"]), ("::1", ["::1"], ["127.0.0.1"])],
)
def test_a_host_serves_the_addresses_that_it_prints(host: str, served: list[str], refused: list[str]) -> None:
    with listening_socket(host, 0) as listening:
        port = listening.getsockname()[1]
        listening.listen()
        for address in served:
            socket.create_connection((address, port), 5).close()
        for address in refused:
            with pytest.raises(ConnectionRefusedError):
                socket.create_connection((address, port), 5)
    text = describe_served_addresses(host)
    assert ("IPv4" in text, "IPv6" in text) == ((True, True) if host != "::1" else (False, False))
    assert ("every IPv6 and IPv4 address" in text) == (host == "::")


def test_links_use_the_public_url_and_the_local_address(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tokens = load_tokens(tmp_path)
    with lock_for_service(tmp_path) as folder:
        folder.write_address("http://127.0.0.1:8000", "https://rig.lab/sinew/")
        assert read_service_address(tmp_path) == "http://127.0.0.1:8000"
        assert read_service_addresses(tmp_path) == ["http://127.0.0.1:8000", "https://rig.lab/sinew/"]
        link(tmp_path)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[-1] for line in lines] == [
        f"https://rig.lab/sinew/?token={tokens.operator}",
        f"https://rig.lab/sinew/?token={tokens.viewer}",
        f"http://127.0.0.1:8000/?token={tokens.operator}",
    ]
    assert read_service_addresses(tmp_path) == []


# A service that cannot start prints one line: the problem, its location, and the remedy.

PORT_IN_WORDS = "valid integer"


def failure_line(words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> str:
    """Return the only line that a failing command prints."""
    monkeypatch.setattr(sys, "argv", ["sinew", *words])
    monkeypatch.setattr("backend.cli.server.NOTICE_DELAY_S", 3600.0)  # on any slow machine
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
        ("PLANT", "toaster", unknown_plant(plant="toaster", installed=()).partition(";")[0]),
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
def test_an_invalid_environment_variable_is_rejected_in_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    name: str,
    value: str,
    words: str,
) -> None:
    monkeypatch.setenv(f"SINEW_{name}", value)
    port = [] if name == "PORT" else ["--port", "0"]
    line = failure_line(["serve", "--data", str(tmp_path), *port], monkeypatch, capsys)
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
        (an_empty_token, lambda data: auth_messages.no_usable_token(file=f"{data}/token")),
        (a_short_token, lambda data: auth_messages.no_usable_token(file=f"{data}/viewer-token")),
        (a_token_of_random_bytes, lambda data: auth_messages.no_usable_token(file=f"{data}/token")),
        (a_folder_for_a_token, lambda _: "token"),
        (an_empty_database, lambda _: "sinew db restore"),
        (something_else_for_a_database, lambda _: "sinew db restore"),
        (a_log_without_its_database, lambda _: "sinew db restore"),
    ],
)
def test_an_invalid_data_folder_is_reported_with_a_remedy(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    breaks: Callable[[Path], None],
    words: Callable[[Path], str],
) -> None:
    breaks(tmp_path)
    before = {path: path.stat().st_size for path in tmp_path.iterdir() if path.is_file()}
    line = failure_line(["serve", "--port", "0", "--data", str(tmp_path)], monkeypatch, capsys)
    assert words(tmp_path) in line
    assert str(tmp_path) in line
    assert {path: path.stat().st_size for path in before} == before


def test_a_data_folder_that_is_a_file_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "data").touch()
    line = failure_line(["serve", "--port", "0", "--data", str(tmp_path / "data")], monkeypatch, capsys)
    assert data_folder_is_a_file(folder=tmp_path / "data") in line


def test_an_unreadable_data_folder_is_reported(tmp_path: Path) -> None:
    closed = tmp_path / "data"
    closed.mkdir(0o000)
    serve = [sys.executable, "-m", "backend", "serve", "--port", "0", "--data", str(closed)]
    if os.geteuid() == 0:  # root loses its access to all files by dropping its capabilities
        assert shutil.which("setpriv"), "this test needs setpriv (util-linux) when root runs it"
        serve = ["setpriv", "--bounding-set", "-dac_override,-dac_read_search", "--inh-caps", "-all", *serve]
    ended = subprocess.run(serve, capture_output=True, text=True, check=False)
    (line,) = ended.stderr.strip().splitlines()
    assert ended.returncode == 1
    denied = data_folder_not_permitted(path=closed, reason=os.strerror(errno.EACCES))
    assert denied.partition(": ")[2] in line
    assert str(closed) in line


def test_a_port_in_use_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        line = failure_line(["serve", "--port", port, "--data", str(tmp_path)], monkeypatch, capsys)
        with pytest.raises(OSError, match=port) as in_use:
            socket.create_server(("127.0.0.1", int(port)))
    reason = str(in_use.value.strerror)
    assert server_messages.cannot_listen(host="127.0.0.1", port=int(port), reason=reason) in line


_WITHOUT_NIDAQMX = "import sys; sys.modules['nidaqmx'] = None; from backend.cli import main; main()"


def test_modules_load_without_the_card_package() -> None:
    """Service, loop process, command line and reports start without NI's package."""
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
        ("plant.safety_card", "numpy"),  # the watchdog is a separate process
        ("plant.interface", "numpy"),
        ("plant.rig", "grpc"),  # only a card on another computer needs it
    ],
)
def test_modules_of_the_plant_load_no_unneeded_packages(module: str, heavy: str) -> None:
    code = f"import sys; import {module}; print({heavy!r} in sys.modules)"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout == "False\n"


@pytest.mark.parametrize(
    ("start", "reason"),
    [
        (["-m", "backend"], driver_not_installed()),
        (["-c", _WITHOUT_NIDAQMX], card_package_not_installed()),
    ],
    ids=["without driver", "without extra"],
)
def test_a_missing_plant_is_reported_in_one_line(tmp_path: Path, start: list[str], reason: str) -> None:
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
def test_allowed_hosts_are_given_with_commas_or_as_json(monkeypatch: pytest.MonkeyPatch, hosts: str) -> None:
    from backend.settings import Settings

    monkeypatch.setenv("SINEW_ALLOWED_HOSTS", hosts)
    assert Settings().allowed_hosts == ("rig.lab", "bench")


@pytest.mark.parametrize(
    ("setting", "words", "shown"),
    [("", [], False), ("", ["--show-link"], True), ("true", [], True), ("true", ["--hide-link"], False)],
)
def test_the_log_has_the_link_only_on_request(
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
