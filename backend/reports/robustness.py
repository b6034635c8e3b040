"""The report of a robustness run: how far a load at the gearbox shaft turns a motor away, and for how long."""

from backend.recording.reader import Columns
from backend.reports.document import Figure, Report, Section
from backend.reports.drawing import COLOURS, axis_label, figure, in_unit, panel_letter, thinned, to_svg, upper_legend
from backend.reports.drawn_once import drawn_once
from backend.reports.experiment import experiment_report
from backend.reports.source import Source
from backend.reports.tracking_figures import TENSIONS, tension_panel
from backend.units import Angles
from plant.parameters import SIDES

_NOTES = (
    "The paper loads the motor loop by an additional spring tension of 50 N, 0.375 N·m at the gearbox shaft, while it "
    "looks for λ_motor; it prints the load and the chosen M_s = 1.4, no response.",
    "The load pulls the way the tendon does. It is applied at the shaft, in one step, beside the tendon's "
    "own force; joint and stiffness loops stay closed, so that both motor references answer as well.",
    "The integral of the error is what the integral part of the motor loop had to add: τ_load/(K_t k_i), but for "
    "friction and for the little that the references move.",
)


def robustness_report(source: Source) -> Report:
    """Build the report; a run without result says why it has none."""
    seen = () if source.result is None else (_figures(source),)
    return experiment_report(source, "Robustness under a load", "robustness experiment", seen, _NOTES)


def _figures(source: Source) -> Section:
    F_max = source.run.number("safety", "F_max")
    return Section(
        "Figures",
        (
            Figure(
                "errors",
                error_panels(source.columns, "errors", source.angles),
                "Loads on and off: (A, B) errors of the motor loops, (C) joint position, (D, E) voltages.",
            ),
            Figure(
                "tension",
                tension_panel(source.columns, F_max, "tension"),
                TENSIONS,
            ),
        ),
    )


@drawn_once
def error_panels(columns: Columns, name: str, angles: Angles) -> str:
    """Draw errors of the motor loops, joint position and voltages over time."""
    t = columns["t"]
    with figure(5, height_in=5.2, sharex=True, height_ratios=(3, 3, 2, 2, 2)) as (drawn, axes):
        for side, error_of, voltage in zip(SIDES, axes[:2], axes[3:], strict=True):
            error, colour = columns[f"theta_{side}_ref"] - columns[f"theta_{side}"], COLOURS[f"u_{side}"]
            error_of.plot(*thinned(t, in_unit(error, "rad", angles)), color=colour, label=f"motor {side}")
            error_of.set_ylabel(axis_label("error", "rad", angles))
            voltage.plot(*thinned(t, columns[f"u_{side}"]), color=colour, label=f"$u_{side}$")
            voltage.set_ylabel("u [V]")
        for pair in (axes[:2], axes[3:]):  # one scale for both motors
            low, high = zip(*(panel.get_ylim() for panel in pair), strict=True)
            for panel in pair:
                panel.set_ylim(min(low), max(high))
        axes[2].plot(*thinned(t, in_unit(columns["q"], "rad", angles)), color=COLOURS["q"], label="$q$")
        axes[2].set_ylabel(axis_label("q", "rad", angles))
        axes[4].set(xlabel="t [s]", xlim=(t[0], t[-1]))
        for panel, letter in zip(axes, "ABCDE", strict=True):
            upper_legend(panel)
            panel_letter(panel, letter)
        return to_svg(drawn, name)
