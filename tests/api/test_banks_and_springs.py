"""Motors and springs ordered through the interface; banks compared, taken out and brought in."""

import httpx
import numpy as np
import pytest

from tests.api.conftest import problem
from tests.api.test_orders import finished

SWEEP = {"kind": "spring", "F_high": 30.0, "sweep_s": 3.0, "cycles": 1, "settle_s": 0.5}
FILE = {
    "name": "from elsewhere",
    "entries": [
        {"S_nominal": 10.55, "K_q": 0.05, "T_q": 0.342, "K_S": 0.7209, "T_S": 0.342, "tension_N": 20.0},
        {"S_nominal": 12.43, "K_q": 0.05, "T_q": 0.36, "K_S": 0.7209, "T_S": 0.342, "tension_N": 30.0},
    ],
}


def table(count: int = 40) -> str:
    x = np.linspace(8.0, 60.0, count)
    F = -2.498 + 0.33149 * x + 8.5438e-3 * x**2
    return "x [mm],F [N]\n" + "\n".join(f"{a:.4f},{b:.4f}" for a, b in zip(x, F, strict=True))


def test_what_motors_and_springs_will_do_is_told_before(operator: httpx.Client) -> None:
    motor = operator.post("/api/identifications/prediction", json={"kind": "motor"}).json()
    figures = {figure["name"]: figure["value"] for figure in motor["figures"]}
    assert motor["enough_motion"]
    assert figures["omega_max"] == pytest.approx(2.86 * 5.0, rel=0.02)
    assert motor["F_low"] == 0.0
    assert "nothing holds it while the tendons are slack" in motor["message"]
    spring = operator.post("/api/identifications/prediction", json={"kind": "spring"}).json()
    figures = {figure["name"]: figure["value"] for figure in spring["figures"]}
    assert figures["x_max"] == pytest.approx(0.0577, abs=5e-4)
    several = operator.post("/api/identifications/prediction", json={"tensions_N": [10, 20, 30, 40]}).json()
    one = operator.post("/api/identifications/prediction", json={"tension_N": 20}).json()
    assert several["F_min_N"] < one["F_min_N"]
    # 40 N is where the joint goes furthest: q = r_m θ_A / (2 r_j), and both springs are stretched by 53.8 mm.
    assert several["q_high"] == pytest.approx(0.05 * (2.0 * 53.8 / 7.5 + 1.0 + 1.0), abs=0.03)
    assert one["q_high"] < several["q_high"] - 0.2
    assert several["duration_s"] > 4.0 * 28.32


def test_what_would_leave_the_range_is_told_before_and_refused_at_the_start(off: httpx.Client) -> None:
    order = {"tension_N": 42.0, "amplitude_rad": 2.0, "chip_s": 0.5, "bits": 5, "periods": 1}
    told = off.post("/api/identifications/prediction", json=order).raise_for_status().json()
    assert not told["within_range"]
    assert not told["enough_motion"]
    refused = problem(off.post("/api/identifications", json=order))
    assert (refused["quantity"], refused["maximum"], refused["unit"]) == ("tension on the way", 50.0, "N")
    assert refused["message"] == told["message"]
    assert off.get("/api/state").json()["mode"] == "off"


@pytest.mark.parametrize(
    ("order", "said"),
    [
        ({"kind": "motor", "u_high": 12.0}, "u_high"),
        ({"kind": "motor", "u_low": 6.0}, "u_low"),
        ({"kind": "spring", "F_high": 60.0}, "F_high"),
        ({"tensions_N": [20.0, 70.0]}, "tension_N"),
        ({"kind": "gearbox"}, "kind"),
        ({"kind": "motor", "tension_N": 20.0}, "tension_N"),
    ],
)
def test_orders_out_of_bounds_are_refused(operator: httpx.Client, order: dict[str, object], said: str) -> None:
    refused = operator.post("/api/identifications", json=order)
    assert refused.status_code == 422
    assert said in str(problem(refused))


def test_a_sweep_gives_both_springs_and_their_curves(off: httpx.Client) -> None:
    run = off.post("/api/identifications", json=SWEEP).raise_for_status().json()["id"]
    view = finished(off, f"/api/identifications/{run}")
    assert view["status"] == "completed", view["message"]
    assert (view["kind"], view["usable"], view["G_q"], view["motors"]) == ("spring", True, None, [])
    springs = view["springs"]
    assert isinstance(springs, list)
    assert [spring["name"] for spring in springs] == ["A", "B"]
    assert springs[0]["fits"][0]["k"][2] == pytest.approx(8543.8, rel=0.01)
    curves = off.get(f"/api/identifications/{run}/curves").raise_for_status().json()
    assert [len(curves[name]) for name in ("channels", "motors", "springs")] == [0, 0, 2]
    drawn = curves["springs"][0]
    assert len(drawn["x"]) == len(drawn["F"]) == len(drawn["orders"][0]["errors"])
    assert off.get(f"/api/runs/{run}/report.html").status_code == 200


