"""A person gives a name once; nobody gets the name of somebody who is there, however it is written."""

import httpx
import pytest

from backend.auth.authentication import BEARER, ActiveUsers, User
from backend.auth.control_lease import CONTROL_HEADER
from backend.errors import RequestRejectedError
from backend.schemas.session import Role
from plant.errors import ErrorCode
from tests.e2e.service import Service


def newcomer(session: str, role: Role = Role.OPERATOR) -> User:
    return User(str(role), role, session, str(role))


def test_a_link_asks_for_a_name_once_and_keeps_session_and_control(service: Service) -> None:
    with httpx.Client(base_url=service.url, follow_redirects=True) as browser:
        browser.get(service.link)
        assert browser.get("/api/session").json() == {"name": "operator", "role": "operator", "asks_name": True}
        lease = browser.post("/api/control", json={"take_over": True}).raise_for_status().json()
        assert browser.put("/api/session/name", json={"name": "Ana\u202e Lund"}).status_code == 422
        named = browser.put("/api/session/name", json={"name": " Ana  Lund "}).raise_for_status().json()
        assert named == {"name": "Ana Lund", "role": "operator", "asks_name": False}
        assert browser.get("/api/state").json()["holder"]["name"] == "Ana Lund"
        browser.get(service.link)  # the link again, in the same browser
        assert browser.get("/api/session").json() == named
        # Who signs out without that holds control until it is lost, and scripts of other tests may command nothing.
        browser.delete("/api/control", headers={CONTROL_HEADER: f"{lease['page']}.1"}).raise_for_status()
        kept = dict(browser.cookies)
        browser.delete("/api/session").raise_for_status()
        assert httpx.get(f"{service.url}/api/session", cookies=kept).status_code == 401


def test_a_script_has_no_name_to_give(operator: httpx.Client) -> None:
    assert operator.put("/api/session/name", json={"name": "Ana"}).status_code == 409


@pytest.mark.parametrize("name", ["Ana", "ana", "\uff21na", " A\u200bna "], ids=["same", "small", "wide", "hidden"])
def test_nobody_gets_the_name_of_somebody_who_is_there(name: str) -> None:
    people = ActiveUsers()
    ana = people.rename(newcomer("1"), "Ana")
    with people.connect(ana, is_page=True):
        other = people.rename(newcomer("2"), name)
        assert other.name.casefold() == "ana (2)"
        assert people.rename(newcomer("3", Role.VIEWER), name).name.casefold() == "ana (viewer)"
    assert people.rename(newcomer("2"), "Ana").name == "Ana"


def test_marks_that_tell_persons_apart_cannot_be_typed() -> None:
    for pretended in ("Ana (2)", "Ana \uff082\uff09", "Ana \u2475"):
        assert "(" not in ActiveUsers().rename(newcomer("1"), pretended).name


@pytest.mark.parametrize("name", ["operator", "Viewer", " ", "()", "\u202e"])
def test_what_is_no_name_is_refused(name: str) -> None:
    with pytest.raises(RequestRejectedError) as refused:
        ActiveUsers().rename(newcomer("1"), name)
    assert refused.value.category is ErrorCode.BAD_VALUE


def test_all_pages_of_a_person_are_counted_under_the_new_name() -> None:
    people, somebody, vic = ActiveUsers(), newcomer("1"), newcomer("2", Role.VIEWER)
    pages = [people.connect(somebody, is_page=is_page) for is_page in (True, True, False)]
    with pages[0], pages[1], pages[2], people.connect(vic, is_page=True):
        people.rename(somebody, "Ana")
        seen = [(one.name, one.role, one.pages) for one in people.view()]
    assert seen == [("Ana", Role.OPERATOR, 2), ("viewer", Role.VIEWER, 1)]
    assert people.view() == []


def test_somebody_has_been_there_since_the_first_of_their_pages_came() -> None:
    people, ana = ActiveUsers(), newcomer("1")
    with people.connect(ana, is_page=True):
        first = people.view()[0].since
        with people.connect(ana, is_page=True):
            assert people.view()[0].since == first
    with people.connect(ana, is_page=True):
        assert people.view()[0].since > first


def test_who_comes_back_while_another_has_their_name_is_told_apart_from_them() -> None:
    people = ActiveUsers()
    ana = people.rename(newcomer("1"), "Ana")
    other = people.rename(newcomer("2"), "Ana")  # while the first was away
    assert ana.name == other.name
    with people.connect(other, is_page=True):
        back = people.resolve_returning(ana)
        assert (back.name, back.session) == ("Ana (2)", "1")
        with people.connect(back, is_page=True):
            assert people.resolve_returning(ana) == back  # as long as they are there, in whatever they do
            assert people.resolve_returning(other) == other
    script = User("operator", Role.OPERATOR, BEARER)
    assert people.resolve_returning(script) == script


def test_a_script_keeps_the_name_of_its_role() -> None:
    with pytest.raises(RequestRejectedError) as refused:
        ActiveUsers().rename(User("operator", Role.OPERATOR, BEARER), "Ana")
    assert refused.value.category is ErrorCode.NOT_NOW
