"""Verification of reports: single changes and forgeries are detected."""

import asyncio
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from backend.execution.runner import RunRequest, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments.library import build_ready_plan
from backend.experiments.plans import LoopSettings
from backend.recording.reader import Columns
from backend.reports import messages
from backend.reports.build import build_metrics_document, build_report
from backend.reports.evidence import (
    LAYOUT,
    MANIFEST,
    EvidenceError,
    ReportManifest,
    compute_manifest_hash,
    find_element,
    made_with,
    read_manifest,
    to_element,
)
from backend.reports.model import to_html
from backend.reports.pdf import to_pdf
from backend.reports.plotting import forget_drawings
from backend.reports.run_data import RunData, load_source
from backend.reports.signing import apply_signature_check, derive_public_key, read_signature, sign_page
from backend.reports.verification import (
    AccompanyingFiles,
    SamplesFileError,
    Verified,
    find_difference,
    read_samples_file,
    verify_report,
)
from backend.storage.database import open_database
from plant.parameters import load_parameters
from tests.exports.written import to_csv, written
from tests.reasons import Reason
from tests.refusals import refused
from tests.reports import forgeries

# Each single change of a report or of its samples is reported; an unchanged report is verified.

BEGIN, END = '<template id="evidence">', "</template>"
Document = dict[str, Any]


@dataclass(frozen=True)
class Made:
    source: RunData
    page: str

    def with_account(self, change: Callable[[Document], None]) -> str:
        head, _, rest = self.page.partition(BEGIN)
        text, _, tail = rest.partition(END)
        account = json.loads(text)
        change(account)
        text = json.dumps(account, ensure_ascii=False, separators=(",", ":"))
        text = text.translate({ord(letter): f"\\u{ord(letter):04x}" for letter in "<>&"})
        return f"{head}{BEGIN}{text}{END}{tail}"


def made(folder: Path) -> RunData:
    plan = build_ready_plan("tracking", q_duration_s=1.0, S_duration_s=1.0)
    database = open_database(folder)
    with open_headless_rig(database, load_parameters("ideal"), LoopSettings()) as station:
        outcome = asyncio.run(run_experiment(station, RunRequest(plan, LoopSettings(), "A. Operator", "as usual")))
    source = load_source(database, outcome.run.id)
    database.close()
    return source


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Made:
    source = made(tmp_path_factory.mktemp("verified"))
    return Made(source, to_html(build_report(source)))


def names(found: Verified) -> list[str]:
    return [one.name for one in found.differences]


def test_an_unchanged_report_is_verified(report: Made) -> None:
    assert verify_report(report.page, report.source.columns) == Verified((), ())


def test_reports_of_two_installations_are_equal_except_for_the_date(report: Made, tmp_path: Path) -> None:
    other = made(tmp_path)
    run = replace(other.run, started_at=report.source.run.started_at, ended_at=report.source.run.ended_at)
    again = replace(other, run=run)
    forget_drawings()
    assert to_html(build_report(again)) == report.page
    assert to_pdf(build_report(again)) == to_pdf(build_report(report.source))
    assert to_csv(other.columns) == to_csv(report.source.columns)
    assert written(other.columns, "parquet") == written(report.source.columns, "parquet")


def put(*path: str | int, value: Any) -> Callable[[Document], None]:
    def change(account: Document) -> None:
        here: Any = account
        for part in path[:-1]:
            here = here[part]
        assert here[path[-1]] != value
        here[path[-1]] = value

    return change


