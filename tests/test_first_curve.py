"""A start loads only the modules for the first curve, and uses cached values."""

import json
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from backend.services.tuning_state import RobustnessCache
from backend.tuning import robustness
from backend.tuning.gains import MotorModel
from backend.tuning.preview import TuningPreviewer
from plant.parameters import load_parameters

LATER = ("scipy.optimize", "scipy.signal", "scipy.stats", "control", "matplotlib", "pyarrow", "typst", "alembic")
STARTED = """
import sys
from collections.abc import Callable
import backend.main, backend.app, backend.api.app
from backend.app import RobustnessCache, TuningStore
from backend.storage import open_database
from plant import load_parameters
from pathlib import Path
database = open_database(Path(sys.argv[1]))
RobustnessCache(Path(sys.argv[1])).load()
tuning, _ = TuningStore(database).restore(load_parameters("lab"))
tuning.view(0.0), tuning.build_command()
print(*[name for name in sys.argv[2:] if name in sys.modules])
"""


@pytest.fixture
def empty_cache(monkeypatch: pytest.MonkeyPatch) -> dict[str, tuple[float, ...]]:
    monkeypatch.setattr(robustness, "FIGURES", {})
    monkeypatch.setattr("backend.services.tuning_state.FIGURES", robustness.FIGURES)
    return robustness.FIGURES


def modules_loaded(data: Path) -> list[str]:
    ended = subprocess.run(
        [sys.executable, "-c", STARTED, str(data), *LATER], capture_output=True, text=True, check=True
    )
    return ended.stdout.split()


def test_only_the_first_start_loads_modules_that_the_first_curve_does_not_need(
    tmp_path: Path, empty_cache: dict[str, tuple[float, ...]]
) -> None:
    assert "control" in modules_loaded(tmp_path)  # nothing is cached yet
    TuningPreviewer(load_parameters("lab"))
    RobustnessCache(tmp_path).save()
    assert modules_loaded(tmp_path) == []


def test_the_control_loop_loads_none_of_these_modules() -> None:
    code = "import sys, backend.realtime.process; print(*[name for name in sys.argv[1:] if name in sys.modules])"
    ended = subprocess.run(
        [sys.executable, "-c", code, *LATER, "sqlalchemy", "fastapi"], capture_output=True, text=True, check=True
    )
    assert ended.stdout.split() == []


def test_cached_robustness_equals_computed_robustness(
    tmp_path: Path, empty_cache: dict[str, tuple[float, ...]]
) -> None:
    motor = MotorModel(2.86, 0.22, 0.002)
    computed = robustness.motor_range(motor)
    RobustnessCache(tmp_path).save()
    empty_cache.clear()
    RobustnessCache(tmp_path).load()
    assert len(empty_cache) == 1
    assert robustness.motor_range(motor) == computed


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: "",
        lambda text: text[:-20],
        lambda text: "[]",
        lambda text: text.replace("0.2", "0.3", 1),
        lambda text: json.dumps({"figures": {"a": [[]]}, "digest": "b"}),
    ],
    ids=["empty", "cut off", "of another form", "altered", "none of ours"],
)
def test_a_damaged_cache_file_is_ignored(
    tmp_path: Path, empty_cache: dict[str, tuple[float, ...]], damage: Callable[[str], str]
) -> None:
    robustness.motor_range(MotorModel(2.86, 0.22, 0.002))
    cache = RobustnessCache(tmp_path)
    cache.save()
    assert cache.file is not None
    whole = cache.file.read_text(encoding="ascii")
    cache.file.write_text(damage(whole), encoding="ascii")
    assert damage(whole) != whole
    empty_cache.clear()
    RobustnessCache(tmp_path).load()
    assert empty_cache == {}


@pytest.mark.parametrize("known", [(), (1.0,), (1.0, float("nan")), (1.0, float("inf"))])
def test_invalid_cached_values_are_recomputed(
    empty_cache: dict[str, tuple[float, ...]], known: tuple[float, ...]
) -> None:
    assert robustness.cached(("question",), 2, lambda: (1.0, 2.0)) == (1.0, 2.0)
    (key,) = empty_cache
    empty_cache[key] = known
    assert robustness.cached(("question",), 2, lambda: (3.0, 4.0)) == (3.0, 4.0)


def test_the_least_recently_used_values_are_dropped_first(
    empty_cache: dict[str, tuple[float, ...]],
) -> None:
    """The values of the active tuning are used repeatedly and stay cached."""
    for number in range(robustness.MOST + 1):
        for key_number in (0, number):
            robustness.cached((key_number,), 1, partial(lambda value: (value,), float(key_number)))
    assert len(empty_cache) == robustness.MOST
    assert (0.0,) in empty_cache.values()
    assert (1.0,) not in empty_cache.values()
    assert (2.0,) in empty_cache.values()
