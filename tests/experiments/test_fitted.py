"""Ready-made experiments on an actuator without tendons: stiffnesses in its range, no criteria on tension."""

import pytest

from backend.control import compute_bounds
from backend.experiments import library
from plant.parameters import OF_OTHER_MECHANISMS, load_parameters


@pytest.mark.parametrize("name", OF_OTHER_MECHANISMS)
def test_tracking_uses_the_same_shares_of_the_stiffness_range(name: str) -> None:
    parameters = load_parameters(name)
    bounds = compute_bounds(parameters)
    definition = library.build_fitted_definition("tracking", parameters)
    settings = {setting.name: setting for setting in definition.settings}
    for setting, share in (("S_low", 0.0), ("S_hold", 2.0 / 7.0), ("S_high", 6.0 / 7.0)):
        expected = bounds.S_min + share * (bounds.S_max - bounds.S_min)
        assert settings[setting].default == pytest.approx(expected, abs=1e-6)
        assert (settings[setting].minimum, settings[setting].maximum) == (bounds.S_min, bounds.S_max)
    assert settings["q_amplitude"].default == library.find_experiment("tracking").settings[0].default
    assert definition.experiment is not None
    assert "min_tension_N" not in [criterion.figure for criterion in definition.experiment.criteria]
    segments = definition.default_plan.program().segments
    assert all(bounds.S_min <= segment.S_ref <= bounds.S_max for segment in segments)


def test_experiments_of_tendons_are_unchanged() -> None:
    for name in library.READY_NAMES:
        assert library.build_fitted_definition(name, load_parameters("lab")) is library.find_experiment(name)
