"""Parameter files of a plant."""

import json
import math
import re
import tomllib
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import plant.parameters
from plant.dynamics import Spring, polynomial_spring, require_stiffening, tabulated_spring
from plant.parameters import (
    MECHANISMS,
    SECTIONS,
    SHIPPED,
    SIDED,
    MotorParameters,
    ParameterError,
    PlantParameters,
    load_parameters,
    parse_parameters,
)
from tests.reasons import assert_reason
from tests.refusals import refused

# Parameter files: accepted and rejected entries, and the remedies in the messages.

TEXT = (Path(plant.parameters.__file__).parent / "parameters" / "lab.toml").read_text(encoding="utf-8")
POINTS = "[[0.0065, 0.0], [0.02, 7.0], [0.035, 19.0], [0.05, 35.0], [0.0625, 51.5]]"


def load(tmp_path: Path, text: str) -> plant.parameters.PlantParameters:
    path = tmp_path / "bench.toml"
    path.write_text(text, encoding="utf-8")
    return load_parameters(path)


def edited(pattern: str, replacement: str) -> str:
    text, count = re.subn(pattern, lambda _: replacement, TEXT, count=1)
    assert count == 1, f"no {pattern} in lab.toml"
    return text


@pytest.mark.parametrize("name", SHIPPED)
def test_every_number_of_the_shipped_sets_has_a_unit_and_a_source(name: str) -> None:
    document = load_parameters(name).to_document()
    assert list(document) == list(SECTIONS)
    for section, entries in document.items():
        for entry, given in entries.items():
            assert given["unit"], f"{section}.{entry}"
            assert given["source"], f"{section}.{entry}"


def test_shipped_sets_contain_the_identified_constants_of_the_paper() -> None:
    for name in SHIPPED:
        known = load_parameters(name).identified
        assert (known.K_m, known.T_m, known.k) == (2.86, 0.22, (-2.498, 331.49, 8543.8))


def test_both_sides_of_the_joint_have_the_same_bounds() -> None:
    pairs = 0
    for section, kind in SECTIONS.items():
        of_section = {entry.name: entry.metadata for entry in fields(kind)}
        for name, metadata in of_section.items():
            if name.endswith("_A"):
                pairs += 1
                assert metadata == of_section[f"{name[:-2]}_B"], f"{section}.{name}"
    assert pairs >= 2


def reason(make: Callable[[], object]) -> str:
    """Return why a spring cannot be made."""
    try:
        make()
    except ValueError as error:
        return str(error)
    raise AssertionError("the spring can be made")


def tabulated(*points: tuple[float, float]) -> Spring:
    x, F = np.array(points).T
    return tabulated_spring(x, F, *SOLID)


SOLID = (0.06135, 1e5)
MOTOR_ENTRIES = [entry.name for entry in fields(MotorParameters)]


