"""Identification, bank, experiment, report: the whole order, through the interface, in real time but short."""

from io import BytesIO
from typing import Any

import httpx
import numpy as np
import pytest
from pyarrow import parquet

from tests.api.conftest import problem, until

SHORT = {"q_duration_s": 0.5, "S_duration_s": 0.5, "lam_q": 0.5}


def finished(client: httpx.Client, path: str) -> dict[str, Any]:
    """Ask until the run is over and its result is there."""

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


def test_what_the_form_offers_is_what_the_service_takes(off: httpx.Client) -> None:
    kinds = off.get("/api/experiments").json()["experiments"]
    offered = {one["name"]: one for one in next(kind for kind in kinds if kind["name"] == "tracking")["settings"]}

    def answered(name: str, value: float) -> int:
        # slow outer loops: how fast they may be depends on λ_motor too
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


def test_tracking_runs_reports_and_is_downloaded(off: httpx.Client) -> None:
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


def test_bad_orders_are_refused_before_anything_moves(off: httpx.Client) -> None:
    before = off.get("/api/runs").json()["total"]
    unknown = off.post("/api/experiments", json={"name": "levitation"})
    assert unknown.status_code == 422
    assert "tracking" in problem(unknown)["legal"]
    setting = off.post("/api/experiments", json={"name": "tracking", "settings": {"q_amplitude": 2.0}})
    told = problem(setting)
    assert (told["quantity"], told["value"], told["unit"]) == ("q_amplitude", 2.0, "rad")
    assert off.post("/api/experiments", json={"name": "tracking", "settings": {"speed": 2.0}}).status_code == 422
    assert off.post("/api/experiments", json={"name": "tracking", "settings": {"lam_q": 0.1}}).status_code == 422
    assert off.post("/api/experiments", json={"name": "tracking", "settings": {"seed": 5}}).status_code == 422
    assert off.post("/api/experiments", json={"name": "tracking", "settings": {"bank": 999}}).status_code == 404
    assert off.post("/api/identifications", json={"tension_N": 60.0}).status_code == 422
    assert off.post("/api/banks", json={"name": "x", "identifications": [999]}).status_code == 404
    assert off.get("/api/runs").json()["total"] == before
    assert off.get("/api/state").json()["mode"] == "off"
