"""The runs of a study, and the results of the example study."""

import itertools
import math
import re
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from backend.banks.tuning_settings import TuningSettings
from backend.errors import OutOfRangeError
from backend.errors import Path as Place
from backend.experiments.library import find_experiment
from backend.experiments.parser import ExperimentError
from backend.models.settings import SettingError
from backend.services.studies import Studies
from backend.storage import studies
from backend.storage.banks import Bank
from backend.storage.database import open_database
from backend.storage.orm import UnknownRecordError
from backend.storage.studies import StoredStudy
from backend.studies import messages
from backend.studies.design import Design
from backend.studies.point import list_variable_numbers, run_point
from backend.studies.stored import StudyContext, create_study, parse_design
from plant.message import Message
from plant.parameters import load_parameters
from tests.reasons import TextWith
from tests.refusals import refused_because

# The points of a study, against closed-form results.


def no_bank(number: int) -> Bank:
    raise UnknownRecordError(Message(f"there is no bank {number}", "no_such_bank", {"number": number}))


AROUND = StudyContext(find_experiment, load_parameters("lab"), TuningSettings().to_document(), no_bank)


def design(body: str) -> Design:
    new = create_study(f"format: 1\nname: a\ntitle: A\n{body}", AROUND, "Ana")
    kept = dict.fromkeys(("created_at", "seen_at", "begun_at"))
    stored = StoredStudy(**vars(new), id=1, runner="", begun_with=0, stop_asked=False, problem="", **kept)  # type: ignore[arg-type]  # nobody looks at its dates
    return parse_design(stored)


def test_a_grid_contains_all_combinations_and_the_last_axis_varies_fastest() -> None:
    grid = design("axes: [{over: lam_q, first: 0.4, last: 0.8, count: 3}, {over: lam_S, values: [0.3, 0.5]}]")
    found = [grid.point(number).settings for number in range(len(grid))]
    assert found == [{"lam_q": q, "lam_S": S} for q, S in itertools.product((0.4, 0.4 + 0.2, 0.8), (0.3, 0.5))]


def test_factor_spacing_gives_a_geometric_sequence_with_exact_ends() -> None:
    grid = design("axes: [{over: lam_q, first: 0.4, last: 1.6, count: 5, spacing: factor}]")
    values = [grid.point(number).settings["lam_q"] for number in range(5)]
    assert values[0] == 0.4
    assert values[-1] == 1.6
    assert values == pytest.approx([0.4 * 4.0 ** (index / 4) for index in range(5)])


def test_every_combination_uses_the_same_draws_and_noise_seeds() -> None:
    study = design(
        "axes: [{over: lam_q, values: [0.5, 0.8]}]\nspread: [{of: motor.c0, relative: 0.1}]\ndraws: 3\nseeds: 2"
    )
    points = [study.point(number) for number in range(len(study))]
    assert len(points) == 2 * 3 * 2
    assert [point.plant for point in points[:6]] == [point.plant for point in points[6:]]
    assert [point.settings["seed"] for point in points] == [0, 1] * 6
    assert len({point.plant["motor.c0"] for point in points}) == 3


def test_drawn_values_have_their_distribution() -> None:
    study = design(
        "spread:\n  - {of: motor.c0, relative: 0.2}\n  - {of: sensors.force_delay, by: normal, absolute: 0.001}\n"
        "  - {of: spring.k.1, relative: 0.1}\ndraws: 2000\nseed: 3"
    )
    lab = AROUND.parameters
    points = [study.point(number).plant for number in range(2000)]
    c0 = np.array([point["motor.c0"] for point in points]) / lab.motor.c0
    delay = np.array([point["sensors.force_delay"] for point in points]) - lab.sensors.force_delay
    k1 = np.array([point["spring.k.1"] for point in points]) / lab.spring.k[1]
    assert 0.8 <= c0.min() < 0.801 < 1.199 < c0.max() <= 1.2
    assert c0.std() == pytest.approx(0.2 / math.sqrt(3.0), rel=0.05)
    assert np.abs(delay).max() <= 0.003
    assert delay.std() == pytest.approx(0.001, rel=0.05)
    assert abs(np.corrcoef(c0, k1)[0, 1]) < 0.1


