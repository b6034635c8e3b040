"""The report of an actuator identification: the models, how far they can be trusted, and what the paper found."""

from collections.abc import Mapping

from backend.identification.models import TABLE_1, worst
from backend.identification.validation import judged
from backend.models.document import UnreadableDocumentError
from backend.models.identification import (
    CHANNELS,
    ArxEstimate,
    Candidate,
    Channel,
    ChannelName,
    FailedCandidate,
    ResidualTests,
)
from backend.reports.document import (
    NO_FIGURE,
    Block,
    Code,
    Column,
    Fact,
    Figure,
    Paragraph,
    Report,
    Section,
    Table,
    exact,
    share,
    shown,
)
from backend.reports.identification_figures import (
    STEP_RAD,
    WRITTEN,
    bode_panels,
    model_of,
    record_panels,
    residual_panels,
    step_panels,
)
from backend.reports.judgement import OUTCOMES, measured_figures
from backend.reports.model_code import actuator_blocks
from backend.reports.provenance import S_NOTE, facts, parameter_section, settings_table, subtitle
from backend.reports.reproduction import reproduction
from backend.reports.source import Source
from backend.storage.banks import method_of
from backend.storage.identifications import Identification
from backend.units import told

_STRUCTURES = {"first": "K/(Ts+1)", "third": "third order", "lags4": "K/(τs+1)⁴"}

_NOTES = (
    S_NOTE,
    "Gains are for one motor: through the decoupler both motors move, which doubles them, and the controllers are "
    "scaled for that (erratum E3). T is the sum of the model's lags, K its static gain; the λ formulas start here.",
    "The fit in per cent is that of a simulation on the last third of the record by a model fitted to the first two "
    "thirds. Standard errors allow for coloured residuals; they do not cover what the structure leaves out.",
    "The paper's table 1 was fitted as first order to a 1 ms sequence on the real rig, where friction grows with "
    "tension. Its T and its gains of G_S are therefore not expected here; its gains of G_q and the geometry are.",
)


def actuator_identification_report(source: Source) -> Report:
    """Build the report; a run without a model says why it gave none."""
    found, problem = source.identification, source.result.metrics.problem if source.result else ""
    tension_N = held_N(source)
    sections = []
    if found is not None:
        sections += [
            Section(
                "Models",
                (
                    _models(found),
                    _candidates(found),
                    _comparison(found, tension_N),
                    *measured_figures(source),
                ),
            ),
            Section("Coefficients", actuator_blocks(found.actuator.model)),
        ]
    sections.append(Section("How it was made", (settings_table(source), *reproduction(source), *_data(found))))
    if found is not None:
        sections.append(Section("Figures", _figures(source, found)))
    sections += [
        Section("Notes", tuple(Paragraph(note) for note in _NOTES)),
        parameter_section(source),
    ]
    return Report(
        title=f"Actuator identification at {exact(tension_N)} N",
        subtitle=subtitle(source),
        outcome=_outcome(found),
        verdict=found.verdict if found else problem or "No model: the run holds no samples.",
        facts=(*facts(source), *_point(found)),
        sections=tuple(sections),
        footer=f"Sinew {source.run.software} · actuator identification · run {source.run.id}",
        date=source.run.started_at,
    )


def held_N(source: Source) -> float:
    """Return the tension [N] that was held. Raises UnreadableDocumentError where the plan does not say."""
    told = (source.run.set_to.plan or {}).get("tension_N")
    if not isinstance(told, int | float):
        raise UnreadableDocumentError(f"run {source.run.id}: its plan has no tension_N")
    return told


def _outcome(found: Identification | None) -> str:
    if found is None:
        return "incomplete"
    return OUTCOMES[worst(*(found.actuator.channel(key).quality.grade for key in CHANNELS))]


def _point(found: Identification | None) -> tuple[Fact, ...]:
    if found is None:
        return ()
    q, S = found.actuator.model.q_nominal, found.actuator.model.S_nominal
    at = "" if q is None else f"q = {q:.6g} rad, "
    return (Fact("Point", f"{at}S = {shown(S, 4)} N·m/rad at rest before the excitation"),)


