"""A formula from its form to the live charts: the page computes the same values as the service."""

import math

from playwright.sync_api import expect

from tests.api.conftest import client_with
from tests.e2e.operator import Operator
from tests.e2e.sharing import bring_to_run, sign_in_at


def test_a_saved_formula_is_drawn_in_the_chart_of_its_unit(operator: Operator) -> None:
    page, service = operator.page, operator.service
    bring_to_run(service)
    sign_in_at(page, service, "operate")
    page.get_by_role("button", name="Edit layout", exact=True).click()
    form = page.get_by_role("form", name="Formula", exact=True)
    for label, text in (("Name", "F_mean"), ("Expression (signals in SI)", "(F_A + F_B) / 2"), ("SI unit", "N")):
        form.get_by_label(label, exact=True).fill(text)
    form.get_by_role("button", name="Save formula", exact=True).click()
    formulas = page.get_by_role("region", name="Formulas", exact=True)
    expect(formulas).to_contain_text("F_mean = (F_A + F_B) / 2")
    page.get_by_label("Add a signal to Tendon force", exact=True).select_option("F_mean")
    operator.wait(lambda: not math.isnan(operator.reading("Tendon force", "F_mean")))

    def is_mean() -> bool:
        a, b, mean = (operator.reading("Tendon force", name) for name in ("F_A", "F_B", "F_mean"))
        return abs(mean - (a + b) / 2) < 0.5  # readings of successive samples

    operator.wait(is_mean)
    with client_with(service, "token") as script:
        (told,) = script.get("/api/formulas").raise_for_status().json()["formulas"]
    assert (told["name"], told["expression"], told["unit"]) == ("F_mean", "(F_A + F_B) / 2", "N")
