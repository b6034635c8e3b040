"""The addresses of a service: the public one, the proxies that are trusted, what --host serves, the links."""

import socket
from dataclasses import replace
from pathlib import Path

import pytest
from pydantic import ValidationError

from backend.auth.sessions import load_tokens
from backend.cli.server import link
from backend.data_folder import lock_for_service, read_service_address, read_service_addresses
from backend.public_url import LOOPBACK, PublicUrl, parse_networks, parse_public_url
from backend.server.listening import describe_served_addresses, listening_socket
from backend.settings import Settings


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
def test_what_is_no_public_url_is_refused(text: str) -> None:
    with pytest.raises(ValidationError, match=r"https://rig\.lab/sinew/"):
        Settings(public_url=text)


def test_proxies_are_those_of_this_machine_unless_others_are_named() -> None:
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
def test_proxies_that_cannot_be_trusted_and_open_doors_are_refused(settings: dict[str, object], named: str) -> None:
    with pytest.raises(ValidationError, match=named):
        Settings.model_validate(settings)


def test_proxies_are_given_with_commas_in_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
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
def test_what_a_host_serves_is_what_it_says(host: str, served: list[str], refused: list[str]) -> None:
    with listening_socket(host, 0) as listening:
        port = listening.getsockname()[1]
        listening.listen()
        for address in served:
            socket.create_connection((address, port), 5).close()
        for address in refused:
            with pytest.raises(ConnectionRefusedError):
                socket.create_connection((address, port), 5)
    said = describe_served_addresses(host)
    assert ("IPv4" in said, "IPv6" in said) == ((True, True) if host != "::1" else (False, False))
    assert ("over IPv6 and IPv4" in said) == (host == "::")


def test_the_links_are_those_of_the_public_url_and_of_this_machine(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
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