ACCOUNTS: dict[str, tuple[Callable[[Document], None], str]] = {
    "a metric": (put("metrics", "figures", 11, "value", value=0.5), "metrics, figures, rmse_q, value"),
    "why a metric was not measured": (
        put("metrics", "figures", 0, "reason", value="it was a holiday"),
        "metrics, figures, rise_q_s, reason",
    ),
    "a label": (put("metrics", "figures", 11, "label", value="Error"), "metrics, figures, rmse_q, label"),
    "a unit": (put("metrics", "figures", 11, "unit", value="deg"), "metrics, figures, rmse_q, unit"),
    "a step": (put("metrics", "steps", 2, "after", value=0.7), "metrics, steps, 3, after"),
    "the length": (put("metrics", "played_s", value=99.0), "metrics, played_s"),
    "whether it was complete": (put("metrics", "complete", value=False), "metrics, complete"),
    "a criterion's bound": (put("criteria", 3, "bound", value=1.0), "criteria, min_tension, bound"),
    "a criterion's figure": (put("criteria", 3, "figure", value=50.0), "criteria, min_tension, figure"),
    "a criterion's verdict": (put("criteria", 3, "passed", value=False), "criteria, min_tension, passed"),
    "a parameter": (
        put("run", "parameters", "geometry", "r_j", "value", value=0.0751),
        messages.hash_of_input(name="parameters"),
    ),
    "a parameter's source": (
        put("run", "parameters", "geometry", "r_j", "source", value="a guess"),
        messages.hash_of_input(name="parameters"),
    ),
    "a setting": (put("run", "settings", "plan", "S_hold", value=10.5), messages.hash_of_input(name="settings")),
    "the experiment": (put("run", "settings", "plan", "experiment", value="{}"), messages.the_source_data()),
    "λ": (put("run", "settings", "loop", "lam_q", value=0.4), messages.hash_of_input(name="settings")),
    "the seed": (put("run", "settings", "loop", "seed", value=3), messages.line_of_heading(label="Seed")),
    "the version of a package": (
        put("run", "settings", "versions", "NumPy", value="1.0"),
        messages.line_of_heading(label="Software"),
    ),
    "the version of Sinew": (put("run", "software", value="9.9"), messages.line_of_heading(label="Software")),
    "the note": (put("run", "note", value="not as usual"), messages.line_of_heading(label="Note")),
    "who": (put("run", "who", value="B. Operator"), messages.line_of_heading(label="Started")),
    "how it ended": (put("run", "end_state", value="stopped"), messages.line_of_heading(label="Run")),
    "when it ended": (put("run", "ended_at", value="2020-01-01T00:00:00Z"), messages.hash_of_input(name="account")),
    "the hash of the samples": (put("hashes", "samples", value="0" * 64), messages.hash_of_input(name="samples")),
    "the hash of the parameters": (
        put("hashes", "parameters", value="0" * 64),
        messages.hash_of_input(name="parameters"),
    ),
    "the hash of the account": (put("hashes", "account", value="0" * 64), messages.hash_of_input(name="account")),
    "a check sum": (
        put("blocks", "F_A", 1, value="00000000"),
        messages.samples_of_signal(signal="F_A", start_s=1, end_s=2),
    ),
    "how many samples": (put("samples", value=100), messages.number_of_samples()),
    "how many are missing": (put("missed_before", value=7), "metrics, missing_samples"),
}


@pytest.mark.parametrize("what", ACCOUNTS)
def test_a_change_of_the_manifest_is_reported_with_its_name(report: Made, what: str) -> None:
    change, name = ACCOUNTS[what]
    found = verify_report(report.with_account(change), report.source.columns)
    assert name in names(found)
    assert messages.hash_of_input(name="account") in names(found) or name == messages.the_source_data()


CELL = '<td class="number">'
PEAK = f'<td class="text">Peak voltage</td>{CELL}'
SEEN: dict[str, tuple[str, str, str | Reason]] = {
    "the verdict": ('<p class="verdict', '<p class="x', Reason("line_of_page")),
    "a word of the verdict": ("were not measured", "were measured", Reason("line_of_page")),
    "a figure": (PEAK, PEAK + "9", messages.row_of_table(title="Peak voltage")),
    "a bound": ("&lt; 1<", "&lt; 2<", messages.row_of_table(title="Overshoot of q")),
    "a verdict of a criterion": (">pass<", ">fail<", messages.row_of_table(title="Smallest tendon tension")),
    "a parameter": (">0.075<", ">0.076<", messages.row_of_table(title="geometry.r_j")),
    "a version": ("NumPy 2", "NumPy 3", messages.line_of_heading(label="Software")),
    "who made it": ("by A. Operator", "by B. Operator", messages.line_of_heading(label="Started")),
    "a caption": ("<b>Figure 1.</b> Position", "<b>Figure 1.</b> Location", Reason("line_of_page")),
    "a hash": (
        '>samples</td><td class="text">', '>samples</td><td class="text">f', messages.row_of_table(title="samples")
    ),
    "the timing": (
        f"Missing samples</td>{CELL}", f"Missing samples</td>{CELL}1", messages.row_of_table(title="Missing samples")
    ),
    "a drawing": ('d="M ', 'd="M 1', messages.drawing_of_figure(number=1)),
    "the footer": ("· run ", "· Run ", Reason("line_of_page")),
    "a drawing more in a cell": (PEAK, f"<svg><text>9</text></svg>{PEAK}", messages.number_of_drawings()),
    "a drawing more that is a script": (
        "</main>", "<svg><script>1</script></svg></main>", messages.number_of_drawings()
    ),
    "markup alone": ('<p class="subtitle">', '<p class="subtitle" hidden>', Reason("line_of_page")),
    "a form feed for a newline": ("</h1>\n", "</h1>\f", Reason("line_of_page")),
}  # fmt: skip


