"""``sinew report``."""

import socket
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from backend.cli.options import DataFolder, StationName, database_of, has_database, load_settings
from backend.cli.output import AsJson, angle_unit, errors, fail, out, print_json
from backend.settings import Settings

if TYPE_CHECKING:
    from backend.recording import Columns
    from backend.reports import PublicKey, ReportDifference, ReportManifest, SignedPage, Verified

app = typer.Typer(
    help="Reports: of a series, whether one holds, who signed it.", no_args_is_help=True, rich_markup_mode=None
)


@app.command()
def series(
    numbers: Annotated[list[int], typer.Argument(metavar="RUN...", help="Numbers of the runs, in order.")],
    to: Annotated[
        list[Path] | None, typer.Option("--to", help="File to write, .html or .pdf; series.html if left out.")
    ] = None,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Write one report of many runs: what differs between them, their metrics beside each other, their curves."""
    from backend.exports import write_files_whole
    from backend.reports import load_series, render_series_report

    kinds, files = {".html": "html", ".pdf": "pdf"}, to or [Path("series.html")]
    unknown = next((file for file in files if file.suffix not in kinds), None)
    if unknown is not None:
        fail(f"{unknown}: a report is written as .html or .pdf")
    with database_of(load_settings(data=data), reading=True) as database:
        sources = load_series(database, numbers, angle_unit())
    write_files_whole({file: (render_series_report(sources, kinds[file.suffix]),) for file in files})
    if as_json:
        print_json({"runs": [source.run.id for source in sources], "files": [str(file) for file in files]})
        return
    out.print(f"written: {', '.join(map(str, files))}", highlight=False, markup=False, soft_wrap=True)


@app.command()
def key(data: DataFolder = None, station: StationName = None, as_json: AsJson = False) -> None:
    """Print the public half of the key that signs reports here, with its fingerprint; the key is made at first use.

    The private half stays in the data folder. Give the line to whoever verifies your reports: it is for --key.
    """
    from backend.reports import SigningKeyError, derive_public_key, load_or_make_signing_key

    settings = load_settings(data=data, station=station)
    try:
        public = derive_public_key(load_or_make_signing_key(settings.data))
    except (OSError, SigningKeyError) as error:
        fail(str(error))
    name = _name_of_installation(settings)
    if as_json:
        print_json({"public_key": public.text, "fingerprint": public.fingerprint, "name": name})
        return
    out.print(f"{public.text} {public.fingerprint} {name}".strip(), highlight=False, markup=False, soft_wrap=True)


@app.command()
def sign(
    file: Annotated[Path, typer.Argument(help="report.html of a run, or the page of a series; it is written anew.")],
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Sign a page with the key of this installation, in place of a signature that it has.

    Only a page whose runs are stored here, and which holds by their samples, is signed. Ends with 1 where it differs, 2
    where it cannot be verified; the file is then left as it is.
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
        fail(f"{file} is not signed: the page is what is signed; sign {file.with_suffix('.html').name}", status=2)
    try:
        _require_ordinary(file)
        page = file.read_bytes()
        found = _verified_here(read_signature(page).page.decode("utf-8"), settings)
    except _unverifiable() as error:
        fail(f"{file} is not signed: {error}", status=2)
    for one in found.differences:
        errors.print(one.sentence, highlight=False, markup=False, soft_wrap=True)
    if found.differences:
        fail(f"{file} is not signed: it does not hold, {len(found.differences)} differences")
    if found.left_out:
        fail(f"{file} is not signed, as it is not verified: {'; '.join(found.left_out)}", status=2)
    try:
        private = load_or_make_signing_key(settings.data)
        name = _name_of_installation(settings)
        write_file_whole((sign_page(page, private, name),), file)
    except (OSError, SigningKeyError, UnsignableError) as error:
        fail(f"{file} is not signed: {error}", status=2)
    by = derive_public_key(private)
    if as_json:
        print_json({"file": str(file), "public_key": by.text, "fingerprint": by.fingerprint, "name": name})
        return
    out.print(f"{file} is signed by {by.fingerprint} ({name})", highlight=False, markup=False, soft_wrap=True)


@app.command()
def verify(
    file: Annotated[Path, typer.Argument(help="report.html or report.pdf of a run, or the report of a series.")],
    samples: Annotated[
        Path | None,
        typer.Option("--samples", help="CSV or Parquet of its samples; else data.csv beside it, else the stored run."),
    ] = None,
    key: Annotated[
        str | None,
        typer.Option("--key", help="Public key that has to have signed it: a file, or the text “ssh-ed25519 AAAA…”."),
    ] = None,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Compute every number of a report again from its samples and say whether they hold, and who signed the page.

    metrics.json beside it, the units in the comments of data.csv and, where the data folder has the run, its stored
    samples are compared too. A PDF is verified by the page of the same name beside it, which is what is signed. Ends
    with 0 where all hold, 1 where something differs, 2 where something could not be compared: then it is not verified
    ("holds": null). A broken signature differs; with --key so does a page that this key has not signed.
    """
    from backend.reports import SigningKeyError, Verified, apply_signature_check, find_public_key, read_signature

    settings = load_settings(data=data)
    try:
        given = None if key is None else find_public_key(key)
        signed = read_signature(_page_of(file))
    except SigningKeyError as error:
        fail(f"--key: {error}", status=2)
    except _unverifiable() as error:
        fail(f"{file}: it cannot be told whether it holds: {error}", status=2)
    why = ""
    try:
        found, origin, checked = _verified(file, signed.page.decode("utf-8"), samples, settings)
    except _unverifiable() as error:
        why = str(error)
        found, origin, checked = Verified((), (why,)), "", ()
    found = apply_signature_check(found, signed, given)
    if as_json:
        print_json(
            {
                "holds": found.holds,
                "samples": origin,
                "checked": list(checked),
                "differences": [vars(one) for one in found.differences],
                "left_out": list(found.left_out),
                "signature": _signature_document(signed, given, settings),
            }
        )
    else:
        _print_signature(signed, given, settings)
    for left_out in () if as_json or why else found.left_out:
        out.print(f"not compared: {left_out}", highlight=False, markup=False)
    if found.differences:
        for one in () if as_json else found.differences:
            errors.print(one.sentence, highlight=False, markup=False, soft_wrap=True)
        if not as_json and len(checked) > 1:
            words = f"computed from {origin}; compared with it: {', '.join(checked[1:])}"
            errors.print(words, highlight=False, markup=False, soft_wrap=True)
        if why:
            errors.print(f"the rest cannot be told: {why}", highlight=False, markup=False, soft_wrap=True)
        fail(f"{file} does not hold: {len(found.differences)} differences")
    if why:
        fail(f"{file}: it cannot be told whether it holds: {why}", status=2)
    if found.holds is None:
        fail(f"{file} is not verified: nothing differs, but not all of it was compared", status=2)
    if not as_json:
        words = f"{file} holds: {found.compared}, computed again from {origin}"
        if len(checked) > 1:
            words += f"; so do {', '.join(checked[1:])}"
        out.print(words, highlight=False, markup=False, soft_wrap=True)


def _unverifiable() -> tuple[type[Exception], ...]:
    """Return the errors that keep a report from being compared."""
    from backend.recording import CodecError
    from backend.reports import EvidenceError, SamplesFileError
    from backend.storage import SchemaError, StorageError

    return OSError, UnicodeDecodeError, EvidenceError, SamplesFileError, CodecError, SchemaError, StorageError


def _name_of_installation(settings: Settings) -> str:
    """Return what an installation calls itself in a signature: its station, else the name of its machine."""
    from backend.reports import NAME_MAX

    name = settings.station or socket.gethostname()
    return "".join(letter for letter in name if letter.isprintable())[:NAME_MAX]


def _print_signature(signed: "SignedPage", given: "PublicKey | None", settings: Settings) -> None:
    from backend.reports import KeyOwner, load_own_public_key

    if signed.problem:
        return  # told among the differences
    if signed.signature is None:
        out.print("not signed", highlight=False, markup=False)
        return
    whose = {
        KeyOwner.GIVEN: "the key that was given",
        KeyOwner.OWN: "the key of this installation",
        KeyOwner.UNKNOWN: "an unknown key: that proves nothing of where it comes from; --key names the one to expect",
    }
    found = signed.whose(given, load_own_public_key(settings.data))
    name = f" ({signed.signature.name})" if signed.signature.name else ""
    words = f"signed by {signed.signature.key.fingerprint}{name}, {whose[found] if found else 'broken'}"
    out.print(words, highlight=False, markup=False, soft_wrap=True)


def _signature_document(signed: "SignedPage", given: "PublicKey | None", settings: Settings) -> dict[str, Any]:
    from backend.reports import load_own_public_key

    signature = signed.signature
    state = "broken" if signed.problem else "none" if signature is None else "valid"
    return {
        "state": state,
        "key": None if state != "valid" else signed.whose(given, load_own_public_key(settings.data)),
        "fingerprint": None if signature is None else signature.key.fingerprint,
        "name": None if signature is None else signature.name,
    }


def _require_ordinary(file: Path) -> None:
    from backend.reports import EvidenceError

    if file.exists() and not file.is_file():
        raise EvidenceError(f"{file} is no ordinary file")


def _page_of(file: Path) -> bytes:
    """Return the page of a report; of a PDF the one beside it. Raises EvidenceError, OSError."""
    from backend.reports import EvidenceError

    _require_ordinary(file)
    if file.suffix != ".pdf":
        return file.read_bytes()
    page = file.with_suffix(".html")
    if not page.exists():
        raise EvidenceError(f"a PDF carries no account of its numbers, and its page {page.name} is not beside it")
    _require_ordinary(page)
    return page.read_bytes()


def _verified_here(page: str, settings: Settings) -> "Verified":
    """Compare a page with the runs that are stored here, and with nothing else. Raises EvidenceError."""
    from backend.reports import EvidenceError, SeriesEvidence, read_accounts, verify_report, verify_series_report

    evidence = read_accounts(page)
    if isinstance(evidence, SeriesEvidence):
        return verify_series_report(page, evidence, lambda one: _stored(settings, one)[0])
    columns, _ = _stored(settings, evidence)
    if columns is None:
        raise EvidenceError("its run is not stored in this data folder: the installation that has it signs it")
    return verify_report(page, columns)


def _verified(
    file: Path, page: str, samples: Path | None, settings: Settings
) -> "tuple[Verified, str, tuple[str, ...]]":
    """Return what was found, where the samples are from that it was computed from, and all that was checked."""
    from backend.reports import EvidenceError, SeriesEvidence, read_accounts, verification, verify_series_report

    of_pdf = file.suffix == ".pdf"
    if samples is not None:
        _require_ordinary(samples)
    evidence = read_accounts(page)
    if isinstance(evidence, SeriesEvidence):
        if of_pdf or samples is not None:
            raise EvidenceError("a series is verified by its page, from the stored runs")
        found = verify_series_report(page, evidence, lambda one: _stored(settings, one)[0])
        return found, "its stored runs", ("its stored runs",)
    sources = _sources(file, samples, settings, evidence)
    metrics = file.with_name("metrics.json")
    told = metrics.read_text(encoding="utf-8") if metrics.is_file() else None
    beside = verification.AccompanyingFiles(told, sources.stored if sources.file else None, sources.stored_as)
    columns = sources.columns if sources.file else sources.stored
    if of_pdf:
        found = verification.verify_pdf(file.read_bytes(), page, columns, beside)
    else:
        found = verification.verify_report(page, columns, beside)
    checked = tuple(name for name in (sources.file, sources.stored_as, "" if told is None else str(metrics)) if name)
    left_out = (*found.left_out, *sources.left_out)
    whole = replace(found, differences=(*found.differences, *sources.problems), left_out=left_out)
    return whole, sources.file or sources.stored_as, checked


@dataclass(frozen=True)
class _Sources:
    """Samples of a file, whose name is "" where there is none, and of the stored run; ``problems`` of the file."""

    file: str = ""
    columns: "Columns | None" = None
    problems: "tuple[ReportDifference, ...]" = ()
    stored: "Columns | None" = None
    stored_as: str = ""
    left_out: tuple[str, ...] = ()


def _sources(file: Path, samples: Path | None, settings: Settings, evidence: "ReportManifest") -> _Sources:
    """Return the samples of the file that is named, or of one beside the report, and those of the stored run.

    Where there is a file, a database that cannot be read is left out with the reason.
    """
    from backend.recording import CodecError
    from backend.reports import SUFFIXES, ReportDifference, read_samples_file
    from backend.storage import SchemaError, StorageError

    beside = (file.with_name(f"data{suffix}") for suffix in SUFFIXES)
    named = samples or next((one for one in beside if one.is_file()), None)
    if named is None:
        stored, number = _stored(settings, evidence)
        return _Sources(stored=stored, stored_as=f"run {number} of the data folder")
    columns, problems = read_samples_file(named)
    found = _Sources(file=str(named), columns=columns, problems=problems)
    try:
        stored, number = _stored(settings, evidence)
    except CodecError as error:
        damage = ReportDifference("the stored run", "samples that can be read", str(error)[:200])
        return replace(found, problems=(*problems, damage), stored_as="the stored run")
    except (SchemaError, StorageError) as error:
        return replace(found, left_out=(f"the stored run: {error}",))
    if stored is None or stored["t"].size == 0:  # never here, or deleted to make room
        return found
    return replace(found, stored=stored, stored_as=f"run {number} of the data folder")


def _stored(settings: Settings, evidence: "ReportManifest") -> "tuple[Columns | None, int | None]":
    from backend.reports import read_stored_samples

    if not has_database(settings):
        return None, None
    with database_of(settings, reading=True) as database:
        return read_stored_samples(database, evidence)
