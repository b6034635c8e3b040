"""The example of the page Studies shows what its text states: the time of a step grows with λ."""

import re
from contextlib import closing
from pathlib import Path

import pytest

from backend.banks.tuning_settings import TuningSettings
from backend.services.studies import Studies
from backend.storage import studies
from backend.storage.database import open_database
from backend.studies.point import run_point
from backend.studies.stored import parse_design
from plant.parameters import load_parameters

PAGE = Path(__file__).parents[2] / "frontend/src/pages/studies/NewStudy.tsx"


def test_the_time_of_a_step_grows_with_lambda_whatever_the_operator_has_active(tmp_path: Path) -> None:
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