MORE = "a drawing more in a cell", "a drawing more that is a script", "a form feed for a newline"
"""Changes that are found in more than one place."""


@pytest.mark.parametrize("what", SEEN)
def test_a_change_of_the_visible_text_is_reported_with_its_name(report: Made, what: str) -> None:
    old, new, name = SEEN[what]
    visible, mark, carried = report.page.partition(BEGIN)
    assert old in visible
    found = verify_report(visible.replace(old, new, 1) + mark + carried, report.source.columns).differences
    assert len(found) == 1 or what in MORE
    assert found[0].name == name
    assert all(one.said != one.found for one in found)


def test_a_missing_drawing_or_a_missing_final_newline_is_detected(report: Made) -> None:
    begin, end = report.page.index("<svg"), report.page.index("</svg>") + len("</svg>")
    assert messages.number_of_drawings() in names(
        verify_report(report.page[:begin] + report.page[end:], report.source.columns)
    )
    assert names(verify_report(report.page.removesuffix("\n"), report.source.columns)) == [messages.length_of_page()]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (f'{BEGIN}{{"format"', f'{BEGIN}{{"more":1,"format"'),
        ('"metrics":', '"metrics":{"complete":false},"metrics":'),
        ('"complete":true', '"complete": true'),
    ],
)
def test_additional_content_in_the_manifest_is_detected(report: Made, old: str, new: str) -> None:
    assert report.page.count(old) >= 1
    assert names(verify_report(report.page.replace(old, new, 1), report.source.columns)) == [
        messages.manifest_as_written()
    ]


IMPOSSIBLE: dict[str, tuple[Callable[[Document], None], str]] = {
    "an end that there is not": (put("run", "end_state", value="complete"), messages.the_page()),
    "a kind that there is not": (put("run", "kind", value="trackings"), messages.the_page()),
    "a number beyond any float": (put("missed_before", value=10**400), "metrics, missing_samples"),
    "a metric beyond any float": (put("metrics", "played_s", value=10**400), "metrics, played_s"),
    "a section that is a number": (put("run", "parameters", "geometry", value=7), messages.the_source_data()),
}


@pytest.mark.parametrize("what", IMPOSSIBLE)
def test_impossible_manifest_values_are_reported_as_differences(report: Made, what: str) -> None:
    change, name = IMPOSSIBLE[what]
    found = names(verify_report(report.with_account(change), report.source.columns))
    assert name in found
    assert any(one == Reason("hash_of_input") for one in found[:3])


