"""Times and references of played parts, compared with the program."""

from backend.experiments.compiler import list_played_parts
from backend.experiments.parser import parse_experiment
from backend.experiments.plans import ExperimentPlan

WRITTEN = """format: 1
name: loops
title: Loops
phases:
  - name: all
    title: All
    parts:
      - {do: step, q_ref: 0.1, duration_s: 1.0}
      - do: repeat
        times: 3
        parts:
          - {do: ramp, q_ref: 0.4, duration_s: 2.0}
          - {do: pulse, q_ref: 0.0, duration_s: 0.5, rest_s: 0.5}
"""


def test_each_played_part_has_path_times_and_references() -> None:
    experiment, lines = parse_experiment(WRITTEN)
    step, ramp, pulse = list_played_parts(ExperimentPlan(experiment, {}, lines=lines).compiled)
    assert step.path == ("phases", 0, "parts", 0)
    assert (step.start_s, step.end_s, step.q_from, step.q_to) == (0.0, 1.0, None, 0.1)
    assert ramp.path == ("phases", 0, "parts", 1, "parts", 0)
    assert (ramp.start_s, ramp.end_s, ramp.pieces, ramp.piece_s) == (1.0, 9.0, 3, 2.0)
    assert (ramp.q_from, ramp.q_to, ramp.S_from) == (0.1, 0.4, 10.0)
    assert (pulse.start_s, pulse.end_s, pulse.pieces) == (3.0, 10.0, 6)
