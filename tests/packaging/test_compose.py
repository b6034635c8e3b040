"""Dockerfile and compose files; docker-compose parses them where it is installed."""

import json
import os
import re
import shutil
import subprocess
import sys
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PLAIN, POSTGRES = "docker-compose.yml", "docker-compose.postgres.yml"
STEPS = (ROOT / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ").splitlines()


def services(name: str) -> dict[str, Any]:
    document = yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))
    assert isinstance(document, dict)
    return dict(document["services"])


def arguments_of(word: str) -> list[str]:
    return [line.removeprefix(word).strip() for line in STEPS if line.startswith(f"{word} ")]


@pytest.mark.parametrize("profile", [[], ["--profile", "cluster"]], ids=["alone", "cluster"])
@pytest.mark.parametrize("files", [[PLAIN], [PLAIN, POSTGRES]], ids=["sqlite", "postgres"])
def test_docker_compose_accepts_the_files(files: list[str], profile: list[str]) -> None:
    command = shutil.which("docker-compose")
    if command:
        named = [word for name in files for word in ("-f", name)]
        result = subprocess.run([command, *named, *profile, "config", "-q"], cwd=ROOT, capture_output=True, text=True)
        assert result.returncode == 0, result.stderr


def test_ports_are_bound_only_to_the_loopback_address() -> None:
    assert services(PLAIN)["sinew"]["ports"] == ["127.0.0.1:8000:8000"]
    assert not any("ports" in service for service in services(POSTGRES).values())


@pytest.mark.parametrize("name", [PLAIN, POSTGRES])
def test_every_service_drops_unneeded_rights(name: str) -> None:
    # The second file only adds to services of the first.
    for service in [found for found in services(name).values() if "build" in found or "image" in found]:
        assert service["cap_drop"] == ["ALL"]
        assert service["security_opt"] == ["no-new-privileges:true"]
        assert service["restart"] == "unless-stopped"
        assert "privileged" not in service
    assert "cap_add" not in services(PLAIN)["sinew"]


def test_the_cluster_starts_only_on_request_and_listens_only_on_loopback() -> None:
    found = services(PLAIN)
    assert {name for name, service in found.items() if service.get("profiles") == ["cluster"]} == {
        "scheduler",
        "worker",
    }
    assert found["scheduler"]["ports"] == ["127.0.0.1:8786:8786"]
    assert "ports" not in found["worker"]
    assert found["worker"]["command"][2] == f"tcp://scheduler:{found['scheduler']['command'][3]}"
    assert any("cluster.lock" in step for step in arguments_of("RUN"))


def test_the_service_has_the_limits_for_real_time_scheduling() -> None:
    assert services(PLAIN)["sinew"]["ulimits"] == {"rtprio": 95, "nice": 30, "memlock": {"soft": -1, "hard": -1}}


def test_the_data_folder_is_on_a_volume() -> None:
    assert services(PLAIN)["sinew"]["volumes"] == ["data:/data"]
    assert "SINEW_DATA=/data" in " ".join(arguments_of("ENV"))
    assert arguments_of("VOLUME") == ["/data"]


def test_environment_variables_contain_no_passwords() -> None:
    for name in (PLAIN, POSTGRES):
        for service in services(name).values():
            for variable, value in service.get("environment", {}).items():
                assert "PASSWORD" not in variable or variable.endswith("_FILE")
                assert not re.search(r"://[^/@]*:[^/@]*@", str(value))
    postgres = services(POSTGRES)["postgres"]
    assert postgres["environment"]["POSTGRES_HOST_AUTH_METHOD"] != "trust"
    assert postgres["environment"]["POSTGRES_PASSWORD_FILE"] == "/run/secrets/database_password"
    assert (
        services(POSTGRES)["sinew"]["environment"]["SINEW_DATABASE_PASSWORD_FILE"] == "/run/secrets/database_password"
    )


def test_the_final_image_contains_only_the_installed_program() -> None:
    first, second = arguments_of("FROM")
    assert first == f"{second} AS build"
    assert arguments_of("COPY") == [". .", "--from=build /opt/sinew /opt/sinew"]
    assert arguments_of("USER") == ["sinew"]
    assert json.loads(arguments_of("CMD")[-1]) == ["sinew", "serve"]


def test_the_sign_in_link_is_not_logged_by_default() -> None:
    passed_on = ["SINEW_SHOW_LINK", "SINEW_PUBLIC_URL", "SINEW_TRUSTED_PROXIES"]
    assert services(PLAIN)["sinew"]["environment"] == dict.fromkeys(passed_on)
    assert "SHOW_LINK" not in " ".join(arguments_of("ENV"))


@pytest.mark.parametrize(("alive", "status"), [(True, 0), (False, 1)])
def test_the_health_check_queries_the_service(alive: bool, status: int) -> None:
    class Answer(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            assert self.path == "/api/health"
            self.send_response(200)
            self.end_headers()
            self.wfile.write(json.dumps({"alive": alive}).encode())

    check = json.loads(arguments_of("HEALTHCHECK")[0].partition("CMD ")[2])
    assert check[:2] == ["python", "-c"]
    with HTTPServer(("127.0.0.1", 0), Answer) as server:
        threading.Thread(target=server.handle_request, daemon=True).start()
        program = check[2].replace(":8000/", f":{server.server_port}/")
        through_proxy = {**os.environ, "http_proxy": "http://127.0.0.1:9"}
        ended = subprocess.run([sys.executable, "-c", program], env=through_proxy, check=False)
        assert ended.returncode == status