def test_a_table_becomes_a_spring(operator: httpx.Client) -> None:
    made = operator.post("/api/spring-tables", json={"name": "actuator.csv", "table": table()})
    assert made.status_code == 201, made.text
    view = made.json()
    assert (view["file"], view["usable"], view["spring"]["recommended"]) == ("actuator.csv", True, 2)
    assert view in operator.get("/api/spring-tables").json()["tables"]
    assert operator.get(f"/api/spring-tables/{view['id']}").json() == view
    curves = operator.get(f"/api/spring-tables/{view['id']}/curves").json()
    assert len(curves["springs"][0]["x"]) == 40
    refused = operator.post("/api/spring-tables", json={"name": "bad.csv", "table": table(3)})
    assert refused.status_code == 422
    assert "more points" in str(problem(refused)["message"])


def test_what_was_read_of_a_table_is_told_and_options_resolve_what_is_not_clear(operator: httpx.Client) -> None:
    words = table().replace(",", ";").replace(".", ",").replace("\n", ";ok\n").replace("F [N];ok", "F [N];note")
    view = operator.post("/api/spring-tables", json={"name": "own.csv", "table": f"bench 4\n{words};ok"}).json()
    read = view["read"]
    assert (read["x_unit"], read["F_unit"], read["rows"], read["heading_line"]) == ("mm", "N", 40, 2)
    assert (read["separator"], read["decimal_mark"], read["lines_above_heading"]) == ("semicolon", "comma", 1)
    assert [column["name"] for column in read["not_read"]] == ["note"]
    assert view["spring"]["fits"][0]["k"][2] == pytest.approx(8543.8, rel=1e-2)
    assert operator.get(f"/api/spring-tables/{view['id']}").json() == view

    doubtful = "x [mm];F [N]\n" + "\n".join(f"{8 + at},125;{1 + at},250" for at in range(20))
    refused = problem(operator.post("/api/spring-tables", json={"name": "own.csv", "table": doubtful}))
    assert (refused["code"], refused["path"], refused["line"]) == ("ambiguous_decimals", ["decimal"], 2)
    told = {"name": "own.csv", "table": doubtful, "decimal": "comma"}
    assert operator.post("/api/spring-tables", json=told).status_code == 201

    two = "x [mm],F [N]\nlower,upper\n" + "\n".join(table().splitlines()[1:])
    refused = problem(operator.post("/api/spring-tables", json={"name": "own.csv", "table": two}))
    assert (refused["code"], refused["path"]) == ("ambiguous_heading", ["header"])
    made = operator.post("/api/spring-tables", json={"name": "own.csv", "table": two, "header": 1})
    assert made.json()["read"]["rows"] == 40


def test_a_bank_is_brought_in_compared_and_taken_out(operator: httpx.Client, viewer: httpx.Client) -> None:
    made = operator.post("/api/banks/file", json=FILE)
    assert made.status_code == 201, made.text
    bank = made.json()
    assert [entry["identification"] for entry in bank["entries"]] == [None, None]
    taken = viewer.get(f"/api/banks/{bank['id']}/file").raise_for_status().json()
    assert taken["entries"] == FILE["entries"]
    again = operator.post("/api/banks/file", json={**taken, "name": "again"}).json()

    detail = viewer.get(f"/api/banks/{bank['id']}/detail").raise_for_status().json()
    first = detail["entries"][0]
    assert first["lineage"] is None
    lam = operator.get("/api/tuning").json()["lam_q"]
    assert first["figures"]["position"]["k_p"] == pytest.approx(max((2 * 0.342 - lam) / lam, 0.0), abs=1e-6)
    assert 1.0 < first["figures"]["position"]["M_s"] < 1.7

    same = viewer.get(f"/api/banks/{bank['id']}/difference", params={"other": again["id"]}).json()
    assert all(change["before"] == change["after"] for change in same["entries"])
    against = viewer.get("/api/banks/in-use/difference", params={"other": bank["id"]}).raise_for_status().json()
    assert any(change["after"] is not None for change in against["entries"])
    assert viewer.get(f"/api/banks/{bank['id']}/difference").status_code == 422
    assert viewer.post("/api/banks/file", json=FILE).status_code == 403

    wrong = {**FILE, "entries": [{**FILE["entries"][0], "K_q": 0.09}]}  # type: ignore[dict-item] # JSON
    refused = operator.post("/api/banks/file", json=wrong)
    assert refused.status_code == 422
    assert "geometry" in str(problem(refused)["message"])
