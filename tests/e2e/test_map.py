"""The map of reachable states: a click selects both references, and only a button sends them."""

from playwright.sync_api import expect

from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts

OPERATE = load_texts("pages/operate")


def test_a_click_on_the_map_sets_the_target_and_a_button_sends_it(operator: Operator) -> None:
    operator.sign_in()
    operator.be_in_run()
    chart = operator.page.get_by_role("img", name=OPERATE["map"], exact=True)
    box = chart.bounding_box()
    assert box is not None
    chart.click(position={"x": 0.6 * box["width"], "y": 0.5 * box["height"]})
    target = operator.page.get_by_role("group", name=OPERATE["mapTarget"], exact=True)
    expect(target).to_contain_text("not sent yet")
    operator.wait_for_samples(200)
    assert abs(operator.reading("Joint position", "q_ref")) < 5.0
    operator.press(OPERATE["sendTarget"])
    operator.wait(lambda: operator.reading("Joint position", "q_ref") > 5.0)
    expect(target).to_be_hidden()
    q_ref = operator.reading("Joint position", "q_ref")
    assert 8.0 < operator.reading("Joint stiffness", "S_ref") < 15.0
    operator.wait(lambda: abs(operator.reading("Joint position", "q") - q_ref) < 0.5)
