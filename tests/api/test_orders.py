"""Identifications, banks and springs through the interface."""

from io import BytesIO
from typing import Any

import httpx
import numpy as np
import pytest
from pyarrow import parquet

from tests.api.conftest import problem, until

# Identification, bank, experiment and report through the interface, in real time but short.

SHORT = {"q_duration_s": 0.5, "S_duration_s": 0.5, "lam_q": 0.5}


def finished(client: httpx.Client, path: str) -> dict[str, Any]:
    """Poll until the run has ended and has its result."""

    def over() -> bool:
        view = client.get(path).raise_for_status().json()
        return view["status"] != "running" and client.get("/api/state").raise_for_status().json()["task"] is None

    until(over)
    return dict(client.get(path).raise_for_status().json())


def test_an_identification_gives_models_and_a_bank_that_the_loop_uses(off: httpx.Client) -> None:
    order = {"tension_N": 20.0, "bits": 6, "settle_s": 2.0}
    started = off.post("/api/identifications", json=order)
    assert started.status_code == 202
    run = started.json()["id"]
    second = off.post("/api/experiments", json={"name": "tracking"})
    assert second.status_code == 409
    assert problem(second)["message_code"] == "run_prevents_start"
    assert str(run) in str(problem(second)["message"])
    view = finished(off, f"/api/identifications/{run}")
    assert view["status"] == "completed", view["message"]
    G_q = view["G_q"]
    assert isinstance(G_q, dict)
    assert G_q["K"] == pytest.approx(0.05, rel=0.03)
    assert G_q["gain_geometry"] == pytest.approx(0.05)

    bank = off.post("/api/banks", json={"name": "test", "identifications": [run]})
    assert bank.status_code == 201, bank.text
    made = bank.json()
    assert [entry["identification"] for entry in made["entries"]] == [run]
    assert not made["active"]
    assert off.post(f"/api/banks/{made['id']}/activate").json()["active"]
    assert off.get("/api/tuning").json()["bank"]["id"] == made["id"]
    listed = off.get("/api/banks").json()["banks"]
    assert [item["id"] for item in listed if item["active"]] == [made["id"]]


def test_the_service_accepts_exactly_the_range_that_the_form_offers(off: httpx.Client) -> None:
    kinds = off.get("/api/experiments").json()["experiments"]
    offered = {one["name"]: one for one in next(kind for kind in kinds if kind["name"] == "tracking")["settings"]}

    def answered(name: str, value: float) -> int:
        # slow outer loops, because their range depends on λ_motor too
        settings = {"lam_q": 1.0, "lam_S": 1.0, name: value}
        answer = off.post("/api/experiments/queue", json={"name": "tracking", "settings": settings})
        if answer.is_success:
            off.delete(f"/api/experiments/queue/{answer.json()['items'][-1]['id']}").raise_for_status()
        return answer.status_code

    for name in ("lam_q", "lam_S", "lam_motor"):
        low, high = offered[name]["minimum"], offered[name]["maximum"]
        taken = [answered(name, value) for value in (0.999 * low, 1.001 * low, 0.999 * high, 1.001 * high)]
        assert taken == [422, 201, 201, 422], name
    assert (offered["seed"]["minimum"], offered["seed"]["maximum"]) == (0, 0)
    assert answered("seed", 1) == 422


def test_tracking_is_run_reported_and_downloaded(off: httpx.Client) -> None:
    kinds = off.get("/api/experiments").json()["experiments"]
    units = {setting["name"]: setting["unit"] for setting in kinds[0]["settings"]}
    assert (units["q_amplitude"], units["S_hold"], units["lam_q"]) == ("rad", "N·m/rad", "s")
    run = off.post("/api/experiments", json={"name": "tracking", "settings": SHORT}).raise_for_status().json()["id"]
    assert off.put("/api/tuning", json={"lam_q": 0.7}).status_code == 409
    view = finished(off, f"/api/experiments/{run}")
    assert view["status"] == "completed", view["message"]
    metrics = {metric["name"]: metric["value"] for metric in view["metrics"]}
    assert metrics["min_tension_N"] > 5.0

    pdf = off.get(f"/api/runs/{run}/report.pdf").raise_for_status()
    assert pdf.headers["content-type"] == "application/pdf"
    assert pdf.content.startswith(b"%PDF-")
    page = off.get(f"/api/runs/{run}/report.html").raise_for_status()
    assert "<script" not in page.text
    assert "default-src 'none'" in page.headers["content-security-policy"]

    stored = off.get(f"/api/runs/{run}").json()
    text = off.get(f"/api/runs/{run}/data.csv").raise_for_status().text
    csv = [line for line in text.splitlines() if not line.startswith("#")]
    assert csv[0].startswith("t,q,q_ref,S,S_ref,theta_A,theta_B,F_A,F_B,u_A,u_B")
    assert len(csv) - 1 == stored["samples"] == pytest.approx(7000, abs=2)
    table = parquet.read_table(BytesIO(off.get(f"/api/runs/{run}/data.parquet").raise_for_status().content))
    assert table.num_rows == stored["samples"]
    assert off.get(f"/api/runs/{run}/data.mat").raise_for_status().content.startswith(b"MATLAB")
    assert off.get(f"/api/runs/{run}/data.exe").status_code == 422

    raw = off.get(f"/api/runs/{run}/samples", params={"from": 1.0, "to": 1.2, "signals": "q", "points": 2000}).json()
    assert raw["raw"]
    assert raw["signals"]["q"]["minimum"] == raw["signals"]["q"]["maximum"]
    column = np.array([float(line.split(",")[1]) for line in csv[1001:1201]])
    np.testing.assert_allclose(raw["signals"]["q"]["minimum"], column, atol=1e-6)
    whole = off.get(f"/api/runs/{run}/samples", params={"points": 100, "signals": "q"}).json()
    assert not whole["raw"]
    assert len(whole["t"]) <= 101
    assert max(whole["signals"]["q"]["maximum"]) == pytest.approx(max(float(line.split(",")[1]) for line in csv[1:]))

    noted = off.patch(f"/api/runs/{run}", json={"note": "worn tendon"}).json()
    assert noted["note"] == "worn tendon"
    found = off.get("/api/runs", params={"search": "worn", "kind": "tracking"}).json()
    assert [item["id"] for item in found["runs"]] == [run]
    assert found["total"] == 1