@pytest.mark.parametrize(
    ("pattern", "replacement", "code", "values"),
    [
        (
            r"r_m = \{ value = 7.5e-3",
            "r_m = { value = 7.5",
            "parameter_out_of_range",
            {"label": "bench.toml: geometry.r_m", "value": 7.5, "minimum": 1e-4, "maximum": 1.0, "unit": "m"},
        ),
        (
            r"c1 = \{ value = [\d.]+",
            "c1 = { value = nan",
            "parameter_not_finite",
            {"label": "bench.toml: motor.c1", "value": pytest.approx(math.nan, nan_ok=True)},
        ),
        (
            r"c0 = \{ value = [\d.]+",
            'c0 = { value = "0.1"',
            "parameter_not_finite",
            {"label": "bench.toml: motor.c0", "value": "0.1"},
        ),
        (
            r"(?m)^K_t = .*$",
            "",
            "parameter_incomplete",
            {"label": "bench.toml: motor.K_t", "unit": "N·m/V"},
        ),
        (
            r"(?m)^K_t = .*$",
            "K_t = 0.3",
            "parameter_incomplete",
            {"label": "bench.toml: motor.K_t", "unit": "N·m/V"},
        ),
        (
            r'unit = "kg·m²"',
            'unit = "g·m²"',
            "parameter_in_other_unit",
            {"label": "bench.toml: geometry.J_j", "unit": "g·m²", "expected": "kg·m²"},
        ),
        (
            r"(?m)^c0 =",
            "c_0 =",
            "unknown_parameter",
            {"file": "bench.toml", "section": "motor", "name": "c_0", "known": MOTOR_ENTRIES},
        ),
        (
            r"\[sensors\]",
            "[sensor]",
            "unknown_section",
            {"file": "bench.toml", "section": "sensor", "known": [*SECTIONS, *SIDED, *MECHANISMS]},
        ),
        (
            r"\[safety\]",
            "[[safety]]",
            "section_without_entries",
            {"file": "bench.toml", "section": "safety", "value": [tomllib.loads(TEXT)["safety"]]},
        ),
        (
            r"value = \[-2.498, 331.49, 8543.8\]",
            "value = [3.0, 300.0, 8000.0]",
            "spring_unusable",
            {
                "label": "bench.toml: spring",
                "reason": reason(lambda: polynomial_spring((3.0, 300.0, 8000.0), *SOLID)),
            },
        ),
        (
            r"value = \[-2.498, 331.49, 8543.8\]",
            "value = [-2.0, 300.0]",
            "spring_order_out_of_range",
            {"label": "bench.toml: spring", "coefficients": 2},
        ),
        (
            r"value = \[-2.498, 331.49, 8543.8\]",
            "value = 3.0",
            "parameter_is_not_a_list",
            {"label": "bench.toml: spring.k", "value": 3.0, "items": "numbers"},
        ),
        (
            r"x_solid = \{ value = 0.06135",
            "x_solid = { value = 0.09",
            "spring_force_too_large",
            {"label": "bench.toml: spring", "x_solid": 0.09, "F_max": 50.0},
        ),
    ],
)
def test_an_invalid_entry_is_rejected_with_name_bound_and_unit(
    tmp_path: Path, pattern: str, replacement: str, code: str, values: dict[str, object]
) -> None:
    with refused(ParameterError, code, **values):
        load(tmp_path, edited(pattern, replacement))


def test_a_missing_or_malformed_file_is_rejected(tmp_path: Path) -> None:
    absent = tmp_path / "absent.toml"
    with refused(ParameterError, "parameters_unreadable", name=str(absent), shipped=("ideal", "lab", "lab-stick")):
        load_parameters(absent)
    with refused(ParameterError, "parameters_are_not_toml", file="bench.toml"):
        load(tmp_path, "[geometry")


def test_the_sides_may_differ(tmp_path: Path) -> None:
    extra = '[motor_B]\nK_m = { value = 2.5, unit = "rad/(V·s)", source = "bench" }\n'
    extra += f'[spring_A]\npoints = {{ value = {POINTS}, unit = "m, N", source = "bench" }}\n'
    extra += '[identified_A]\nk = { value = [-2.0, 300.0, 8800.0], unit = "N/m^i", source = "bench" }\n'
    parameters = load(tmp_path, f"{TEXT}\n{extra}")
    assert (parameters.select_motor("A").K_m, parameters.select_motor("B").K_m) == (parameters.motor.K_m, 2.5)
    assert parameters.select_motor("B").T_m == parameters.motor.T_m
    assert parameters.select_spring("A").k == ()
    assert parameters.select_spring("B").points == ()
    assert parameters.make_identified_spring("A").k == (-2.0, 300.0, 8800.0)
    assert parameters.make_identified_spring("B").k == (-2.498, 331.49, 8543.8)
    plant_A, plant_B = parameters.make_dynamics().spring_A, parameters.make_dynamics().spring_B
    assert plant_A.pieces is not None
    assert plant_B.pieces is None
    document = parameters.to_document()
    assert document["motor_B"] == {"K_m": {"value": 2.5, "unit": "rad/(V·s)", "source": "bench"}}
    assert document["spring_A"]["points"]["value"][1] == [0.02, 7.0]
    assert "points" not in document["spring"]