def _models(found: Identification) -> Table:
    columns = (
        Column("Model", number=False),
        Column("Structure", number=False),
        Column("K"),
        Column("±"),
        Column("K geometry"),
        Column("Error", "%"),
        Column("T", "s"),
        Column("±", "s"),
        Column("Fit", "%"),
        Column("Residuals", number=False, wide=True),
    )
    rows = tuple(_model_row(key, found.actuator.channel(key)) for key in CHANNELS)
    return Table(
        "Transfer functions from θ_A,ref to q [rad/rad] and to S [N·m/rad per rad]: static gain K and sum of lags T "
        "with standard errors, gain against geometry, fit on unseen data. Residual tests: the largest correlation in "
        "standard deviations, of what it may be at the 1 % level for all lags together.",
        columns,
        rows,
    )


def _model_row(key: str, channel: Channel) -> tuple[str, ...]:
    model, quality = channel.model, channel.quality
    reduced, error = model.first_order, quality.gain_error_percent
    return (
        key,
        _structure(model.structure),
        shown(reduced.K, 4),
        shown(reduced.K_std, 2),
        shown(quality.gain_geometry, 4),
        ("+" if error is not None and error > 0 else "") + shown(error, 2),
        shown(reduced.T),
        shown(reduced.T_std, 2),
        share(quality.fit_percent),
        _residuals(quality.residuals),
    )


def _residuals(tests: ResidualTests) -> str:
    white, free = judged(tests.whiteness), judged(tests.input_correlation)
    return (
        f"{'white' if white.passed else 'coloured'} ({white.statistic:.1f} of {white.critical:.1f}), "
        f"{'free of' if free.passed else 'depend on'} input ({free.statistic:.1f} of {free.critical:.1f})"
    )


def _figures(source: Source, found: Identification) -> tuple[Block, ...]:
    angles = source.angles
    columns, start, period_s = source.columns, found.actuator_record.first_sample, found.actuator_record.period_s
    channels = {key: found.actuator.channel(key).model for key in CHANNELS}
    models = {key: model_of(channel) for key, channel in channels.items()}
    residuals = {key: found.actuator.channel(key).quality.residuals for key in CHANNELS}
    return (
        Figure(
            "record",
            record_panels(columns, start, models, period_s, "record", angles),
            "The record: (A) excitation on the held tension, (B) joint position and (D) joint stiffness, each with the "
            "identified model simulated from rest on the recorded input (dashed), (C, E) measured less simulated, "
            "(F, G) tendon tensions.",
        ),
        Figure(
            "bode",
            bode_panels(columns, start, channels, period_s, "bode"),
            "Frequency responses of (A, C) G_q and (B, D) G_S: identified model, its first-order reduction (dashed), "
            "and an estimate from the data without a model where the coherence exceeds 0.9 (dots).",
        ),
        Figure(
            "step",
            step_panels(channels, "step", angles),
            f"Response of (A) G_q and (B) G_S to a step of θ_A,ref by {told(STEP_RAD[angles], 'rad', angles)}, and of "
            "their first-order reductions (dashed).",
        ),
        Figure(
            "residuals",
            residual_panels(residuals, "residuals"),
            "Correlation of the residuals with themselves (A, B) and with earlier input (C, D). Grey: the bounds of "
            "the tests; all correlations of a model that leaves nothing out stay within them, in 99 of 100 records.",
        ),
    )


def _candidates(found: Identification) -> Table:
    columns = (
        Column("Model", number=False),
        Column("Structure", number=False),
        Column("K"),
        Column("T", "s"),
        Column("Fit", "%"),
        Column("BIC"),
        Column("Grade", number=False, wide=True),
    )
    rows = []
    for key in CHANNELS:
        for item in found.actuator.channel(key).quality.candidates:
            rows.append((key, _structure(item.structure), *_tried(item)))
    return Table(
        "Structures tried on the same record, best first (usable before unusable, then by BIC).", columns, tuple(rows)
    )


