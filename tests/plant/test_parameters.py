"""Parameter files: what is read, what is refused and how the refusal says what to mend."""

import re
from pathlib import Path

import pytest

import plant.parameters
from plant.parameters import SECTIONS, SHIPPED, ParameterError, load_parameters

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
def test_shipped_sets_give_every_number_a_unit_and_a_source(name: str) -> None:
    document = load_parameters(name).to_document()
    assert list(document) == list(SECTIONS)
    for section, entries in document.items():
        for entry, given in entries.items():
            assert given["unit"], f"{section}.{entry}"
            assert given["source"], f"{section}.{entry}"


def test_shipped_sets_know_the_papers_identified_constants() -> None:
    for name in SHIPPED:
        known = load_parameters(name).identified
        assert (known.K_m, known.T_m, known.k) == (2.86, 0.22, (-2.498, 331.49, 8543.8))


@pytest.mark.parametrize(
    ("pattern", "replacement", "said"),
    [
        (r'r_m = \{ value = 7.5e-3', 'r_m = { value = 7.5', r"geometry\.r_m = 7\.5 m is outside 0\.0001 to 1 m"),
        (r"c1 = \{ value = [\d.]+", "c1 = { value = nan", r"motor\.c1 = nan is not a finite number"),
        (r"c0 = \{ value = [\d.]+", 'c0 = { value = "0.1"', r"motor\.c0 = '0\.1' is not a finite number"),
        (r'(?m)^K_t = .*$', "", r'motor\.K_t must read \{ value = \.\.\., unit = "N·m/V", source = "\.\.\." \}'),
        (r'(?m)^K_t = .*$', "K_t = 0.3", r"motor\.K_t must read"),
        (r'unit = "kg·m²"', 'unit = "g·m²"', r"geometry\.J_j is in 'g·m²': give it in 'kg·m²'"),
        (r"(?m)^c0 =", "c_0 =", r"unknown entry motor\.c_0; known are K_m, T_m"),
        (r"\[sensors\]", "[sensor]", r"unknown section 'sensor'; known are geometry, spring"),
        (r"\[safety\]", "[[safety]]", r"safety = \[.*\] must be a section: \[safety\]"),
        (r"value = \[-2.498, 331.49, 8543.8\]", "value = [3.0, 300.0, 8000.0]", r"spring: .* no zero-force root"),
        (r"value = \[-2.498, 331.49, 8543.8\]", "value = [-2.0, 300.0]", r"spring\.k has 2 coefficients: give 3 to 6"),
        (r"value = \[-2.498, 331.49, 8543.8\]", "value = 3.0", r"spring\.k = 3\.0 must be a list of numbers"),
        (r"x_solid = \{ value = 0.06135", "x_solid = { value = 0.09", r"carries .* N, far above safety\.F_max = 50 N"),
    ],
)  # fmt: skip
def test_a_bad_entry_is_refused_by_name_bound_and_unit(
    tmp_path: Path, pattern: str, replacement: str, said: str
) -> None:
    with pytest.raises(ParameterError, match=rf"^bench\.toml: .*{said}"):
        load(tmp_path, edited(pattern, replacement))


def test_a_file_that_is_missing_or_no_toml_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="use one of ideal, lab, lab-stick or a TOML file"):
        load_parameters(tmp_path / "absent.toml")
    with pytest.raises(ParameterError, match=r"bench\.toml is not a TOML file"):
        load(tmp_path, "[geometry")


def test_one_side_may_differ(tmp_path: Path) -> None:
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
    ("section", "said"),
    [
        ('[motor_B]\nu_max = { value = 5.0, unit = "V", source = "x" }', r"motor_B\.u_max: the output range is one"),
        (
            '[spring_B]\npoints = { value = [[0.0065, 0.0], [0.02, 7.0, 1.0]], unit = "m, N", source = "x" }',
            r"spring_B\.points: row \[0\.02, 7\.0, 1\.0\] must hold 2 numbers \[m, N\]",
        ),
        (
            '[spring_B]\npoints = { value = [[0.0065, 0.0], [0.02, 7.0], [0.05, 6.0]], unit = "m, N", source = "x" }',
            r"spring_B: elongation .* must both rise from row to row, but do not after row 2",
        ),
        (
            '[identified_A]\npoints = { value = [[0.0065, 0.0], [0.02, 7.0], [0.0625, 30.0]], unit = "m, N", '
            'source = "x" }\nk = { value = [-2.0, 300.0, 8000.0], unit = "N/m^i", source = "x" }',
            r"identified_A must give the spring once, by the polynomial k or by points",
        ),
        (
            '[identified_A]\npoints = { value = [[0.0065, 0.0], [0.02, 12.0], [0.04, 24.0], [0.0625, 37.0]], '
            'unit = "m, N", source = "x" }',
            r"identified_A: the spring does not stiffen at x = ",
        ),
    ],
)  # fmt: skip
def test_a_bad_side_is_refused_by_its_own_name(tmp_path: Path, section: str, said: str) -> None:
    with pytest.raises(ParameterError, match=rf"^bench\.toml: {said}"):
        load(tmp_path, f"{TEXT}\n{section}\n")
