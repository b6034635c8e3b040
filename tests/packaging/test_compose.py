"""docker-compose.yml: parsed by docker-compose where that is installed, read as YAML everywhere."""

import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def compose() -> dict[str, Any]:
    document = yaml.safe_load((ROOT / "docker-compose.yml").read_text(encoding="utf-8"))
    assert isinstance(document, dict)
    return document


def test_docker_compose_accepts_the_file_with_and_without_postgres() -> None:
    command = shutil.which("docker-compose")
    for profile in ([], ["--profile", "postgres"]) if command else ():
        result = subprocess.run([str(command), *profile, "config", "-q"], cwd=ROOT, capture_output=True, text=True)
        assert result.returncode == 0, result.stderr


def test_only_the_loopback_of_the_host_is_bound(compose: dict[str, Any]) -> None:
    ports = {name: service.get("ports", []) for name, service in compose["services"].items()}
    assert ports == {"sinew": ["127.0.0.1:8000:8000"], "postgres": []}


def test_the_loop_may_ask_for_real_time(compose: dict[str, Any]) -> None:
    sinew = compose["services"]["sinew"]
    assert "SYS_NICE" in sinew["cap_add"]
    assert sinew["ulimits"]["rtprio"] > 0
    assert sinew["ulimits"]["memlock"] == {"soft": -1, "hard": -1}


def test_data_lives_on_a_volume_that_the_service_is_told_to_use(compose: dict[str, Any]) -> None:
    assert compose["services"]["sinew"]["volumes"] == ["data:/data"]
    assert set(compose["volumes"]) == {"data", "postgres"}
    assert "--data /data" in (ROOT / "Dockerfile").read_text(encoding="utf-8").splitlines()[-1]


def test_postgres_comes_with_its_profile_only(compose: dict[str, Any]) -> None:
    profiles = {name: service.get("profiles", []) for name, service in compose["services"].items()}
    assert profiles == {"sinew": [], "postgres": ["postgres"]}


def test_the_image_runs_what_the_makefile_offers() -> None:
    dockerfile = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    assert "RUN make install frontend EXTRAS=postgres" in dockerfile
    assert 'CMD ["make", "run",' in dockerfile