OVER: Place = ("axes", 0, "over")


@pytest.mark.parametrize(
    ("body", "place", "code", "values"),
    [
        ("axes: [{over: lam_q, values: [0.5, 9.0]}]", (4, OVER), "out_of_range", {"quantity": "lam_q", "value": 9.0}),
        ("axes: [{over: lam_x, values: [0.5]}]", (4, OVER), "bad_setting", {"quantity": "lam_x", "value": 0.5}),
        ("axes: [{over: motor.c9, values: [0.5]}]", (4, OVER), "unknown_plant_number", {"name": "motor.c9"}),
        ("axes: [{over: motor.c0, values: [big]}]", (4, OVER), "not_a_number", {"value": "big"}),
        ("axes: [{over: lam_q}]", (4, OVER[:2]), "values_or_range", {}),
        ("axes: [{over: lam_q, first: 0.4, last: 0.8}]", (4, OVER[:2]), "values_or_range", {}),
        (
            "axes: [{over: lam_q, values: [0.5]}, {over: lam_q, values: [0.6]}]",
            (4, ("axes", 1, "over")),
            "varied_twice",
            {"name": "lam_q"},
        ),
        (
            "axes: [{over: q_hold, first: -1.0, last: 1.0, count: 3, spacing: factor}]",
            (4, ("axes", 0, "spacing")),
            "no_equal_factors",
            {"first": -1.0, "last": 1.0},
        ),
        ("spread: [{of: motor.c0}]", (4, ("spread", 0)), "relative_or_absolute", {}),
        ("draws: 10", (4, ("draws",)), "draws_without_spread", {}),
        ("axes: [{over: seed, values: [1, 2]}]\nseeds: 3", (5, ("seeds",)), "seed_is_an_axis", {}),
        (
            "seeds: 100000\ndraws: 2\nspread: [{of: motor.c0, relative: 0.1}]",
            (1, ()),
            "out_of_range",
            {"label": messages.runs_of_study(), "value": 200_000},
        ),
        ("experiment: sequence", (4, ("experiment",)), "no_experiment_document", {"name": "sequence"}),
        ("settings: {lam_q: 0.5, b: 3}", (4, ("settings", "b")), "out_of_range", {"quantity": "b", "value": 3.0}),
        ("axes: [{over: bank, values: [3]}]", (4, OVER), "no_such_bank", {"number": 3}),
        ("settings: {bank: 9}", (4, ("settings", "bank")), "no_such_bank", {"number": 9}),
        (
            "axes:\n  - {over: lam_q, values: [0.5]}\n  - {over: bank, values: [7]}",
            (6, ("axes", 1, "over")),
            "no_such_bank",
            {"number": 7},
        ),
        ("axes: [{over: lam_q, values: [0.5, 0.6, 0.5]}]", (4, OVER), "value_given_twice", {"value": 0.5}),
        ("axes: [{over: lam_q, first: 0.5, last: 0.5, count: 4}]", (4, OVER), "value_given_twice", {"value": 0.5}),
        ("settings: {seed: 2147483646}\nseeds: 3", (5, ("seeds",)), "out_of_range", {"quantity": "seed"}),
        (
            "axes: [{over: spring.k.0, values: [-2.5]}, {over: spring.k.00, values: [-2.6]}]",
            (4, ("axes", 1, "over")),
            "unknown_plant_number",
            {"name": "spring.k.00"},
        ),
        ("axis: []", (4, ("axis",)), "unknown_key", {}),
        ("written: {format: 1, name: b, title: B, phases: []}", (4, ("written", "phases")), "list_is_empty", {}),
    ],
)
def test_an_invalid_study_is_rejected_with_line_value_and_bound(
    body: str, place: tuple[int, Place], code: str, values: dict[str, object]
) -> None:
    with refused_because(ExperimentError, code, **values) as caught:
        design(body)
    assert (caught.value.line, caught.value.path) == place


