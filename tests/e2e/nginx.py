"""nginx in front of a service, with a configuration of docs/how-to/network.md."""

import re
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PAGE = (Path(__file__).parents[2] / "docs" / "how-to" / "network.md").read_text(encoding="utf-8")
CONFIGURATIONS = dict(re.findall(r"^```nginx (\w+)\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL))
"""What stands in the document, by its name there."""

START_S = 30.0
NGINX = shutil.which("nginx", path="/usr/sbin:/usr/local/sbin:/usr/bin:/usr/local/bin:/opt/homebrew/bin")

_WHOLE = """
daemon off;
master_process off;
pid {folder}/nginx.pid;
error_log {folder}/error.log;
events {{}}
http {{
    access_log off;
    {paths}
    {server}
}}
"""
_TEMPORARY = ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")


def free_port() -> int:
    """Return an unused port of this machine."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        return int(listening.getsockname()[1])


@contextmanager
def nginx(folder: Path, configuration: str, port: int, service: str) -> Iterator[None]:
    """Run nginx with a configuration of the document, on ``port`` of this machine, in front of ``service``."""
    assert NGINX is not None, "nginx is not installed: .ci/provide proxy"
    assert "http://127.0.0.1:8000" in configuration
    server = configuration.replace("http://127.0.0.1:8000", service)
    server = re.sub(r"listen \d+", f"listen 127.0.0.1:{port}", server)
    server = server.replace("server_name rig.lab;", "").replace("rig.lab.", f"{folder}/rig.lab.")
    if "ssl_certificate" in server:
        make_certificate(folder)
    paths = " ".join(f"{name}_temp_path {folder}/{name};" for name in _TEMPORARY)
    file = folder / "nginx.conf"
    file.write_text(_WHOLE.format(folder=folder, paths=paths, server=server))
    process = subprocess.Popen([NGINX, "-p", str(folder), "-c", str(file)], stderr=subprocess.PIPE, text=True)
    try:
        wait_for(process, port)
        yield
    finally:
        process.terminate()
        process.communicate(timeout=START_S)


def make_certificate(folder: Path) -> None:
    """Create a self-signed certificate."""
    request = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=127.0.0.1"]
    files = ["-keyout", str(folder / "rig.lab.key"), "-out", str(folder / "rig.lab.crt")]
    subprocess.run([*request, *files], check=True, capture_output=True)


def wait_for(process: "subprocess.Popen[str]", port: int) -> None:
    """Wait until a process listens on a port."""
    end = time.monotonic() + START_S
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), 1.0).close()
            return
        except OSError:
            assert process.poll() is None, process.stderr and process.stderr.read()
            assert time.monotonic() < end
            time.sleep(0.05)
