"""The report of a spring identification: polynomials of several orders, their errors, and which one to use."""

from collections.abc import Mapping

import numpy as np

from backend.models.identification import SpringFound, SpringModel
from backend.reports.document import Block, Column, Figure, Paragraph, Report, Section, Table, shown
from backend.reports.drawing import COLOURS, INK, LIMIT_GREY, figure, panel_letter, to_svg, upper_legend
from backend.reports.drawn_once import drawn_once
from backend.reports.judgement import measured_figures
from backend.reports.model_code import spring_blocks
from backend.reports.provenance import facts, parameter_section, settings_table, subtitle
from backend.reports.reproduction import reproduction
from backend.reports.source import Source
from plant.parameters import SIDES

_ORDER_COLOURS = {2: INK, 3: COLOURS["u_B"], 5: COLOURS["u_A"]}

_NOTES = (
    "Elongations are x_A = r_m θ_A − r_j q and x_B = r_m θ_B + r_j q (equations 1 and 2). They count from the zero "
    "that pretension gave the encoders, with the spring known before.",
    "One pair is the mean of 0.1 s. Left out: the error at each pair of a polynomial fitted to all others. A higher "
    "order is recommended only where it predicts pairs left out at least 20 % better and rises everywhere; order 2 "
    "carries the analytic decoupler. The paper's order 2 stayed below 0.85 N.",
    "The ways up and down differ by the load cells' delay and by friction between spring and load cell; fitted over "
    "both ways, the polynomial lies between them.",
)


def spring_identification_report(source: Source) -> Report:
    """Build the report; a run without a model says why it gave none."""
    found, problem = source.identification, source.result.metrics.problem if source.result else ""
    sections = []
    if found is not None:
        tables = tuple(_fits(side, found.springs[side].model) for side in SIDES)
        code = spring_blocks({side: found.springs[side].model for side in SIDES})
        sections.append(Section("Springs", (*tables, *_reasons(found.springs), *code, *measured_figures(source))))
    sections.append(Section("How it was made", (settings_table(source), *reproduction(source), *_data(source))))
    if found is not None:
        sections.append(Section("Figures", _figures(found.springs)))
    sections += [Section("Notes", tuple(Paragraph(note) for note in _NOTES)), parameter_section(source)]
    return Report(
        title="Spring identification",
        subtitle=subtitle(source),
        outcome="incomplete" if found is None else "passed" if found.usable else "failed",
        verdict=found.verdict if found else problem or "No model: the run holds no samples.",
        facts=facts(source),
        sections=tuple(sections),
        footer=f"Sinew {source.run.software} · spring identification · run {source.run.id}",
        date=source.run.started_at,
    )


def _fits(side: str, model: SpringModel) -> Table:
    columns = (
        Column("Order"),
        Column("k_0 ± [N], k_1 ± [N/m], k_2 ± [N/m²] …", number=False, wide=True),
        Column("RMS", "N"),
        Column("Largest", "N"),
        Column("Left out", "N"),
        Column("Use", number=False),
    )
    rows = tuple(
        (
            str(fit.order),
            ", ".join(f"{shown(k, 5)} ± {shown(std, 2)}" for k, std in zip(fit.k, fit.std_errors, strict=True)),
            shown(fit.rms_N),
            shown(fit.max_N),
            shown(fit.cross_validation_N),
            "recommended" if fit.order == model.recommended else "" if fit.rising else "falls",
        )
        for fit in model.fits
    )
    before = ", ".join(shown(k, 5) for k in model.before or ())
    caption = f"Spring {side}: F(x) = k_0 + k_1 x + k_2 x² + … In force before: {before or 'a table'}."
    return Table(caption, columns, rows)


def _reasons(springs: Mapping[str, SpringFound]) -> tuple[Paragraph, ...]:
    return tuple(Paragraph(f"Spring {side}: {springs[side].model.reason}.") for side in SIDES)


def _data(source: Source) -> tuple[Paragraph, ...]:
    found = source.identification
    if found is None:
        return ()
    pairs = found.springs["A"].quality.pairs
    text = f"Identification {found.run_id} used {pairs} pairs of each spring, from the sweep of that run."
    return (Paragraph(text),)


def _figures(springs: Mapping[str, SpringFound]) -> tuple[Block, ...]:
    return (
        Figure(
            "springs",
            spring_panels(springs, "springs"),
            "Characteristic of (A) spring A and (B) spring B: measured pairs (dots) and the recommended polynomial; "
            "(C, D) measured minus fitted force by order, dots on the way up, crosses on the way down. Compare figure "
            "3 of the paper.",
        ),
    )


SMALL_N = 0.05
"""Errors that stay below are drawn in mN: a number in N would have no room beside its axis."""


@drawn_once
def spring_panels(springs: Mapping[str, SpringFound], name: str) -> str:
    """Draw force over elongation of both springs, and the errors of each order (figure 3)."""
    with figure(2, 2, height_in=4.6, sharex=True, height_ratios=(3, 3)) as (drawn, axes):
        for column, side in enumerate(SIDES):
            force, error = axes[0][column], axes[1][column]
            found, recommended = springs[side].quality, str(springs[side].model.recommended)
            x, rising = 1e3 * np.array(found.x), np.array(found.rising)
            colour = COLOURS[f"F_{side}"]
            force.plot(x, found.F, color=colour, linestyle="none", marker="o", markersize=1.6, label="pairs")
            curve_x, curve = 1e3 * np.array(found.curve_x), found.curve[recommended]
            force.plot(curve_x, curve, color=INK, linewidth=0.8, label=f"order {recommended}")
            force.set_ylabel(f"$F_{side}$ [N]")
            upper_legend(force)
            small = max(np.max(np.abs(errors)) for errors in found.errors.values()) < SMALL_N
            factor, unit = (1e3, "mN") if small else (1.0, "N")
            for order, errors in found.errors.items():
                drawn_in = _ORDER_COLOURS.get(int(order), LIMIT_GREY)
                for way, marker in ((rising, "."), (~rising, "x")):
                    label = f"order {order}" if marker == "." else None
                    style = {"color": drawn_in, "linestyle": "none", "marker": marker, "markersize": 2.0}
                    error.plot(x[way], factor * np.array(errors)[way], label=label, markeredgewidth=0.4, **style)
            error.axhline(0.0, color=LIMIT_GREY, linewidth=0.5)
            error.set(xlabel=f"$x_{side}$ [mm]", ylabel=f"error [{unit}]")
            error.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1)
            panel_letter(force, "AB"[column])
            panel_letter(error, "CD"[column])
        return to_svg(drawn, name)
