"""Texts of experiments for tests."""

from backend.experiments.parser import parse_experiment
from backend.experiments.plans import ExperimentPlan, build_experiment_plan

WOBBLE = """format: 1
name: wobble
title: Wobble
settings:
  - {name: depth, symbol: a, unit: rad, meaning: amplitude, default: 0.2, minimum: 0.01, maximum: 0.5}
phases:
  - name: lead_in
    title: Lead-in
    parts:
      - {do: step, q_ref: 0.0, S_ref: 10.0, duration_s: 6.0}
  - name: swing
    title: Swing
    parts:
      - {do: sine, q_amplitude: depth, period_s: 4.0, duration_s: 8.0}
      - {do: hold, duration_s: 2.0}
measures: [steps]
criteria:
  - {figure: min_tension_N, above: 4.0}
"""
"""Nineteen lines; the motions stand in lines 10, 14 and 15, the criterion in line 18."""


def with_parts(*parts: str, settings: str = "", more: str = "") -> str:
    """Return an experiment of one phase; without settings its parts begin in line 8."""
    listed = "".join(f"      - {part}\n" for part in parts)
    heading = f"format: 1\nname: tried\ntitle: Tried\n{settings}"
    return f"{heading}phases:\n  - name: all\n    title: All\n    parts:\n{listed}{more}"


def plan_of(text: str, **values: object) -> ExperimentPlan:
    experiment, lines = parse_experiment(text)
    return build_experiment_plan(experiment, values, lines=lines)
