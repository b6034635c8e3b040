"""From the samples of an identification run to a stored estimate with its lineage."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from backend.control.decoupler import decoupler_for, stiffness_slope
from backend.experiments.plans.plan import ActuatorIdentificationPlan
from backend.experiments.results.metrics import NoSamplesError, figure
from backend.identification.actuator import ActuatorGeometry, ActuatorIdentification, identify_actuator
from backend.identification.estimation import Candidates
from backend.identification.fitting import Method
from backend.identification.models import Estimate, Grade, joint_method
from backend.models.identification import (
    MODEL,
    QUALITY,
    ActuatorModel,
    ActuatorQuality,
    ArxEstimate,
    Candidate,
    ChannelModel,
    ChannelQuality,
    FailedCandidate,
    FrequencyEstimate,
    NoArx,
    Reduced,
    ResidualTest,
    ResidualTests,
)
from backend.realtime.program import Excitation
from backend.storage.identifications import NewIdentification
from backend.storage.runs import Run
from plant.interface import T_s
from plant.parameters import PlantParameters

Columns = Mapping[str, NDArray[np.float64]]

_COUNTS_WHERE_EXACT = 4000, 8000
"""Counts per turn of the paper's encoders, used where a parameter set has ideal sensors."""


@dataclass(frozen=True)
class IdentificationFigures:
    """What the actuator went through during the excitation."""

    motion_counts: float = figure("1", "Joint motion", "peak to peak during the excitation, in encoder counts")
    min_tension_N: float = figure("N", "Smallest tension", "of both load cells during the excitation")
    max_tension_N: float = figure("N", "Largest tension", "of both load cells during the excitation")
    peak_voltage_V: float = figure("V", "Peak voltage", "largest |u_A|, |u_B| during the excitation")


def excitation_start(columns: Columns, excitation: Excitation) -> int:
    """Return the index of the first excited sample of a run that played its program to the end.

    The travel to the nominal point takes as long as it takes, so the excitation is found from its end.
    Raises NoSamplesError when the samples are fewer than the excitation.
    """
    chip_ticks = max(round(excitation.chip_s / T_s), 1)
    ticks = excitation.periods * len(excitation.levels) * chip_ticks
    start = columns["t"].size - ticks
    if start < 0:
        raise NoSamplesError(f"the run holds {columns['t'].size} samples, fewer than the {ticks} of its excitation")
    return start


def identify(
    columns: Columns, excitation: Excitation, parameters: PlantParameters, method: Method = Method.DEFAULT
) -> ActuatorIdentification:
    """Estimate G_q and G_S from theta_A_ref, q and S of a completed run. Raises NoSamplesError, ValueError."""
    geometry, sensors = parameters.geometry, parameters.sensors
    q_counts, theta_counts = _COUNTS_WHERE_EXACT
    slope = stiffness_slope(decoupler_for(parameters), float(np.mean(columns["S"])))
    known = ActuatorGeometry(
        geometry.r_m,
        geometry.r_j,
        slope / (2.0 * geometry.r_j**2 * geometry.r_m),
        round(sensors.joint_counts) or q_counts,
        round(sensors.motor_counts) or theta_counts,
    )
    return identify_actuator(columns, T_s, known, excitation_start(columns, excitation), method=method)


def figures_of(columns: Columns, excitation: Excitation, estimate: ActuatorIdentification) -> IdentificationFigures:
    """Return what the actuator went through."""
    excited = slice(excitation_start(columns, excitation), None)
    tensions = np.concatenate([columns[name][excited] for name in ("F_A", "F_B")])
    voltages = np.concatenate([columns[name][excited] for name in ("u_A", "u_B")])
    return IdentificationFigures(
        motion_counts=estimate.motion_counts,
        min_tension_N=float(tensions.min()),
        max_tension_N=float(tensions.max()),
        peak_voltage_V=float(np.abs(voltages).max()),
    )


def to_store(
    run: Run, plan: ActuatorIdentificationPlan, columns: Columns, estimate: ActuatorIdentification, software: str
) -> NewIdentification:
    """Return the estimate as it is stored: model, quality, and which samples it came from."""
    start = excitation_start(columns, plan.excitation())
    signals = {"input": "theta_A_ref", "outputs": ["q", "S"]}
    channels = {"G_q": estimate.G_q, "G_S": estimate.G_S}
    return NewIdentification(
        kind="actuator",
        run_id=run.id,
        data={**signals, "first_sample": start, "samples": columns["t"].size - start, "period_s": T_s},
        method=joint_method({name: channel.method for name, channel in channels.items()}),
        options={**asdict(plan), "structures": {name: channel.model.structure for name, channel in channels.items()}},
        model=MODEL.write(
            ActuatorModel(
                S_nominal=estimate.S_nominal,
                q_nominal=estimate.q_nominal,
                G_q=_model(estimate.G_q),
                G_S=_model(estimate.G_S),
            )
        ),
        quality=QUALITY.write(
            ActuatorQuality(
                motion_counts=estimate.motion_counts,
                G_q=_quality(estimate.G_q, estimate.candidates_q, estimate.arx_q),
                G_S=_quality(estimate.G_S, estimate.candidates_S, estimate.arx_S),
            )
        ),
        usable=estimate.verdict.grade is not Grade.UNUSABLE,
        verdict=estimate.verdict.sentence,
        who=run.who,
        software=software,
    )


def _model(channel: Estimate) -> ChannelModel:
    return ChannelModel(
        structure=channel.model.structure,
        parameters=channel.model.parameters,
        std_errors=dict(channel.std_errors),
        covariance=tuple(tuple(row) for row in channel.covariance.tolist()),
        noise=channel.noise,
        method=channel.method,
        first_order=Reduced(**asdict(channel.first_order)),
    )


def _quality(channel: Estimate, candidates: Candidates, arx: Estimate | str) -> ChannelQuality:
    found = channel.residuals
    return ChannelQuality(
        fit_percent=channel.fit_percent,
        fit_all_percent=channel.fit_all_percent,
        gain_geometry=channel.gain_geometry,
        gain_error_percent=channel.gain_error_percent,
        y_resolution=channel.y_resolution,
        residuals=ResidualTests(
            whiteness=ResidualTest(**asdict(found.whiteness)),
            input_correlation=ResidualTest(**asdict(found.input_correlation)),
            std=found.std,
            AIC=found.AIC,
            BIC=found.BIC,
            FPE=found.FPE,
        ),
        frequency=FrequencyEstimate(**asdict(channel.frequency)),
        usable=channel.verdict.grade is not Grade.UNUSABLE,
        grade=channel.verdict.grade,
        verdict=channel.verdict.sentence,
        candidates=_candidates(candidates),
        arx=_arx(arx),
    )


def _arx(found: Estimate | str) -> ArxEstimate | NoArx:
    """Return what the paper's method gives on the same record, or why it gives nothing."""
    if isinstance(found, str):
        return NoArx(found)
    return ArxEstimate(method=found.method, fit_percent=found.fit_percent, **asdict(found.first_order))


def _candidates(candidates: Candidates) -> tuple[Candidate | FailedCandidate, ...]:
    """List every structure that was tried, best first, in brief; one that gave no model says why."""
    ranked = [
        Candidate(
            structure=candidate.model.structure,
            parameters=candidate.model.parameters,
            K=candidate.first_order.K,
            T=candidate.first_order.T,
            fit_percent=candidate.fit_percent,
            BIC=candidate.residuals.BIC,
            grade=candidate.verdict.grade,
        )
        for candidate in candidates.ranked
    ]
    return (*ranked, *(FailedCandidate(name, problem) for name, problem in candidates.failed.items()))
