"""A service below a URL path: its redirects stay there, and its page can check the path to it."""

import asyncio
from collections.abc import Iterator
from urllib.parse import urljoin

import httpx
import pytest
from websockets.exceptions import InvalidStatus
from websockets.typing import Origin

from backend.data_folder import read_service_addresses
from tests.api.conftest import problem
from tests.api.patient import connect
from tests.e2e.service import Service, running_service

PUBLIC = "https://rig.lab/sinew/"
ASKED = {"Host": "rig.lab", "Origin": "https://rig.lab"}


@pytest.fixture(scope="module")
def below(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    data = tmp_path_factory.mktemp("below")
    # the link of the public URL comes first; this test uses the local address
    with running_service(data, params="ideal", more=["--public-url", PUBLIC]) as running:
        yield running


def local(service: Service) -> str:
    address, public = read_service_addresses(service.data)
    assert public == PUBLIC
    return address


@pytest.mark.parametrize("prefix", ["", "/sinew"], ids=["taken off", "left on"])
def test_sign_in_and_all_redirects_stay_below_the_path(below: Service, prefix: str) -> None:
    token = (below.data / "token").read_text().strip()
    with httpx.Client(base_url=local(below) + prefix, headers=ASKED) as browser:
        answer = browser.get("/", params={"token": token})
        assert urljoin("https://rig.lab/sinew/?token=x", answer.headers["location"]) == PUBLIC
        assert {"Secure", "Path=/sinew/", "HttpOnly"} <= set(answer.headers["set-cookie"].split("; "))
        known = {"Authorization": f"Bearer {token}"}
        for asked, led in (("api/docs", "docs.html"), ("scene", "scene/"), ("scene?a=1", "scene/?a=1")):
            location = browser.get(f"/{asked}", headers=known).headers["location"]
            assert urljoin(PUBLIC + asked, location) == PUBLIC + led
        assert browser.get("/api/openapi.json", headers=known).json()["servers"] == [{"url": "/sinew"}]
        assert browser.get("/").status_code == 200


def test_a_page_can_check_whether_its_commands_would_be_rejected(below: Service) -> None:
    with httpx.Client(base_url=local(below)) as browser:

        def asked(page: str, **headers: str) -> httpx.Response:
            return browser.post("/api/page-address", json={"url": page}, headers={**ASKED, **headers})

        assert asked(PUBLIC).raise_for_status().json() == {"problems": []}
        (found,) = asked("https://rig.lab/").raise_for_status().json()["problems"]
        assert found["code"] == "other_prefix"
        refused = asked("https://other.lab/", Origin="https://other.lab")
        assert (refused.status_code, problem(refused)["code"]) == (403, "foreign_origin")


@pytest.mark.parametrize("path", ["/api/live", "/sinew/api/live"])
def test_only_websockets_of_the_public_page_are_accepted(below: Service, path: str) -> None:
    token = (below.data / "token").read_text().strip()
    url = local(below).replace("http", "ws") + path
    known = {
        "Authorization": f"Bearer {token}"
    }  # under the address of the service, as through a proxy that rewrites Host

    async def come_in(origin: str) -> None:
        async with connect(url, additional_headers=known, origin=Origin(origin)):
            pass

    asyncio.run(come_in("https://rig.lab"))
    with pytest.raises(InvalidStatus) as refused:
        asyncio.run(come_in("http://rig.lab"))
    assert refused.value.response.status_code == 403
