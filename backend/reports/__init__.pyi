from . import verification
from .build import build_metrics_document, write_report_files
from .evidence import EvidenceError, ReportManifest, SeriesEvidence, iterate_configuration, read_manifest
from .provenance import SEEN, judge_stored_run
from .rendering import render_report, render_series_report
from .run_data import RunData, load_source
from .series_source import MOST_RUNS, load_series
from .sheet import render_sheet_pdf
from .signing import (
    NAME_MAX,
    KeyOwner,
    PublicKey,
    SignedPage,
    SigningKeyError,
    UnsignableError,
    apply_signature_check,
    derive_public_key,
    find_public_key,
    load_or_make_signing_key,
    load_own_public_key,
    read_signature,
    sign_page,
)
from .study_map import draw_map
from .verification import (
    SUFFIXES,
    ReportDifference,
    SamplesFileError,
    Verified,
    read_samples_file,
    read_stored_samples,
    verify_report,
    verify_series_report,
)

__all__ = [
    "MOST_RUNS",
    "NAME_MAX",
    "SEEN",
    "SUFFIXES",
    "EvidenceError",
    "KeyOwner",
    "PublicKey",
    "ReportDifference",
    "ReportManifest",
    "RunData",
    "SamplesFileError",
    "SeriesEvidence",
    "SignedPage",
    "SigningKeyError",
    "UnsignableError",
    "Verified",
    "apply_signature_check",
    "build_metrics_document",
    "derive_public_key",
    "draw_map",
    "find_public_key",
    "iterate_configuration",
    "judge_stored_run",
    "load_or_make_signing_key",
    "load_own_public_key",
    "load_series",
    "load_source",
    "read_manifest",
    "read_samples_file",
    "read_signature",
    "read_stored_samples",
    "render_report",
    "render_series_report",
    "render_sheet_pdf",
    "sign_page",
    "verification",
    "verify_report",
    "verify_series_report",
    "write_report_files",
]