def test_invalid_requests_are_rejected_before_motion(off: httpx.Client) -> None:
    before = off.get("/api/runs").json()["total"]
    unknown = off.post("/api/experiments", json={"name": "levitation"})
    assert unknown.status_code == 422
    assert "tracking" in problem(unknown)["legal"]
    setting = off.post("/api/experiments", json={"name": "tracking", "settings": {"q_amplitude": 2.0}})
    refusal = problem(setting)
    assert (refusal["quantity"], refusal["value"], refusal["unit"]) == ("q_amplitude", 2.0, "rad")
    assert off.post("/api/experiments", json={"name": "tracking", "settings": {"speed": 2.0}}).status_code == 422
    assert off.post("/api/experiments", json={"name": "tracking", "settings": {"lam_q": 0.1}}).status_code == 422
    assert off.post("/api/experiments", json={"name": "tracking", "settings": {"seed": 5}}).status_code == 422
    assert off.post("/api/experiments", json={"name": "tracking", "settings": {"bank": 999}}).status_code == 404
    assert off.post("/api/identifications", json={"tension_N": 60.0}).status_code == 422
    assert off.post("/api/banks", json={"name": "x", "identifications": [999]}).status_code == 404
    assert off.get("/api/runs").json()["total"] == before
    assert off.get("/api/state").json()["mode"] == "off"


# Identifications of motors and springs through the interface; banks compared, exported and imported.

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


def test_motor_and_spring_identifications_are_predicted_in_advance(operator: httpx.Client) -> None:
    motor = operator.post("/api/identifications/prediction", json={"kind": "motor"}).json()
    figures = {figure["name"]: figure["value"] for figure in motor["figures"]}
    assert motor["enough_motion"]
    assert figures["omega_max"] == pytest.approx(2.86 * 5.0, rel=0.02)
    assert motor["F_low"] == 0.0
    assert "it is free while the tendons are slack" in motor["message"]
    spring = operator.post("/api/identifications/prediction", json={"kind": "spring"}).json()
    figures = {figure["name"]: figure["value"] for figure in spring["figures"]}
    assert figures["x_max"] == pytest.approx(0.0577, abs=5e-4)
    several = operator.post("/api/identifications/prediction", json={"tensions_N": [10, 20, 30, 40]}).json()
    one = operator.post("/api/identifications/prediction", json={"tension_N": 20}).json()
    assert several["F_min_N"] < one["F_min_N"]
    # At 40 N the joint moves farthest: q = r_m θ_A / (2 r_j), and both springs are stretched by 53.8 mm.
    assert several["q_high"] == pytest.approx(0.05 * (2.0 * 53.8 / 7.5 + 1.0 + 1.0), abs=0.03)
    assert one["q_high"] < several["q_high"] - 0.2
    assert several["duration_s"] > 4.0 * 28.32


def test_an_identification_beyond_the_range_is_predicted_and_rejected(off: httpx.Client) -> None:
    order = {"tension_N": 42.0, "amplitude_rad": 2.0, "chip_s": 0.5, "bits": 5, "periods": 1}
    prediction = off.post("/api/identifications/prediction", json=order).raise_for_status().json()
    assert not prediction["within_range"]
    assert not prediction["enough_motion"]
    refused = problem(off.post("/api/identifications", json=order))
    assert (refused["quantity"], refused["maximum"], refused["unit"]) == ("tension during the motion", 50.0, "N")
    assert refused["message"] == prediction["message"]
    assert off.get("/api/state").json()["mode"] == "off"


@pytest.mark.parametrize(
    ("order", "expected"),
    [
        ({"kind": "motor", "u_high": 12.0}, "u_high"),
        ({"kind": "motor", "u_low": 6.0}, "u_low"),
        ({"kind": "spring", "F_high": 60.0}, "F_high"),
        ({"tensions_N": [20.0, 70.0]}, "tension_N"),
        ({"kind": "gearbox"}, "kind"),
        ({"kind": "motor", "tension_N": 20.0}, "tension_N"),
    ],
)
def test_identification_settings_out_of_bounds_are_rejected(
    operator: httpx.Client, order: dict[str, object], expected: str
) -> None:
    refused = operator.post("/api/identifications", json=order)
    assert refused.status_code == 422
    assert expected in str(problem(refused))


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


def test_the_interpretation_of_a_table_is_shown_and_options_resolve_ambiguity(operator: httpx.Client) -> None:
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
    options = {"name": "own.csv", "table": doubtful, "decimal": "comma"}
    assert operator.post("/api/spring-tables", json=options).status_code == 201

    two = "x [mm],F [N]\nlower,upper\n" + "\n".join(table().splitlines()[1:])
    refused = problem(operator.post("/api/spring-tables", json={"name": "own.csv", "table": two}))
    assert (refused["code"], refused["path"]) == ("ambiguous_heading", ["header"])
    made = operator.post("/api/spring-tables", json={"name": "own.csv", "table": two, "header": 1})
    assert made.json()["read"]["rows"] == 40


def test_a_bank_is_imported_compared_and_exported(operator: httpx.Client, viewer: httpx.Client) -> None:
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
