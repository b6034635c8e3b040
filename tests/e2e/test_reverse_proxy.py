"""The page works behind nginx in each configuration of docs/how-to/network.md, and reports wrong configurations."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from backend.data_folder import read_service_address
from tests.e2e.browser import DESKTOP, Watched
from tests.e2e.nginx import CONFIGURATIONS, free_port, nginx
from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import running_service
from tests.e2e.test_scene import PICTURE_TIMEOUT_MS, canvas_of, colours, show_in_3d

SHARED = load_texts("components")

UPGRADE = """        proxy_set_header Upgrade $http_upgrade;
        proxy_set_header Connection "upgrade";
"""


@contextmanager
def behind(
    browser: Browser, folder: Path, configuration: str, path: str = "/", public: bool = True
) -> Iterator[tuple[Operator, Watched]]:
    """Yield an operator who opens the service through nginx; ``path`` is the opened path."""
    port = free_port()
    scheme = "https" if "ssl" in configuration else "http"
    base = f"{scheme}://127.0.0.1:{port}{path}"
    more = ["--public-url", base] if public else []
    data = folder / "data"
    with ExitStack() as up:
        service = up.enter_context(running_service(data, more=more))
        local = read_service_address(data)
        assert local is not None
        up.enter_context(nginx(folder, configuration, port, local))
        proxied = replace(service, url=base.rstrip("/"), link=base + service.link.rpartition("/")[2])
        context = browser.new_context(viewport=DESKTOP, ignore_https_errors=True)
        watched = Watched(context.new_page())
        yield Operator(watched.page, proxied), watched
        context.close()


@pytest.mark.parametrize(
    ("name", "path", "secure"),
    [("plain", "/", False), ("rewritten", "/", False), ("tls", "/", True), ("path", "/sinew/", False)],
)
def test_sign_in_live_stream_3d_view_and_stop_work(
    browser: Browser, tmp_path: Path, name: str, path: str, secure: bool
) -> None:
    with behind(browser, tmp_path, CONFIGURATIONS[name], path) as (operator, watched):
        page = operator.page
        operator.sign_in()
        assert page.url.startswith(f"{operator.service.url}/#")
        (cookie,) = page.context.cookies()
        assert (cookie["secure"], cookie["path"]) == (secure, path)
        expect(page.get_by_role("status", name="Link", exact=True)).to_have_attribute("data-health", "live")
        operator.press("Pretension")
        operator.expect_mode("pretension")
        show_in_3d(page)
        canvas = canvas_of(page, "3D view")
        expect(page.get_by_role("status", name="3D view status")).to_be_empty(timeout=PICTURE_TIMEOUT_MS)
        assert colours(canvas.screenshot()) > 100
        page.get_by_role("button", name="STOP", exact=True).click()
        operator.expect_mode("tripped")
        expect(page.get_by_role("alert", name=SHARED["addressSetup"])).to_have_count(0)
        assert watched.complaints == []
    assert "refused" not in operator.service.log.read_text(encoding="utf-8")


def test_a_changed_host_header_is_reported_on_the_page_and_in_the_log(browser: Browser, tmp_path: Path) -> None:
    with behind(browser, tmp_path, CONFIGURATIONS["plain"], public=False) as (operator, _):
        operator.sign_in()
        said = operator.page.get_by_role("alert", name=SHARED["addressSetup"])
        remedy = f"--public-url {operator.service.url}/"
        expect(said).to_contain_text(remedy)
        expect(said).to_contain_text(SHARED["addressNoStop"])
    log = operator.service.log.read_text(encoding="utf-8")
    assert remedy in log
    assert "refused websocket /api/live" in log
    assert "ASGI" not in log


def test_blocked_websockets_are_reported_on_the_page_and_in_the_log(browser: Browser, tmp_path: Path) -> None:
    without = CONFIGURATIONS["plain"].replace(UPGRADE, "")
    assert without != CONFIGURATIONS["plain"]
    with behind(browser, tmp_path, without) as (operator, _):
        operator.sign_in()
        said = operator.page.get_by_role("alert", name=SHARED["addressSetup"])
        expect(said).to_contain_text("proxy_set_header Upgrade $http_upgrade;")
    assert "proxy_set_header Upgrade" in operator.service.log.read_text(encoding="utf-8")


def test_https_without_a_public_url_is_reported_on_the_page(browser: Browser, tmp_path: Path) -> None:
    with behind(browser, tmp_path, CONFIGURATIONS["tls"], public=False) as (operator, _):
        operator.sign_in()
        said = operator.page.get_by_role("alert", name=SHARED["addressSetup"])
        expect(said).to_contain_text(f"--public-url {operator.service.url}/")
        expect(operator.page.get_by_role("status", name="Link", exact=True)).to_have_attribute("data-health", "live")


def test_an_unknown_path_prefix_is_reported_instead_of_the_page(browser: Browser, tmp_path: Path) -> None:
    kept = CONFIGURATIONS["path"].replace("http://127.0.0.1:8000/", "http://127.0.0.1:8000")
    assert kept != CONFIGURATIONS["path"]
    with behind(browser, tmp_path, kept, "/sinew/", public=False) as (operator, _):
        answer = operator.page.goto(operator.service.link)
        assert answer is not None
        assert answer.status == 404
        expect(operator.page.get_by_role("main")).to_contain_text("--public-url")


def test_a_path_prefix_that_the_proxy_does_not_strip_is_removed(browser: Browser, tmp_path: Path) -> None:
    kept = CONFIGURATIONS["path"].replace("http://127.0.0.1:8000/", "http://127.0.0.1:8000")
    with behind(browser, tmp_path, kept, "/sinew/") as (operator, watched):
        operator.sign_in()
        expect(operator.page.get_by_role("status", name="Link", exact=True)).to_have_attribute("data-health", "live")
        assert watched.complaints == []
