"""A start loads only what the first curve needs, and computes nothing that was computed before."""

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
def nothing_known(monkeypatch: pytest.MonkeyPatch) -> dict[str, tuple[float, ...]]:
    monkeypatch.setattr(robustness, "FIGURES", {})
    monkeypatch.setattr("backend.services.tuning_state.FIGURES", robustness.FIGURES)
    return robustness.FIGURES


def loaded(data: Path) -> list[str]:
    ended = subprocess.run(
        [sys.executable, "-c", STARTED, str(data), *LATER], capture_output=True, text=True, check=True
    )
    return ended.stdout.split()


def test_no_start_but_the_first_loads_what_the_first_curve_does_not_need(
    tmp_path: Path, nothing_known: dict[str, tuple[float, ...]]
) -> None:
    assert "control" in loaded(tmp_path)  # nothing has been computed yet
    TuningPreviewer(load_parameters("lab"))
    RobustnessCache(tmp_path).save()
    assert loaded(tmp_path) == []


def test_the_loop_process_loads_none_of_it_at_all() -> None:
    code = "import sys, backend.realtime.process; print(*[name for name in sys.argv[1:] if name in sys.modules])"
    ended = subprocess.run(
        [sys.executable, "-c", code, *LATER, "sqlalchemy", "fastapi"], capture_output=True, text=True, check=True
    )
    assert ended.stdout.split() == []


def test_what_is_kept_is_what_would_be_computed(tmp_path: Path, nothing_known: dict[str, tuple[float, ...]]) -> None:
    motor = MotorModel(2.86, 0.22, 0.002)
    computed = robustness.motor_range(motor)
    RobustnessCache(tmp_path).save()
    nothing_known.clear()
    RobustnessCache(tmp_path).load()
    assert len(nothing_known) == 1
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
def test_a_damaged_file_is_not_believed(
    tmp_path: Path, nothing_known: dict[str, tuple[float, ...]], damage: Callable[[str], str]
) -> None:
    robustness.motor_range(MotorModel(2.86, 0.22, 0.002))
    cache = RobustnessCache(tmp_path)
    cache.save()
    assert cache.file is not None
    whole = cache.file.read_text(encoding="ascii")
    cache.file.write_text(damage(whole), encoding="ascii")
    assert damage(whole) != whole
    nothing_known.clear()
    RobustnessCache(tmp_path).load()
    assert nothing_known == {}


@pytest.mark.parametrize("known", [(), (1.0,), (1.0, float("nan")), (1.0, float("inf"))])
def test_figures_of_another_form_are_computed_anew(
    nothing_known: dict[str, tuple[float, ...]], known: tuple[float, ...]
) -> None:
    assert robustness.cached(("question",), 2, lambda: (1.0, 2.0)) == (1.0, 2.0)
    (key,) = nothing_known
    nothing_known[key] = known
    assert robustness.cached(("question",), 2, lambda: (3.0, 4.0)) == (3.0, 4.0)


def test_figures_that_were_asked_for_least_lately_are_forgotten_first(
    nothing_known: dict[str, tuple[float, ...]],
) -> None:
    """The first ones are those of the tuning in force: they are asked for again and again."""
    for number in range(robustness.MOST + 1):
        for asked in (0, number):
            robustness.cached((asked,), 1, partial(lambda value: (value,), float(asked)))
    assert len(nothing_known) == robustness.MOST
    assert (0.0,) in nothing_known.values()
    assert (1.0,) not in nothing_known.values()
    assert (2.0,) in nothing_known.values()