@pytest.mark.parametrize(
    ("section", "code", "values"),
    [
        (
            '[motor_B]\nu_max = { value = 5.0, unit = "V", source = "x" }',
            "output_range_of_one_side",
            {"file": "bench.toml", "side": "B"},
        ),
        (
            '[spring_B]\npoints = { value = [[0.0065, 0.0], [0.02, 7.0, 1.0]], unit = "m, N", source = "x" }',
            "row_of_other_length",
            {"label": "bench.toml: spring_B.points", "row": [0.02, 7.0, 1.0], "length": 2, "unit": "m, N"},
        ),
        (
            '[spring_B]\npoints = { value = [[0.0065, 0.0], [0.02, 7.0], [0.05, 6.0]], unit = "m, N", source = "x" }',
            "spring_unusable",
            {
                "label": "bench.toml: spring_B",
                "reason": reason(lambda: tabulated((0.0065, 0.0), (0.02, 7.0), (0.05, 6.0))),
            },
        ),
        (
            '[identified_A]\npoints = { value = [[0.0065, 0.0], [0.02, 7.0], [0.0625, 30.0]], unit = "m, N", '
            'source = "x" }\nk = { value = [-2.0, 300.0, 8000.0], unit = "N/m^i", source = "x" }',
            "spring_without_one_curve",
            {"label": "bench.toml: identified_A"},
        ),
        (
            "[identified_A]\npoints = { value = [[0.0065, 0.0], [0.02, 12.0], [0.04, 24.0], [0.0625, 37.0]], "
            'unit = "m, N", source = "x" }',
            "spring_unusable",
            {
                "label": "bench.toml: identified_A",
                "reason": reason(
                    lambda: require_stiffening(tabulated((0.0065, 0.0), (0.02, 12.0), (0.04, 24.0), (0.0625, 37.0)))
                ),
            },
        ),
    ],
)
def test_an_invalid_side_is_rejected_by_its_name(
    tmp_path: Path, section: str, code: str, values: dict[str, object]
) -> None:
    with refused(ParameterError, code, **values):
        load(tmp_path, f"{TEXT}\n{section}\n")


# Numbers of friction that sticks: left out, given for one side, refused, stored and read back.

FOLDER = Path(plant.parameters.__file__).parent / "parameters"
STICK, LAB = ((FOLDER / f"{name}.toml").read_text(encoding="utf-8") for name in ("lab-stick", "lab"))
OWN = ("sigma_0", "sigma_1", "stiction_ratio", "omega_s")


def load_stiction(tmp_path: Path, text: str) -> PlantParameters:
    path = tmp_path / "bench.toml"
    path.write_text(text, encoding="utf-8")
    return load_parameters(path)


def number(name: str, value: float) -> str:
    unit = next(entry.metadata["unit"] for entry in fields(MotorParameters) if entry.name == name)
    return f'{name} = {{ value = {value}, unit = "{unit}", source = "bench" }}\n'


def without(text: str, *names: str) -> str:
    for name in names:
        text, count = re.subn(rf"(?m)^{name} = .*\n", "", text)
        assert count == 1, name
    return text


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_a_set_without_bristles_uses_smoothed_friction_and_keeps_its_document(name: str) -> None:
    parameters = load_parameters(name)
    assert [getattr(parameters.motor, entry) for entry in OWN] == [0.0] * 4
    assert not set(OWN) & set(parameters.to_document()["motor"])
    assert parameters.make_dynamics().motor_A.friction.lugre is None


def test_bristle_parameters_survive_a_stored_document() -> None:
    parameters = load_parameters("lab-stick")
    kept = json.loads(json.dumps(parameters.to_document()))
    assert parse_parameters("lab-stick", kept) == parameters
    for name in OWN:
        del kept["motor"][name]
    assert parse_parameters("lab", kept).motor == load_parameters("lab").motor


def test_static_friction_may_differ_between_the_sides(tmp_path: Path) -> None:
    smooth_B = load_stiction(tmp_path, f"{STICK}\n[motor_B]\n{number('sigma_0', 0)}")
    only_A = load_stiction(tmp_path, f"{LAB}\n[motor_A]\n{''.join(map(number, OWN, (60.0, 0.5, 1.5, 0.1)))}")
    for parameters, sigma_0 in ((smooth_B, 40.0), (only_A, 60.0)):
        A, B = (
            motor.friction.lugre for motor in (parameters.make_dynamics().motor_A, parameters.make_dynamics().motor_B)
        )
        assert A is not None
        assert A.sigma_0 == sigma_0
        assert B is None
        assert parse_parameters(parameters.name, parameters.to_document()) == parameters
    assert smooth_B.to_document()["motor_B"]["sigma_0"]["value"] == 0.0


def test_a_bristle_stiffness_of_zero_is_stored(tmp_path: Path) -> None:
    parameters = load_stiction(tmp_path, re.sub(r"(?m)^sigma_0 = .*\n", number("sigma_0", 0), STICK))
    assert parameters.make_dynamics() == load_parameters("lab").make_dynamics()
    assert parameters.to_document()["motor"]["sigma_0"]["value"] == 0.0
    assert parse_parameters("bench", parameters.to_document()) == parameters


