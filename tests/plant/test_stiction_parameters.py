"""Numbers of friction that sticks: left out, given for one side, refused, stored and read back."""

import json
import re
from dataclasses import fields
from pathlib import Path

import pytest

import plant.parameters
from plant.parameters import MotorParameters, ParameterError, PlantParameters, load_parameters, parse_parameters

FOLDER = Path(plant.parameters.__file__).parent / "parameters"
STICK, LAB = ((FOLDER / f"{name}.toml").read_text(encoding="utf-8") for name in ("lab-stick", "lab"))
OWN = ("sigma_0", "sigma_1", "stiction_ratio", "omega_s")


def load(tmp_path: Path, text: str) -> PlantParameters:
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
def test_a_set_without_them_is_smoothed_and_its_document_is_what_it_was(name: str) -> None:
    parameters = load_parameters(name)
    assert [getattr(parameters.motor, entry) for entry in OWN] == [0.0] * 4
    assert not set(OWN) & set(parameters.to_document()["motor"])
    assert parameters.make_dynamics().motor_A.friction.lugre is None


def test_they_come_back_from_a_stored_document() -> None:
    parameters = load_parameters("lab-stick")
    kept = json.loads(json.dumps(parameters.to_document()))
    assert parse_parameters("lab-stick", kept) == parameters
    for name in OWN:
        del kept["motor"][name]
    assert parse_parameters("lab", kept).motor == load_parameters("lab").motor


def test_one_side_may_stick_and_one_may_not(tmp_path: Path) -> None:
    smooth_B = load(tmp_path, f"{STICK}\n[motor_B]\n{number('sigma_0', 0)}")
    only_A = load(tmp_path, f"{LAB}\n[motor_A]\n{''.join(map(number, OWN, (60.0, 0.5, 1.5, 0.1)))}")
    for parameters, sigma_0 in ((smooth_B, 40.0), (only_A, 60.0)):
        A, B = (
            motor.friction.lugre for motor in (parameters.make_dynamics().motor_A, parameters.make_dynamics().motor_B)
        )
        assert A is not None
        assert A.sigma_0 == sigma_0
        assert B is None
        assert parse_parameters(parameters.name, parameters.to_document()) == parameters
    assert smooth_B.to_document()["motor_B"]["sigma_0"]["value"] == 0.0


def test_zero_is_an_answer_and_is_kept(tmp_path: Path) -> None:
    parameters = load(tmp_path, re.sub(r"(?m)^sigma_0 = .*\n", number("sigma_0", 0), STICK))
    assert parameters.make_dynamics() == load_parameters("lab").make_dynamics()
    assert parameters.to_document()["motor"]["sigma_0"]["value"] == 0.0
    assert parse_parameters("bench", parameters.to_document()) == parameters


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (without(STICK, "sigma_0"), r"motor\.sigma_0 is missing, without which sigma_1 and stiction_ratio and omega_s"),
        (without(STICK, "stiction_ratio"), r"motor\.stiction_ratio is missing: with sigma_0 above 0 friction sticks"),
        (without(STICK, "omega_s"), r"motor\.omega_s is missing: with sigma_0 above 0 friction sticks"),
        (without(STICK, "c0").replace("[identified]", number("c0", 0) + "[identified]"), r"motor\.c0 = 0 N·m with sig"),
        (STICK.replace("value = 40.0", "value = -1.0"), r"motor\.sigma_0 = -1 N·m/rad is outside 0 to 100000 N·m/rad"),
        (STICK.replace("value = 1.4", "value = 0.9"), r"motor\.stiction_ratio = 0\.9 1 is outside 1 to 10 1"),
        (STICK.replace("value = 0.6", "value = 900"), r"motor\.sigma_1 = 900 on a motor of .* kg·m² is .*/s fast"),
        (f"{LAB}\n[motor_B]\n{number('sigma_1', 0.6)}", r"motor_B\.sigma_0 is missing"),
        (f"{LAB}\n[motor_B]\n{number('sigma_0', 40.0)}", r"motor_B\.stiction_ratio is missing"),
        (f"{STICK}\n[motor_A]\n{number('c0', 0.0)}", r"motor_A\.c0 = 0 N·m with sigma_0 above 0"),
    ],
)  # fmt: skip
def test_what_can_neither_stick_nor_be_smoothed_is_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ParameterError, match=rf"^bench\.toml: {said}"):
        load(tmp_path, text)
