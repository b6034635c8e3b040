"""Messages of the execution of experiments: programs that cannot start, and runs without a result."""

from plant import catalogue_entry


@catalogue_entry
def another_program_running() -> str:
    return "another program is running: wait for its end or abort it"


@catalogue_entry
def loop_stopped() -> str:
    return (
        "the control loop is stopping or has tripped: wait for the end of the stop, then reset the fault if there "
        "is one"
    )


@catalogue_entry
def pretension_not_reached(*, timeout_s: float) -> str:
    return f"pretension was not reached within {timeout_s:g} s"


@catalogue_entry
def force_bias_not_calibrated(*, reason: str) -> str:
    return f"the bias of the external force was not calibrated: {reason}"


@catalogue_entry
def service_ended_before_evaluation() -> str:
    return "the service ended before the run was evaluated"


@catalogue_entry
def run_not_evaluated(*, reason: str) -> str:
    return f"the run could not be evaluated: {reason}"


@catalogue_entry
def plant_runs_in_real_time(*, plant: str) -> str:
    return f"{plant}: this plant runs in real time; start experiments from the dashboard of sinew serve"


@catalogue_entry
def program_did_not_end() -> str:
    return "the program did not end in time and was stopped"


@catalogue_entry
def end_not_recorded(*, timeout_s: float) -> str:
    return f"the end of the run was not recorded within {timeout_s:g} s"


@catalogue_entry
def run_aborted(*, error: str) -> str:
    return f"aborted: {error}"


@catalogue_entry
def end_with_reason(*, detail: str, reason: str) -> str:
    return f"{detail}: {reason}" if detail else reason
