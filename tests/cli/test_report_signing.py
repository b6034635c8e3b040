"""A report is signed by the installation that has its run, and verified elsewhere by the public half alone."""

import base64
import json
import re
from pathlib import Path
from typing import Any

from tests.cli.conftest import Command

SHORT = ("--set", "q_duration_s=0.5", "--set", "S_duration_s=0.5")


def test_a_report_proves_where_it_comes_from(command: Command, tmp_path: Path) -> None:
    here, out, elsewhere = tmp_path / "here", tmp_path / "out", tmp_path / "elsewhere"
    assert command("experiment", "tracking", *SHORT, "--out", str(out), folder=here).returncode == 0
    report, public = out / "report.html", tmp_path / "rig-2.pub"

    def verified(*words: str, folder: Path = elsewhere, file: Path = report) -> tuple[int, Any, dict[str, Any]]:
        done = command("report", "verify", str(file), "--json", *words, folder=folder)
        told = json.loads(done.stdout)
        return done.returncode, told["holds"], told["signature"]

    assert verified() == (0, True, {"state": "none", "key": None, "fingerprint": None, "name": None})
    assert not elsewhere.exists()
    assert not (here / "signing-key").exists()

    line = command("report", "key", "--station", "rig-2", folder=here).stdout
    public.write_text(line, encoding="utf-8")
    key = json.loads(command("report", "key", "--station", "rig-2", "--json", folder=here).stdout)
    assert line.split() == [*key["public_key"].split(), key["fingerprint"], "rig-2"]
    assert len(line.splitlines()) == 1
    assert verified("--key", str(public))[:2] == (1, False)  # not signed yet

    before = report.read_bytes()
    report.chmod(0o640)
    signed = command("report", "sign", str(report), "--station", "rig-2", folder=here)
    assert signed.returncode == 0, signed.stderr
    assert key["fingerprint"] in signed.stdout
    once = report.read_bytes()
    assert report.stat().st_mode & 0o777 == 0o640
    assert re.sub(rb'<template id="signature">[^<]*</template>', b"", once) == before
    assert command("report", "sign", str(report), "--station", "rig-2", folder=here).returncode == 0
    assert report.read_bytes() == once
    assert {path.name for path in out.iterdir()} == {"report.html", "report.pdf", "data.csv", "metrics.json"}

    by = {"state": "valid", "fingerprint": key["fingerprint"], "name": "rig-2"}
    assert verified() == (0, True, {**by, "key": "unknown"})
    assert verified(folder=here) == (0, True, {**by, "key": "own"})
    assert verified("--key", str(public)) == (0, True, {**by, "key": "given"})
    assert verified("--key", key["public_key"], file=out / "report.pdf") == (0, True, {**by, "key": "given"})
    assert not elsewhere.exists()
    unknown = command("report", "verify", str(report), folder=elsewhere).stdout
    assert "an unknown key: that proves nothing" in " ".join(unknown.split())
    other = json.loads(command("report", "key", "--json", folder=tmp_path / "third").stdout)["public_key"]
    status, holds, of = verified("--key", other)
    assert (status, holds, of["key"]) == (1, False, "unknown")
    junk = command("report", "verify", str(report), "--key", "junk", folder=elsewhere)
    assert (junk.returncode, junk.stdout) == (2, "")

    alone = tmp_path / "alone" / "report.html"  # without samples the signature is told, the numbers are not
    alone.parent.mkdir()
    alone.write_bytes(once)
    assert verified("--key", str(public), file=alone) == (2, None, {**by, "key": "given"})
    for touched in (once.replace(b"</h1>", b" </h1>", 1), once.replace(b"</h1>", b"\xff</h1>", 1)):
        report.write_bytes(touched)
        alone.write_bytes(touched)
        assert verified()[2]["state"] == "broken"
        assert verified()[:2] == verified(file=alone)[:2] == (1, False)
    report.write_bytes(once)


def test_only_what_holds_by_the_runs_of_this_folder_is_signed(command: Command, tmp_path: Path) -> None:
    here, out, elsewhere = tmp_path / "here", tmp_path / "out", tmp_path / "elsewhere"
    for _ in range(2):
        assert command("experiment", "tracking", *SHORT, "--out", str(out), folder=here).returncode == 0
    report, series = out / "report.html", out / "series.html"
    page = report.read_bytes()
    refused = command("report", "sign", str(report), folder=elsewhere)
    assert (refused.returncode, elsewhere.exists()) == (2, False)
    pdf = (out / "report.pdf").read_bytes()
    assert command("report", "sign", str(out / "report.pdf"), folder=here).returncode == 2
    assert (out / "report.pdf").read_bytes() == pdf
    for forged, status in (
        (page.replace(b"</h1>", b" </h1>", 1), 1),
        (page.replace(b'"Sinew":"', b'"Sinew":"0.', 1), 1),
        (b"<html></html>", 2),
        (b"\xff", 2),
    ):
        assert forged != page
        report.write_bytes(forged)
        assert command("report", "sign", str(report), folder=here).returncode == status
        assert report.read_bytes() == forged
    assert not (here / "signing-key").exists()

    assert command("report", "series", "1", "2", "--to", str(series), folder=here).returncode == 0
    assert command("report", "sign", str(series), folder=here).returncode == 0
    public = command("report", "key", folder=here).stdout.strip()
    assert command("report", "verify", str(series), "--key", public, folder=here).returncode == 0
    series.write_bytes(series.read_bytes().replace(b"</h1>", b" </h1>", 1))
    assert command("report", "verify", str(series), folder=here).returncode == 1


def test_the_private_key_is_in_no_backup_bundle_or_export(command: Command, tmp_path: Path) -> None:
    here, out = tmp_path / "here", tmp_path / "out"
    assert command("experiment", "tracking", *SHORT, "--out", str(out), folder=here).returncode == 0
    assert command("report", "sign", str(out / "report.html"), folder=here).returncode == 0
    pem = (here / "signing-key").read_bytes()
    body = base64.b64decode(b"".join(pem.splitlines()[1:-1]))
    secret = body[-32:]
    assert command("db", "backup", str(tmp_path / "backup.db"), folder=here).returncode == 0
    assert command("runs", "bundle", "1", str(tmp_path / "run.zip"), folder=here).returncode == 0
    assert command("runs", "export", "1", str(tmp_path / "run.mcap"), folder=here).returncode == 0
    files = [path for path in tmp_path.rglob("*") if path.is_file() and path.name != "signing-key"]
    assert {"backup.db", "run.zip", "run.mcap", "report.html", "sinew.db"} <= {path.name for path in files}
    forms = (pem, secret, secret.hex().encode(), base64.b64encode(secret), base64.b64encode(body)[-44:])
    assert [path for path in files if any(form in path.read_bytes() for form in forms)] == []
