"""Commands ``sinew report``: reports of a series, signatures and verification."""

import socket
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from backend.cli import messages
from backend.cli.options import DataFolder, StationName, has_database, load_settings, open_configured_database
from backend.cli.output import AsJson, angle_unit, console, error_console, fail, print_json
from backend.settings import Settings

if TYPE_CHECKING:
    from backend.recording import Columns
    from backend.reports import PublicKey, ReportDifference, ReportManifest, SignedPage, Verified

app = typer.Typer(help="Reports: combine several runs, verify, sign.", no_args_is_help=True, rich_markup_mode=None)


@app.command()
def series(
    numbers: Annotated[list[int], typer.Argument(metavar="RUN...", help="Numbers of the runs, in order.")],
    to: Annotated[
        list[Path] | None, typer.Option("--to", help="File to write, .html or .pdf; repeatable. [series.html]")
    ] = None,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Write one report of several runs, with their differences, metrics and curves."""
    from backend.exports import write_files_whole
    from backend.reports import load_series, render_series_report

    kinds, files = {".html": "html", ".pdf": "pdf"}, to or [Path("series.html")]
    unknown = next((file for file in files if file.suffix not in kinds), None)
    if unknown is not None:
        fail(messages.unknown_report_suffix(file=unknown))
    with open_configured_database(load_settings(data=data), read_only=True) as database:
        sources = load_series(database, numbers, angle_unit())
    write_files_whole({file: (render_series_report(sources, kinds[file.suffix]),) for file in files})
    if as_json:
        print_json({"runs": [source.run.id for source in sources], "files": [str(file) for file in files]})
        return
    console.print(messages.wrote(files=", ".join(map(str, files))), highlight=False, markup=False, soft_wrap=True)


@app.command()
def key(data: DataFolder = None, station: StationName = None, as_json: AsJson = False) -> None:
    """Print the public key of reports signed here, with its fingerprint.

    The first use creates the key. The private key stays in the data folder. Others pass the printed line to
    sinew report verify --key.
    """
    from backend.reports import SigningKeyError, derive_public_key, load_or_make_signing_key

    settings = load_settings(data=data, station=station)
    try:
        public = derive_public_key(load_or_make_signing_key(settings.data))
    except (OSError, SigningKeyError) as error:
        fail(str(error))
    name = _find_signer_name(settings)
    if as_json:
        print_json({"public_key": public.text, "fingerprint": public.fingerprint, "name": name})
        return
    console.print(f"{public.text} {public.fingerprint} {name}".strip(), highlight=False, markup=False, soft_wrap=True)


@app.command()
def sign(
    file: Annotated[Path, typer.Argument(help="report.html of a run or of a series; the command overwrites it.")],
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Sign a report with the key of this installation, replacing an earlier signature.

    The runs of the report must be stored here, and its numbers must agree with their samples. Exit 1 if a number
    differs, 2 if the report cannot be verified; the file is then unchanged.
    """
    from backend.exports import write_file_whole
    from backend.reports import (
        SigningKeyError,
        UnsignableError,
        derive_public_key,
        load_or_make_signing_key,
        read_signature,
        sign_page,
    )

    settings = load_settings(data=data, station=station)
    if file.suffix == ".pdf":
        fail(messages.pdf_not_signed(file=file, page=file.with_suffix(".html").name), status=2)
    try:
        _require_regular_file(file)
        page = file.read_bytes()
        found = _verify_against_database(read_signature(page).page.decode("utf-8"), settings)
    except _verification_errors() as error:
        fail(messages.not_signed(file=file, reason=str(error)), status=2)
    for difference in found.differences:
        error_console.print(difference.sentence, highlight=False, markup=False, soft_wrap=True)
    if found.differences:
        fail(messages.not_signed_with_differences(file=file, count=len(found.differences)))
    if found.left_out:
        fail(messages.not_signed_unless_verified(file=file, left_out=found.left_out), status=2)
    try:
        private = load_or_make_signing_key(settings.data)
        name = _find_signer_name(settings)
        write_file_whole((sign_page(page, private, name),), file)
    except (OSError, SigningKeyError, UnsignableError) as error:
        fail(messages.not_signed(file=file, reason=str(error)), status=2)
    public = derive_public_key(private)
    if as_json:
        print_json({"file": str(file), "public_key": public.text, "fingerprint": public.fingerprint, "name": name})
        return
    text = messages.signed_file(file=file, fingerprint=public.fingerprint, name=name)
    console.print(text, highlight=False, markup=False, soft_wrap=True)


@app.command()
def verify(
    file: Annotated[Path, typer.Argument(help="report.html or report.pdf of a run, or the report of a series.")],
    samples: Annotated[
        Path | None,
        typer.Option(
            "--samples", help="Export of the run with its samples. [data.csv next to the report, or the stored run]"
        ),
    ] = None,
    key: Annotated[
        str | None,
        typer.Option("--key", help="Public key of the required signature: a file, or the text “ssh-ed25519 AAAA…”."),
    ] = None,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Recompute the numbers of a report, compare them, and check the signature.

    The comparison includes metrics.json next to the report, the units in the comments of data.csv, and the stored
    samples if the data folder has the run. A PDF is verified with the HTML report of the same name next to it, which
    contains the signature. Exit 0 if everything agrees, 1 if something differs, 2 if a part could not be compared
    ("holds": null). An invalid signature counts as a difference; with --key, so does a missing signature of this key.
    """
    from backend.reports import SigningKeyError, Verified, apply_signature_check, find_public_key, read_signature

    settings = load_settings(data=data)
    try:
        expected_key = None if key is None else find_public_key(key)
        signed = read_signature(_read_page(file))
    except SigningKeyError as error:
        fail(messages.invalid_key(reason=str(error)), status=2)
    except _verification_errors() as error:
        fail(messages.not_verified(file=file, reason=str(error)), status=2)
    problem = ""
    try:
        found, origin, checked = _verify(file, signed.page.decode("utf-8"), samples, settings)
    except _verification_errors() as error:
        problem = str(error)
        found, origin, checked = Verified((), (problem,)), "", ()
    found = apply_signature_check(found, signed, expected_key)
    if as_json:
        print_json(
            {
                "holds": found.holds,
                "samples": origin,
                "checked": list(checked),
                "differences": [vars(difference) for difference in found.differences],
                "left_out": list(found.left_out),
                "signature": _build_signature_document(signed, expected_key, settings),
            }
        )
    else:
        _print_signature(signed, expected_key, settings)
    for left_out in () if as_json or problem else found.left_out:
        console.print(messages.not_compared(part=left_out), highlight=False, markup=False)
    if found.differences:
        for difference in () if as_json else found.differences:
            error_console.print(difference.sentence, highlight=False, markup=False, soft_wrap=True)
        if not as_json and len(checked) > 1:
            text = messages.compared_sources(origin=origin, others=checked[1:])
            error_console.print(text, highlight=False, markup=False, soft_wrap=True)
        if problem:
            text = messages.rest_not_verified(reason=problem)
            error_console.print(text, highlight=False, markup=False, soft_wrap=True)
        fail(messages.verification_failed(file=file, count=len(found.differences)))
    if problem:
        fail(messages.not_verified(file=file, reason=problem), status=2)
    if found.holds is None:
        fail(messages.partly_verified(file=file), status=2)
    if not as_json:
        text = messages.verified(file=file, compared=found.compared, origin=origin, others=checked[1:])
        console.print(text, highlight=False, markup=False, soft_wrap=True)


def _verification_errors() -> tuple[type[Exception], ...]:
    """Return the types of errors that prevent the verification of a report."""
    from backend.recording import CodecError
    from backend.reports import EvidenceError, SamplesFileError
    from backend.storage import SchemaError, StorageError

    return OSError, UnicodeDecodeError, EvidenceError, SamplesFileError, CodecError, SchemaError, StorageError


def _find_signer_name(settings: Settings) -> str:
    """Return the name of this installation in signatures: station or host name."""
    from backend.reports import NAME_MAX

    name = settings.station or socket.gethostname()
    return "".join(character for character in name if character.isprintable())[:NAME_MAX]


def _print_signature(signed: "SignedPage", expected_key: "PublicKey | None", settings: Settings) -> None:
    from backend.reports import KeyOwner, load_own_public_key

    if signed.problem:
        return  # it is one of the printed differences
    if signed.signature is None:
        console.print(messages.no_signature(), highlight=False, markup=False)
        return
    owners = {
        KeyOwner.GIVEN: messages.given_key(),
        KeyOwner.OWN: messages.own_key(),
        KeyOwner.UNKNOWN: messages.unknown_key(),
    }
    owner = signed.whose(expected_key, load_own_public_key(settings.data))
    text = messages.signature(
        fingerprint=signed.signature.key.fingerprint,
        name=signed.signature.name,
        owner=owners[owner] if owner else "",
    )
    console.print(text, highlight=False, markup=False, soft_wrap=True)


def _build_signature_document(
    signed: "SignedPage", expected_key: "PublicKey | None", settings: Settings
) -> dict[str, Any]:
    from backend.reports import load_own_public_key

    signature = signed.signature
    state = "broken" if signed.problem else "none" if signature is None else "valid"
    return {
        "state": state,
        "key": None if state != "valid" else signed.whose(expected_key, load_own_public_key(settings.data)),
        "fingerprint": None if signature is None else signature.key.fingerprint,
        "name": None if signature is None else signature.name,
    }


def _require_regular_file(file: Path) -> None:
    from backend.reports import EvidenceError

    if file.exists() and not file.is_file():
        raise EvidenceError(messages.not_a_regular_file(file=str(file)))


def _read_page(file: Path) -> bytes:
    """Return the page of a report; for a PDF, the page next to it.

    Raises EvidenceError, OSError.
    """
    from backend.reports import EvidenceError

    _require_regular_file(file)
    if file.suffix != ".pdf":
        return file.read_bytes()
    page = file.with_suffix(".html")
    if not page.exists():
        raise EvidenceError(messages.page_of_pdf_missing(page=page.name))
    _require_regular_file(page)
    return page.read_bytes()


def _verify_against_database(page: str, settings: Settings) -> "Verified":
    """Compare a page with its runs in this data folder only. Raises EvidenceError."""
    from backend.reports import EvidenceError, SeriesEvidence, read_manifest, verify_report, verify_series_report

    manifest = read_manifest(page)
    if isinstance(manifest, SeriesEvidence):
        return verify_series_report(page, manifest, lambda run: _load_stored_samples(settings, run)[0])
    columns, _ = _load_stored_samples(settings, manifest)
    if columns is None:
        raise EvidenceError(messages.run_not_stored())
    return verify_report(page, columns)


def _verify(file: Path, page: str, samples: Path | None, settings: Settings) -> "tuple[Verified, str, tuple[str, ...]]":
    """Return the result, the origin of its samples, and the compared sources."""
    from backend.reports import EvidenceError, SeriesEvidence, read_manifest, verification, verify_series_report

    is_pdf = file.suffix == ".pdf"
    if samples is not None:
        _require_regular_file(samples)
    manifest = read_manifest(page)
    if isinstance(manifest, SeriesEvidence):
        if is_pdf or samples is not None:
            raise EvidenceError(messages.page_of_several_runs_needed())
        found = verify_series_report(page, manifest, lambda run: _load_stored_samples(settings, run)[0])
        return found, messages.stored_runs(), (messages.stored_runs(),)
    sources = _find_samples(file, samples, settings, manifest)
    metrics_file = file.with_name("metrics.json")
    metrics = metrics_file.read_text(encoding="utf-8") if metrics_file.is_file() else None
    other_files = verification.AccompanyingFiles(metrics, sources.stored if sources.file else None, sources.stored_as)
    columns = sources.columns if sources.file else sources.stored
    if is_pdf:
        found = verification.verify_pdf(file.read_bytes(), page, columns, other_files)
    else:
        found = verification.verify_report(page, columns, other_files)
    names = (sources.file, sources.stored_as, "" if metrics is None else str(metrics_file))
    left_out = (*found.left_out, *sources.left_out)
    found = replace(found, differences=(*found.differences, *sources.problems), left_out=left_out)
    return found, sources.file or sources.stored_as, tuple(name for name in names if name)


@dataclass(frozen=True)
class _SampleSources:
    """Samples to verify a report with: from a file and from the stored run.

    ``file`` is the name of the file, "" without one, ``columns`` are its samples and ``problems`` its differences.
    ``stored`` are the samples of the stored run and ``stored_as`` its name in messages. ``left_out`` has the reasons
    for sources that could not be read.
    """

    file: str = ""
    columns: "Columns | None" = None
    problems: "tuple[ReportDifference, ...]" = ()
    stored: "Columns | None" = None
    stored_as: str = ""
    left_out: tuple[str, ...] = ()


def _find_samples(file: Path, samples: Path | None, settings: Settings, manifest: "ReportManifest") -> _SampleSources:
    """Return the samples of a file and of the stored run.

    The file is ``samples``, or one next to the report. If there is a file, an unreadable database is only noted in
    ``left_out``.
    """
    from backend.recording import CodecError
    from backend.reports import SUFFIXES, ReportDifference, read_samples_file
    from backend.storage import SchemaError, StorageError

    candidates = (file.with_name(f"data{suffix}") for suffix in SUFFIXES)
    samples_file = samples or next((one for one in candidates if one.is_file()), None)
    if samples_file is None:
        stored, number = _load_stored_samples(settings, manifest)
        return _SampleSources(stored=stored, stored_as=messages.run_of_data_folder(run_id=number))
    columns, problems = read_samples_file(samples_file)
    found = _SampleSources(file=str(samples_file), columns=columns, problems=problems)
    try:
        stored, number = _load_stored_samples(settings, manifest)
    except CodecError as error:
        damage = ReportDifference(messages.stored_run(), messages.readable_samples(), str(error)[:200])
        return replace(found, problems=(*problems, damage), stored_as=messages.stored_run())
    except (SchemaError, StorageError) as error:
        return replace(found, left_out=(messages.stored_run_not_read(reason=str(error)),))
    if stored is None or stored["t"].size == 0:  # not in this data folder, or deleted to free space
        return found
    return replace(found, stored=stored, stored_as=messages.run_of_data_folder(run_id=number))


def _load_stored_samples(settings: Settings, manifest: "ReportManifest") -> "tuple[Columns | None, int | None]":
    """Return samples and number of the stored run of a report, None without one."""
    from backend.reports import read_stored_samples

    if not has_database(settings):
        return None, None
    with open_configured_database(settings, read_only=True) as database:
        return read_stored_samples(database, manifest)