def _tried(item: Candidate | FailedCandidate) -> tuple[str, ...]:
    if isinstance(item, FailedCandidate):
        return (*4 * (NO_FIGURE,), item.problem)
    BIC = NO_FIGURE if item.BIC is None else f"{item.BIC:.0f}".replace("-", "−")
    return (shown(item.K, 4), shown(item.T), share(item.fit_percent), BIC, item.problem or item.grade)


def _structure(name: str) -> str:
    return _STRUCTURES.get(name, name.replace(":", " "))


def _comparison(found: Identification, tension_N: float) -> Table:
    nearest = min(TABLE_1, key=lambda tension: abs(tension - tension_N))
    row = TABLE_1[nearest]
    columns = (
        Column("Transfer function", number=False, wide=True),
        Column("K here"),
        Column("K geometry"),
        Column("K by ARX"),
        Column("K table 1"),
        Column("T here", "s"),
        Column("T by ARX", "s"),
        Column("T table 1", "s"),
    )
    paper = {"G_q": (row.K_q, row.T_q), "G_S": (row.K_S, row.T_S)}
    channels = {key: found.actuator.channel(key) for key in CHANNELS}
    rows = tuple(_compared(key, channel, *paper[key]) for key, channel in channels.items())
    title = (
        f"First-order models beside the paper's table 1 at {exact(nearest)} N. By ARX: the paper's method, first order "
        f"with a low-pass, on the same record, for comparison only. {_missing_arx(channels)}"
    )
    return Table(title.strip(), columns, rows)


def _compared(key: str, channel: Channel, K: float, T: float) -> tuple[str, ...]:
    first_order, arx = channel.model.first_order, channel.quality.arx
    by_arx = (arx.K, arx.T) if isinstance(arx, ArxEstimate) else (None, None)
    return (
        key,
        shown(first_order.K, 4),
        shown(channel.quality.gain_geometry, 4),
        shown(by_arx[0], 4),
        shown(K, 4),
        shown(first_order.T),
        shown(by_arx[1]),
        shown(T),
    )


def _missing_arx(channels: Mapping[ChannelName, Channel]) -> str:
    found = {key: channel.quality.arx for key, channel in channels.items()}
    missing = {key: arx for key, arx in found.items() if not isinstance(arx, ArxEstimate)}
    return " ".join(f"{key}: {arx.problem if arx else 'not computed then'}." for key, arx in missing.items())


def _data(found: Identification | None) -> tuple[Block, ...]:
    if found is None:
        return ()
    data = found.actuator_record
    text = (
        f"Identification {found.run_id} used {data.samples} samples at {exact(1e3 * data.period_s)} ms, "
        f"from sample {data.first_sample} of that run on: input θ_A,ref, outputs q and S. Method: {method_of(found)}."
    )
    again = "\n".join(again_command(found, key) for key in CHANNELS)
    return (Paragraph(text), Code("To estimate G_q and G_S again from data.csv, the samples of the run:", again))


def again_command(found: Identification, key: ChannelName) -> str:
    """Return the command that estimates one channel anew from the exported samples, to the same figures and verdict."""
    data, channel = found.actuator_record, found.actuator.channel(key)
    known = {"--gain": channel.quality.gain_geometry, "--resolution": channel.quality.y_resolution}
    words = [f"{name} {value!r}" for name, value in known.items() if value is not None]
    if (estimator := found.actuator_options.estimator) is not None:  # earlier versions had one only
        words.append(f"--method {estimator}")
    lines = (
        f"sinew identify data data.csv --input theta_A_ref --output {WRITTEN[key][0]}",
        f"--period {data.period_s:g} --skip {data.first_sample} --structure {channel.model.structure}",
        " ".join(words),
    )
    return " \\\n  ".join(line for line in lines if line)