@pytest.mark.parametrize(("signal", "at"), [("q", 3200), ("F_B", 0), ("u_A", 12_999), ("lateness_s", 5000)])
def test_one_changed_sample_is_reported_with_its_signal(report: Made, signal: str, at: int) -> None:
    columns: Columns = dict(report.source.columns)
    columns[signal] = columns[signal].copy()
    columns[signal][at] = np.float32(columns[signal][at] + 1e-3)
    found = names(verify_report(report.page, columns))
    assert messages.samples_of_signal(signal=signal, start_s=at // 1000, end_s=at // 1000 + 1) in found
    assert messages.hash_of_input(name="samples") in found


def test_one_changed_sample_time_is_reported(report: Made) -> None:
    columns: Columns = report.source.columns | {"t": report.source.columns["t"].copy()}
    columns["t"][3200] += 1e-4
    found = names(verify_report(report.page, columns))
    assert {messages.samples_of_signal(signal="t", start_s=3, end_s=4), messages.hash_of_input(name="samples")} <= {
        *found
    }


@pytest.mark.parametrize(
    ("old", "new", "reasons"),
    [
        ("\n3.2,", "\n3.2004,", [Reason("times_not_multiples", period_s=0.001)]),
        ("\n3.2,", "\n3.199,", [Reason("times_do_not_increase", t=pytest.approx(3.199))]),
        ("", "", []),
    ],
)
def test_a_samples_file_is_compared_with_its_own_metadata(
    report: Made, tmp_path: Path, old: str, new: str, reasons: list[Reason]
) -> None:
    file = tmp_path / "data.csv"
    file.write_text(to_csv(report.source.columns).decode().replace(old, new, 1))
    _, problems = read_samples_file(file)
    assert [one.found for one in problems] == reasons


def test_missing_samples_that_the_result_does_not_count_are_reported(report: Made) -> None:
    kept = np.ones(report.source.columns["t"].size, bool)
    kept[[500, 501, 7000]] = False
    columns = {name: column[kept] for name, column in report.source.columns.items()}
    result = report.source.result
    assert result is not None
    fewer = replace(report.source, columns=columns, result=result)  # the result counts no missing samples
    assert "metrics, missing_samples" in names(verify_report(to_html(build_report(fewer)), columns))


def test_a_different_number_of_samples_is_detected(report: Made) -> None:
    fewer = {name: column[:-1] for name, column in report.source.columns.items()}
    assert messages.number_of_samples() in names(verify_report(report.page, fewer))


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat", ".mcap"])
def test_a_report_is_verified_with_the_exported_data_file(report: Made, tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"data{suffix}"
    file.write_bytes(written(report.source.columns, suffix[1:]))
    columns, problems = read_samples_file(file)
    assert (verify_report(report.page, columns), problems) == (Verified((), ()), ())


def test_a_changed_unit_in_a_parquet_file_is_detected(report: Made, tmp_path: Path) -> None:
    file = tmp_path / "data.parquet"
    file.write_bytes(written(report.source.columns, "parquet"))
    table = pyarrow.parquet.read_table(file)
    place = table.schema.get_field_index("F_A")
    other = table.schema.field(place).with_metadata({"unit": "kN", "symbol": "F_A", "meaning": "tension"})
    pyarrow.parquet.write_table(table.cast(table.schema.set(place, other)), file)
    _, problems = read_samples_file(file)
    assert [one.name for one in problems] == [messages.units_and_meanings_in_file(file="data.parquet")]


def test_a_page_that_is_not_a_report_or_lacks_samples_is_rejected(report: Made, tmp_path: Path) -> None:
    with refused(EvidenceError, "samples_missing"):
        verify_report(report.page, None)
    for page in ("", "<html></html>", f"{BEGIN}{{}}{END}", f"{BEGIN}[1]{END}", f"{BEGIN}no JSON{END}"):
        with pytest.raises(EvidenceError):
            read_manifest(page)
    file = tmp_path / "data.csv"
    file.write_text("t,q\n0,1\n")
    with refused(SamplesFileError, "samples_file_unreadable", file=file, reason=Reason("csv_without_metadata")):
        read_samples_file(file)
    few = {name: np.zeros(3) for name in ("t", "S")}
    file.write_bytes(to_csv(few))
    with refused(SamplesFileError, "column_missing", file=file, column="mode"):
        read_samples_file(file)
    file = tmp_path / "data.parquet"
    file.write_bytes(b"PAR1")
    with refused(SamplesFileError, "samples_file_unreadable", file=file, reason=Reason("file_damaged")):
        read_samples_file(file)


def test_the_texts_of_a_report_of_another_version_are_not_compared(report: Made) -> None:
    found = verify_report(report.with_account(put("made_with", "Sinew", value="0.0.9")), report.source.columns)
    assert names(found) == [messages.hash_of_input(name="account")]
    assert found.left_out[0] == Reason("page_of_another_version", reported="0.0.9")
    assert found.compared == messages.all_but_visible_page()


@pytest.mark.parametrize("said", [None, "0123456789abcdef"])
def test_a_page_of_another_layout_is_not_verified(report: Made, said: str | None) -> None:
    """Different source code may have the same version number; older manifests do not contain the layout."""
    changed = report.page.replace("</h1>", ", in other words</h1>", 1)
    assert changed != report.page
    versions = {name: one for name, one in made_with().items() if name != LAYOUT or said is not None}
    versions |= {} if said is None else {LAYOUT: said}
    manifest = read_manifest(report.page)
    assert isinstance(manifest, ReportManifest)
    manifest = replace(manifest, made_with=versions)
    manifest = replace(manifest, hashes={**manifest.hashes, MANIFEST: compute_manifest_hash(manifest)})
    page = changed.replace(find_element(changed), to_element(manifest))
    found = verify_report(page, report.source.columns)
    assert (found.holds, found.differences) == (None, ())
    assert len(found.left_out) == 1


def test_a_report_without_newer_signals_is_verified_with_its_export(report: Made, tmp_path: Path) -> None:
    """The stored run lacks the signals; the exported file contains them without values."""
    lacking = ("V_A", "n_q")
    columns = {name: column for name, column in report.source.columns.items() if name not in lacking}
    older = replace(report.source, columns=columns)
    page = to_html(build_report(older))
    file = tmp_path / "data.csv"
    file.write_bytes(to_csv(columns))
    from_file, problems = read_samples_file(file)
    assert {name for name in lacking if np.isnan(from_file[name]).all()} == {*lacking}
    assert ([one.name for one in problems], verify_report(page, from_file).differences) == ([], ())
    from_file["V_A"][100] = 1.0
    assert {messages.checksums_of_signal(signal="V_A"), messages.hash_of_input(name="samples")} <= {
        *names(verify_report(page, from_file))
    }


def test_a_report_without_a_result_is_verified_and_the_missing_result_is_stated(report: Made) -> None:
    run = replace(report.source.run, end_state="service_died")
    without = to_html(build_report(replace(report.source, run=run, result=None)))
    found = verify_report(without, report.source.columns)
    assert found.differences == ()
    assert found.left_out[0] == Reason("result_not_in_report")


@pytest.mark.parametrize(("changed", "names"), [({}, []), ({"lam_q": 0.7}, ["metrics.json, settings, loop, lam_q"])])
def test_a_metrics_file_of_an_earlier_version_is_compared_in_the_current_form(
    report: Made, changed: Document, names: list[str]
) -> None:
    """Before the motion was stored, a voltage limit alone indicated time-optimal motion."""
    settings = report.source.run.settings
    followed = {**settings, "loop": {**settings["loop"], "motion": "time-optimal"}}
    source = replace(report.source, run=replace(report.source.run, settings=followed))
    loop = {name: value for name, value in followed["loop"].items() if name != "motion"} | changed
    earlier = json.dumps(build_metrics_document(source) | {"settings": {**followed, "loop": loop}})
    found = verify_report(to_html(build_report(source)), source.columns, AccompanyingFiles(metrics=earlier))
    assert [one.name for one in found.differences if one.name.startswith("metrics.json")] == names


# The texts of two different lines.


@pytest.mark.parametrize(
    ("one", "other"), [("usable " * 9, "usable " * 9 + "not"), ("<b>q</b>", "<b >q</b>"), ("", "0")]
)
def test_the_two_texts_of_a_difference_are_never_equal(one: str, other: str) -> None:
    said, found = find_difference(one, other)
    assert said != found


# No forged report is verified: each change is a difference, or stated as not compared.

Forging = Callable[[str], Iterator[tuple[str, str]]]
KINDS: dict[str, tuple[Forging, int]] = {
    "account": (forgeries.of_the_manifest, 60),
    "page": (forgeries.of_the_page, 400),
    "drawings": (forgeries.of_the_drawings, 10),
    "versions": (forgeries.with_versions, 2),
}
"""With every how many of its forgeries `make test` tries one."""


@pytest.fixture(scope="module")
def report_forged(tmp_path_factory: pytest.TempPathFactory) -> Made:
    source = made(tmp_path_factory.mktemp("forged"))
    return Made(source, to_html(build_report(source)))


def held(report: Made, forged: Iterator[tuple[str, str]]) -> tuple[int, list[str]]:
    """Return the number of tested forgeries, and the names of those that are verified."""
    tried, found = 0, []
    for name, page in forged:
        assert page != report.page, name
        tried += 1
        try:
            if verify_report(page, report.source.columns).holds:
                found.append(name)
        except EvidenceError:
            continue
    return tried, found


@pytest.mark.parametrize("kind", KINDS)
def test_no_forgery_of_a_sample_of_forgeries_is_verified(report_forged: Made, kind: str) -> None:
    forge, every = KINDS[kind]
    some = (one for number, one in enumerate(forge(report_forged.page)) if number % every == 0)
    tried, found = held(report_forged, some)
    assert tried > 2
    assert found == []


@pytest.mark.parametrize("kind", KINDS)
def test_no_forgery_is_verified(report_forged: Made, kind: str) -> None:
    tried, found = held(report_forged, KINDS[kind][0](report_forged.page))
    assert tried >= (9 if kind == "versions" else 80)
    assert found == []


KEY, OTHER = (Ed25519PrivateKey.from_private_bytes(bytes([number]) * 32) for number in (1, 2))


@pytest.fixture(scope="module")
def signed(report_forged: Made) -> bytes:
    return sign_page(report_forged.page.encode(), KEY, "rig-2")


def valid(forged: Iterator[tuple[str, bytes]], page: bytes) -> tuple[int, list[str]]:
    """Return the number of tested forgeries, and the names of those with a valid signature."""
    tried, found = 0, []
    for name, one in forged:
        assert one != page, name
        tried += 1
        read = read_signature(one)
        if read.is_valid and read.signature is not None and read.signature.key == derive_public_key(KEY):
            found.append(name)
    return tried, found


def test_a_changed_byte_of_a_signed_page_invalidates_its_signature(signed: bytes) -> None:
    tried, found = valid(forgeries.single_bytes(signed, every=20_011), signed)
    assert tried > 300
    assert found == []


def test_a_forged_signature_is_invalid(signed: bytes) -> None:
    tried, found = valid(forgeries.of_the_signature(signed, OTHER), signed)
    assert tried > 25
    assert found == []


@pytest.mark.parametrize("kind", KINDS)
def test_a_forgery_of_a_signed_page_invalidates_its_signature(report_forged: Made, signed: bytes, kind: str) -> None:
    forge, every = KINDS[kind]
    some = (one for number, one in enumerate(forge(signed.decode())) if number % every == 0)
    tried, found = valid(((name, page.encode()) for name, page in some), signed)
    assert tried > 2
    assert found == []


@pytest.mark.parametrize("forge", ["of_the_signature", "by another key", "taken away"])
def test_a_page_without_a_signature_of_the_given_key_is_not_verified(
    report_forged: Made, signed: bytes, forge: str
) -> None:
    """The numbers of these pages are all verified."""
    pages = {
        "of_the_signature": dict(forgeries.of_the_signature(signed, OTHER))["another name"],
        "by another key": sign_page(signed, OTHER, "rig-2"),
        "taken away": report_forged.page.encode(),
    }
    read = read_signature(pages[forge])
    found = verify_report(read.page.decode(), report_forged.source.columns)
    assert found.holds is True
    assert apply_signature_check(found, read, derive_public_key(KEY)).holds is False
    assert apply_signature_check(found, read).holds is (forge != "of_the_signature")


def test_the_verification_time_of_unclosed_tags_is_proportional_to_the_page_size(report_forged: Made) -> None:
    """A page of twice the size takes about twice the time; the ratio does not depend on the machine."""

    def seconds(megabytes: int) -> float:
        page = report_forged.page.replace("</body>", "<svg" * (megabytes * 250_000) + "</body>")
        begun = time.process_time()
        assert verify_report(page, report_forged.source.columns).holds is False
        return time.process_time() - begun

    seconds(1)
    assert seconds(8) < 8.0 * max(seconds(2), 0.1)
