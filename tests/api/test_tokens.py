"""The token files, and where a service goes without them."""

import stat
from pathlib import Path

import pytest

from backend.auth.sessions import TokenError, load_tokens
from backend.settings import Settings


def test_tokens_are_made_once_and_readable_by_their_owner_only(tmp_path: Path) -> None:
    made = load_tokens(tmp_path / "data")
    assert load_tokens(tmp_path / "data") == made
    for name in ("token", "viewer-token"):
        assert stat.S_IMODE((tmp_path / "data" / name).stat().st_mode) == 0o600
    (tmp_path / "data" / "token").chmod(0o644)
    load_tokens(tmp_path / "data")
    assert stat.S_IMODE((tmp_path / "data" / "token").stat().st_mode) == 0o600
    assert made.operator not in repr(made)


def test_an_emptied_token_file_is_refused(tmp_path: Path) -> None:
    load_tokens(tmp_path)
    (tmp_path / "token").write_text("")
    with pytest.raises(TokenError, match="no usable token"):
        load_tokens(tmp_path)


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.4", "::", "lab.example"])
def test_another_address_without_a_token_is_refused(host: str) -> None:
    with pytest.raises(ValueError, match="needs the token"):
        Settings(host=host, require_token=False)
    assert Settings(host=host).host == host


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost"])
def test_this_machine_may_go_without(host: str) -> None:
    assert not Settings(host=host, require_token=False).require_token