@pytest.mark.parametrize(
    ("body", "values"),
    [
        (
            "axes: [{over: motor.c0, values: [50.0]}]",
            {"label": TextWith(r"motor\.c0$"), "value": 50.0, "minimum": 0.0, "maximum": 10.0, "unit": "N·m"},
        ),
        ("spread: [{of: asymmetry.spring_A, by: normal, relative: 0.3}]", {"minimum": 0.5, "maximum": 2.0}),
    ],
)
def test_a_physically_impossible_parameter_is_rejected_with_line_value_and_bound(
    body: str, values: dict[str, object]
) -> None:
    with refused_because(ExperimentError, "parameter_out_of_range", **values) as caught:
        design(body)
    assert caught.value.line == 4


def test_names_and_settings_of_the_experiment_of_a_study_are_checked() -> None:
    with refused_because(SettingError, "unknown_experiment"):
        design("experiment: nothing")
    with pytest.raises(OutOfRangeError) as caught:
        design("settings: {S_low: 13.0, S_high: 12.0}")
    assert (caught.value.quantity, caught.value.value, caught.value.maximum) == ("S_low", 13.0, 12.0)


def test_a_study_may_contain_its_own_experiment() -> None:
    written = (
        "written:\n  format: 1\n  name: own\n  title: Own\n  settings:\n"
        "    - {name: depth, symbol: a, unit: rad, meaning: amplitude, default: 0.3, minimum: 0.1, maximum: 0.8}\n"
        "  phases:\n    - name: one\n      title: One\n      parts:\n"
        "        - {do: step, q_ref: depth, duration_s: 1.0}\n"
        "axes: [{over: depth, values: [0.2, 0.4]}]"
    )
    assert len(design(written)) == 2
    with refused_because(ExperimentError, "unknown_name", name="width") as caught:
        design(written.replace("q_ref: depth", "q_ref: width"))
    assert (caught.value.line, caught.value.path) == (14, ("written", "phases", 0, "parts", 0, "q_ref"))


def test_every_offered_parameter_can_be_varied() -> None:
    parameters = load_parameters("lab")
    offered = list_variable_numbers(parameters)
    assert {"motor.c0", "spring.k.1", "asymmetry.spring_A", "sensors.force_delay"} <= {one.name for one in offered}
    document = parameters.to_document()
    for one in offered:
        section, entry, *index = one.name.split(".")
        parameter = document[section][entry]
        assert one.value == (parameter["value"][int(index[0])] if index else parameter["value"])
        assert one.unit == parameter["unit"]
        assert len(design(f"axes: [{{over: {one.name}, values: [{one.value!r}]}}]")) == 1


# The example of the page Studies shows what its text states: the time of a step grows with λ.

PAGE = Path(__file__).parents[2] / "frontend/src/pages/studies/NewStudy.tsx"


def test_step_times_of_the_example_study_grow_with_lambda_for_any_active_tuning(tmp_path: Path) -> None:
    found = re.search(r"const EXAMPLE = `(.*?)`", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert found is not None
    active = TuningSettings(motion="time-optimal").to_document()
    with closing(open_database(tmp_path)) as database:
        study = Studies(database).create(found.group(1), "Ana", load_parameters("lab"), active).id
        with database.reading() as session:
            design = parse_design(studies.get(session, study))
    first, last = design.point(0), design.point(len(design) - 1)
    slow, fast = last.settings["lam_q"], first.settings["lam_q"]
    rows = [run_point(design.base, point) for point in (first, last)]
    assert [row.state for row in rows] == ["completed", "completed"]
    reach = [row.figures["rise_q_s"] for row in rows]
    assert isinstance(reach[0], float)
    assert isinstance(reach[1], float)
    # At the smaller λ the governor limits the largest steps, so their rise times differ by less than λ.
    assert reach[1] / reach[0] > 0.7 * float(slow) / float(fast)
    assert float(slow) / float(fast) == pytest.approx(2.5)
