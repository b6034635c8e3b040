"""Every route of the interface says what it may cost, and docs/reference/security.md lists those that compute."""

from collections.abc import Iterator
from importlib import import_module
from pkgutil import iter_modules

from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute, APIRouter

from backend.api import dependencies, routers
from backend.api.app import create_app
from backend.api.costs import COSTS, Cost
from backend.reports import sheet
from tests.docs.test_security import PAGE, cells

APPLICATION = create_app()
METHODS = ("get", "put", "post", "delete", "patch", "head", "options", "trace")


def described() -> set[str]:
    """Method and path of each route of the OpenAPI document."""
    paths = APPLICATION.openapi()["paths"]
    return {f"{method.upper()} {path}" for path, item in paths.items() for method in item if method in METHODS}


def calls(dependant: Dependant) -> set[object]:
    return {dependant.call}.union(*(calls(inner) for inner in dependant.dependencies))


def who(route: APIRoute) -> str:
    """Who may ask, by what the route depends on."""
    needed = calls(route.dependant)
    if dependencies._get_actuator_operator in needed:
        return "who is in control"
    if dependencies._get_operator in needed:
        return "operators"
    return (
        "viewers"
        if dependencies._get_signed_in_user in needed or dependencies._get_stop_requester in needed
        else "anybody"
    )


def routes() -> Iterator[APIRoute]:
    """Yield each route of the interface."""
    for found in iter_modules(routers.__path__):
        module = import_module(f"{routers.__name__}.{found.name}")
        for router in (value for value in vars(module).values() if isinstance(value, APIRouter)):
            yield from (route for route in router.routes if isinstance(route, APIRoute))


def asking() -> Iterator[tuple[str, str]]:
    """Yield each route of the interface with who may ask it."""
    for route in routes():
        yield from ((f"{method} {route.path}", who(route)) for method in route.methods or ())


def documented(name: str, cost: Cost, asks: str) -> list[str]:
    time = "" if cost.limits.limit_s is None else f"{cost.limits.limit_s:g} s"
    memory = "" if cost.limits.memory_bytes is None else f"{cost.limits.memory_bytes / 1e9:g} GB"
    return [f"`{name}`", asks, cost.where, time, memory, cost.at_a_time]


def test_each_route_says_what_it_may_cost() -> None:
    assert described() == set(COSTS)


def test_the_page_lists_what_computes_with_its_limits() -> None:
    asks = dict(asking())
    expected = [documented(name, cost, asks[name]) for name, cost in COSTS.items() if cost.is_computation]
    assert cells("### Cost of requests\n", 6) == expected


def test_what_comes_from_a_text_of_a_person_has_limits_and_places() -> None:
    for name in (
        "POST /api/experiments/check",
        "POST /api/experiments/own",
        "GET /api/runs/{id}/planned",
        "POST /api/chart-sheet.pdf",
        "POST /api/experiments/dry-run",
    ):
        cost = COSTS[name]
        assert cost.limits.limit_s is not None, name
        assert cost.limits.memory_bytes is not None, name
        assert "of one person" in cost.at_a_time, name


def test_the_page_has_the_bounds_of_a_sheet() -> None:
    text = " ".join(PAGE.split())
    for bound in (
        f"{sheet.MOST_ELEMENTS} elements",
        f"{sheet.DEEPEST} in each other",
        f"{sheet.MOST_TEXTS} texts",
        f"{sheet.MOST_LETTERS_OF_A_TEXT} letters of a text",
        f"{sheet.MOST_LETTERS} letters in",
        f"{sheet.MOST_OF_A_PATH} characters of a path",
        f"{sheet.MOST_OF_A_TITLE} letters of the title",
    ):
        assert bound in text, bound