@pytest.mark.parametrize(
    ("text", "code", "values"),
    [
        (
            without(STICK, "sigma_0"),
            "static_friction_undecided",
            {"label": "bench.toml: motor", "given": ["sigma_1", "stiction_ratio", "omega_s"]},
        ),
        (
            without(STICK, "stiction_ratio"),
            "static_friction_incomplete",
            {"label": "bench.toml: motor", "missing": "stiction_ratio"},
        ),
        (
            without(STICK, "omega_s"),
            "static_friction_incomplete",
            {"label": "bench.toml: motor", "missing": "omega_s"},
        ),
        (
            without(STICK, "c0").replace("[identified]", number("c0", 0) + "[identified]"),
            "static_friction_without_coulomb_friction",
            {"label": "bench.toml: motor"},
        ),
        (
            STICK.replace("value = 40.0", "value = -1.0"),
            "parameter_out_of_range",
            {
                "label": "bench.toml: motor.sigma_0",
                "value": -1.0,
                "minimum": 0.0,
                "maximum": 1e5,
                "unit": "N·m/rad",
            },
        ),
        (
            STICK.replace("value = 1.4", "value = 0.9"),
            "parameter_out_of_range",
            {"label": "bench.toml: motor.stiction_ratio", "value": 0.9, "minimum": 1.0, "maximum": 10.0},
        ),
        (
            STICK.replace("value = 0.6", "value = 900"),
            "bristles_too_stiff",
            {"label": "bench.toml: motor", "name": "sigma_1", "value": 900.0},
        ),
        (
            f"{LAB}\n[motor_B]\n{number('sigma_1', 0.6)}",
            "static_friction_undecided",
            {"label": "bench.toml: motor_B", "given": ["sigma_1"]},
        ),
        (
            f"{LAB}\n[motor_B]\n{number('sigma_0', 40.0)}",
            "static_friction_incomplete",
            {"label": "bench.toml: motor_B", "missing": "stiction_ratio"},
        ),
        (
            f"{STICK}\n[motor_A]\n{number('c0', 0.0)}",
            "static_friction_without_coulomb_friction",
            {"label": "bench.toml: motor_A"},
        ),
    ],
)
def test_friction_that_is_neither_static_nor_smoothed_is_rejected(
    tmp_path: Path, text: str, code: str, values: dict[str, object]
) -> None:
    with refused(ParameterError, code, **values):
        load_stiction(tmp_path, text)


# Other mechanisms ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "mechanism"),
    [("qbmove", "bidirectional"), ("bavs", "bidirectional"), ("awas2", "lever"), ("maccepa", "pretension")],
)
def test_a_set_of_another_mechanism_is_read_and_written(name: str, mechanism: str) -> None:
    parameters = load_parameters(name)
    assert parameters.mechanism_name == mechanism
    document = parameters.to_document()
    assert set(document) == {*SECTIONS, mechanism} - {"spring"}
    assert "F_max" not in document["safety"]
    assert all(entry["source"] for entries in document.values() for entry in entries.values())
    assert parse_parameters(name, document).to_document() == document


def test_tendons_are_the_mechanism_of_a_set_with_springs() -> None:
    assert load_parameters("lab").mechanism_name == "tendons"


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"lever": load_parameters("awas2").to_document()["lever"]}, "several_mechanisms"),
        ({"spring": load_parameters("lab").to_document()["spring"]}, "several_mechanisms"),
        ({"safety": load_parameters("lab").to_document()["safety"]}, "unknown_parameter"),
        ({"safety": {}}, "parameter_incomplete"),
        ({"bidirectional": {"kappa": [9.0]}}, "not_one_value_per_motor"),
        ({"bidirectional": {"preset_min": -0.3}}, "stiffness_does_not_rise"),
        ({"bidirectional": {"S_max": 4.0}}, "stiffness_range_not_reached"),
        ({"bidirectional": {"S_min": math.nan}}, "parameter_not_finite"),
        ({"safety": {"deflection_max": {"value": 0.55, "unit": "rad", "source": ""}}}, "deflected_beyond_trip_at_rest"),
    ],
)
def test_an_inconsistent_mechanism_is_rejected(change: dict[str, dict[str, Any]], code: str) -> None:
    document = load_parameters("qbmove").to_document()
    for section, entries in change.items():
        if section == "bidirectional":
            for name, value in entries.items():
                document[section][name]["value"] = value
        else:
            document[section] = entries
    with pytest.raises(ParameterError) as rejected:
        parse_parameters("changed", document)
    assert_reason(rejected.value.args[0], code)
