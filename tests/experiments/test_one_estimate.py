"""Stored estimate, report and data file of a run agree."""

import json
import re
import shlex
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backend.analysis.identification import build_actuator_record, identify_actuator
from backend.cli import main
from backend.experiments.plans import ActuatorIdentificationPlan
from backend.identification.actuator import ActuatorIdentification
from backend.identification.fitting import Method
from backend.models.identification import ChannelName
from backend.models.run import Metrics
from backend.reports.build import build_report
from backend.reports.identification_report import build_estimate_command
from backend.reports.model import Code, Paragraph, Report
from backend.reports.run_data import RunData
from backend.storage.identifications import Identification
from plant.interface import T_s
from plant.parameters import load_parameters
from tests.exports.written import to_csv
from tests.reports.tracking_run import BEGAN, PLAN, samples, source_of

CHANNELS = ("G_q", "G_S")
REST = 1_500
LAG_S = 0.0854
PLAY_RAD = 0.4


def columns_of(plan: ActuatorIdentificationPlan) -> dict[str, np.ndarray]:
    """Four lags; the joint follows with play, as dry friction makes it, the stiffness without; both in counts."""
    excitation = plan.excitation()
    levels = np.array([1.0 if level == "+" else -1.0 for level in excitation.levels])
    chips = np.repeat(np.tile(levels, excitation.periods), round(excitation.chip_s / T_s))
    u = np.concatenate([np.zeros(REST), chips])
    theta, pole = u, np.exp(-T_s / LAG_S)
    for _ in range(4):
        theta = np.array([state := 0.0] + [state := pole * state + (1 - pole) * value for value in theta[:-1]])
    followed, at = np.empty(theta.size), 0.0
    for k, value in enumerate(theta):
        at = min(max(at, value - PLAY_RAD / 2.0), value + PLAY_RAD / 2.0)
        followed[k] = at
    count_q, count_theta = 2 * np.pi / 4000, 2 * np.pi / 8000
    return {
        "t": np.arange(u.size) * T_s,
        "theta_A_ref": 9.0 + u,
        "q": np.round((0.47 + 0.05 * followed) / count_q) * count_q,
        "S": 10.5 + 0.7209 * np.round(theta / count_theta) * count_theta,
        "F_A": np.full(u.size, 20.0),
        "F_B": np.full(u.size, 20.0),
    }


@pytest.fixture(scope="module")
def record() -> dict[str, np.ndarray]:
    return {
        name: values.astype(np.float32).astype(float)
        for name, values in columns_of(ActuatorIdentificationPlan()).items()
    }


@pytest.fixture(scope="module")
def found(record: dict[str, np.ndarray]) -> Identification:
    return stored(record, ActuatorIdentificationPlan())


@pytest.fixture(scope="module")
def by_arx(record: dict[str, np.ndarray]) -> Identification:
    return stored(record, ActuatorIdentificationPlan(estimator=Method.ARX))


def stored(record: dict[str, np.ndarray], plan: ActuatorIdentificationPlan) -> Identification:
    run = replace(source_of(samples(PLAN)).run, id=12)
    new = build_actuator_record(run, plan, record, _identified(record, plan), "0.1.0")
    document = json.loads(json.dumps({name: getattr(new, name) for name in ("data", "options", "model", "quality")}))
    return Identification(
        id=5, kind=new.kind, run_id=12, method=new.method, usable=new.usable, verdict=new.verdict, who=new.who,
        software=new.software, created_at=BEGAN, **document,
    )  # fmt: skip


def _identified(record: dict[str, np.ndarray], plan: ActuatorIdentificationPlan) -> ActuatorIdentification:
    return identify_actuator(record, plan.excitation(), load_parameters("lab"), Method(plan.estimator))


def report_of(found: Identification, record: dict[str, np.ndarray]) -> Report:
    tracked = source_of({name: column[:100] for name, column in samples(PLAN).items()})
    assert tracked.result is not None
    run = replace(
        tracked.run, kind="actuator_identification", settings={**tracked.run.settings, "plan": {"tension_N": 20.0}}
    )
    result = replace(tracked.result, metrics=Metrics(complete=True, played_s=1.0, planned_s=1.0), criteria=())
    return build_report(RunData(run, result, record, None, found))


def words_of(report: Report) -> str:
    blocks = [block for section in report.sections for block in section.blocks]
    return " ".join(block.text for block in blocks if isinstance(block, Paragraph | Code))


def test_the_report_names_the_estimator_of_each_channel(found: Identification, record: dict[str, np.ndarray]) -> None:
    methods = {key: found.model[key]["method"] for key in CHANNELS}
    assert methods == {"G_q": "output error, AR(8) noise", "G_S": "output error, low frequencies weighted"}
    named = f"G_q: {methods['G_q']}; G_S: {methods['G_S']}"
    assert found.method == named
    assert f"Method: {named}." in words_of(report_of(found, record))


def test_a_report_of_what_was_stored_before_names_both_too(
    found: Identification, record: dict[str, np.ndarray]
) -> None:
    old = replace(found, method=found.model["G_S"]["method"])
    assert f"Method: {found.method}." in words_of(report_of(old, record))


def test_the_papers_arx_names_itself_in_model_estimate_report_and_bank(
    by_arx: Identification, record: dict[str, np.ndarray]
) -> None:
    """A bank says of each entry what its identification was estimated by."""
    named = "ARX with low-pass prefilter"
    assert by_arx.method == named
    for key in CHANNELS:
        assert by_arx.model[key]["method"] == named
        assert by_arx.model[key]["structure"] == "first"
        assert by_arx.model[key]["first_order"]["K"] == by_arx.quality[key]["arx"]["K"]
    assert by_arx.options["estimator"] == "arx"
    assert f"Method: {named}." in words_of(report_of(by_arx, record))


@pytest.mark.parametrize("estimator", ["found", "by_arx"])
@pytest.mark.parametrize("key", CHANNELS)
def test_the_data_file_gives_the_same_estimate_by_the_command_in_the_report(
    key: ChannelName,
    estimator: str,
    request: pytest.FixtureRequest,
    record: dict[str, np.ndarray],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    found: Identification = request.getfixturevalue(estimator)
    command = build_estimate_command(found, key)
    assert command in words_of(report_of(found, record))
    (tmp_path / "data.csv").write_bytes(to_csv(record))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [*shlex.split(command.replace("\\\n", "")), "--json"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    printed = json.loads(capsys.readouterr().out)
    assert printed["method"] == found.model[key]["method"]
    stored, std_errors = found.model[key]["parameters"], found.model[key]["std_errors"]
    assert list(printed["parameters"]) == list(stored)
    # The file holds the digits of single precision, and the search stops within a thousandth of a standard error.
    assert all(abs(value - stored[name]) < 1e-2 * std_errors[name] for name, value in printed["parameters"].items())
    assert printed["std_errors"] == pytest.approx(std_errors, rel=1e-3)
    assert printed["verdict"] == found.quality[key]["verdict"]
    assert printed["grade"] == found.quality[key]["grade"]
    assert re.search(r"--resolution 0\.00", command)
