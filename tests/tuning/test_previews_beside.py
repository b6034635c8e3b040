"""What a tuning would do is the same computed from what goes to another process as from the tuning in use."""

import pickle
from dataclasses import replace

from backend.services import background_work
from backend.services.background_work import TuningSnapshot
from backend.services.tuning_state import default_tuning
from plant.parameters import load_parameters


def test_previews_of_a_snapshot_are_the_same() -> None:
    tuning, _ = default_tuning(load_parameters("lab"))
    asked = pickle.loads(pickle.dumps(TuningSnapshot.from_active(tuning)))
    wanted = 0.6, 0.5, 10.0, -1.0, None, None, None, True
    assert background_work.preview_tuning(asked, *wanted) == tuning.preview(0.6, 0.5, 10.0, -1.0, printed=True)
    assert background_work.preview_motor(asked, 0.2) == tuning.preview_motor(0.2)
    assert background_work.compute_robust_tuning(asked, 1.5) == tuning.compute_robust_tuning(1.5)


def test_models_are_cached_for_equal_tunings_only() -> None:
    tuning, _ = default_tuning(load_parameters("lab"))
    asked = TuningSnapshot.from_active(tuning)
    first = asked.resolve().previewer
    assert asked.resolve().previewer is first
    assert replace(asked, choice=replace(asked.choice, lam_q=0.9)).resolve().previewer is first
    assert replace(asked, choice=replace(asked.choice, lam_motor=0.1)).resolve().previewer is not first
    assert replace(asked, parameters=load_parameters("ideal")).resolve().previewer is not first
