"""The reachable map: a click sends both references at once, and the joint goes there."""

from tests.e2e.operator import Operator


def test_a_click_sets_both_references(operator: Operator) -> None:
    operator.sign_in()
    operator.be_in_run()
    chart = operator.page.get_by_role("img", name="Reachable map", exact=True)
    box = chart.bounding_box()
    assert box is not None
    chart.click(position={"x": 0.6 * box["width"], "y": 0.5 * box["height"]})
    operator.wait(lambda: operator.reading("Joint position", "q_ref") > 5.0)
    q_ref = operator.reading("Joint position", "q_ref")
    assert 8.0 < operator.reading("Joint stiffness", "S_ref") < 15.0
    operator.wait(lambda: abs(operator.reading("Joint position", "q") - q_ref) < 0.5)
