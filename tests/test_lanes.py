"""Every test runs in exactly one lane; a hanging test fails with a traceback."""

import ast
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests import lanes
from tests.lanes import BESIDE, IN_TURN, LANES, Ended, not_run_once
from tests.tiers import Left, left_out, renamed, whole_files

ROOT = Path(__file__).parents[1]


def lane(there: list[str], ran: list[str]) -> Ended:
    return Ended("any", 0, 1.0, there, dict.fromkeys(ran, "passed"))


def test_tests_that_run_in_no_lane_or_in_two_are_found() -> None:
    everything = ["a", "b", "c"]
    assert not_run_once([lane(everything, ["a", "c"]), lane(everything, ["b"])]) == []
    assert not_run_once([lane(everything, ["a"]), lane(everything, ["b"])]) == ["c"]
    assert not_run_once([lane(everything, ["a", "b"]), lane(everything, ["b", "c"])]) == ["b"]


def test_lanes_divide_and_count_all_tests_and_show_the_parallel_lane_last() -> None:
    some = ["tests/wire", "tests/realtime/test_pacer.py", "-q"]
    ended = subprocess.run([sys.executable, "-m", "tests.lanes", *some], cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    starts = [ended.stdout.index(f"lane: {name}") for name in ("page", "live", "pure")]
    assert starts == sorted(starts)
    counts = {name: int(re.findall(rf"{name} +│ (\d+)", ended.stdout)[0]) for name in LANES}
    assert f"{counts['live']} passed" in ended.stdout[starts[1] : starts[2]]
    assert f"{counts['pure']} passed" in ended.stdout[starts[2] :]
    assert counts.pop("page") == 0
    assert all(count > 0 for count in counts.values()), counts
    assert ended.stdout.splitlines()[-1] == f"{sum(counts.values())} passed, 0 failed"


def test_each_lane_runs_once() -> None:
    assert sorted([*IN_TURN, BESIDE]) == sorted(LANES)


def test_a_killed_lane_is_a_failure(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text("import os, signal\n\nos.kill(os.getpid(), signal.SIGKILL)\n")
    command = [sys.executable, "-m", "tests.lanes", f"--confcutdir={tmp_path}", str(tmp_path)]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == 1
    assert "the lane live did not come to its end: exit code -9" in ended.stdout


@pytest.mark.parametrize("code", [0, 3])
@pytest.mark.parametrize("option", ["--beside", "--then"])
def test_the_exit_code_includes_additional_commands(
    option: str, code: int, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    requested: list[list[str]] = []

    def run_lane(name: str, arguments: list[str], output: object = None) -> Ended:
        requested.append(arguments)
        return lane(["a"], ["a"] if name == BESIDE else [])

    command = shlex.join((sys.executable, "-c", f"print('sa' + 'id'); raise SystemExit({code})"))
    monkeypatch.setattr(lanes, "run", run_lane)
    monkeypatch.setattr(sys, "argv", ["lanes", "tests/wire", option, command, "-q"])
    assert lanes.main() == int(code != 0)
    assert requested == [["tests/wire", "-q"]] * len(LANES)
    printed = capfd.readouterr().out
    assert "said" in printed
    assert ("failed, see above" in printed) == (code != 0)


def test_a_hanging_test_fails_with_its_traceback(tmp_path: Path) -> None:
    (tmp_path / "test_hangs.py").write_text("import time\n\ndef test_it():\n    time.sleep(60)  # here\n")
    command = [sys.executable, "-m", "pytest", "-c", str(ROOT / "pyproject.toml"), "--timeout=1", str(tmp_path)]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=50)
    assert ended.returncode == 1
    assert "time.sleep(60)  # here" in ended.stdout
    assert "Timeout" in ended.stdout


def test_tests_of_the_thorough_run_exist() -> None:
    for left in left_out():
        assert len(left.because.split()) > 5, left
        for name in (*left.tests, *left.but):
            file, _, function = name.partition("::")
            parsed = ast.walk(ast.parse((ROOT / file).read_text(encoding="utf-8")))
            functions = {node.name for node in parsed if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)}
            assert not function or function.partition("[")[0] in functions, name


def test_tests_are_excluded_by_file_function_or_full_name() -> None:
    left = Left(("tests/a.py", "tests/b.py::test_one", "tests/b.py::test_two[3]"), "", but=("tests/a.py::test_kept",))
    names = ("tests/a.py::test_x[1]", "tests/b.py::test_one", "tests/b.py::test_one[0]", "tests/b.py::test_two[3]")
    assert all(left.names(test) for test in names)
    included = (
        "tests/a.py::test_kept[1]",
        "tests/ab.py::test_x",
        "tests/b.py::test_one_more",
        "tests/b.py::test_two[33]",
    )
    assert not any(left.names(test) for test in included)


def test_renamed_cases_are_reported() -> None:
    names = {name for left in left_out() for name in (*left.tests, *left.but) if "[" in name}
    assert renamed(names) == []
    one = sorted(names)[0]
    assert renamed({*names, f"{one.partition('[')[0]}[new]"} - {one}) == [one]


def test_excluded_tests_run_on_request(tmp_path: Path) -> None:
    some = next(name for name in sorted(whole_files()) if name.startswith("tests/plant/"))
    folder = str(Path(some).parent)
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-p",
        "tests.lanes_record",
        f"--record={tmp_path}",
        "--collect-only",
        "-q",
    ]
    counts = []
    for requested in ((folder,), (folder, "--thorough"), (some,)):
        subprocess.run([*command, *requested, "tests/test_errors.py"], cwd=ROOT, capture_output=True, check=True)
        there = (tmp_path / "there").read_text(encoding="utf-8").splitlines()
        counts.append(sum(test.startswith(f"{some}::") for test in there))
        assert any(test.startswith("tests/test_errors.py::") for test in there)
    assert counts[0] == 0 < counts[1] == counts[2]
