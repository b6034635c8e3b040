from . import bundle, importer, mcap, writers
from .base import (
    ORDER,
    Batch,
    ExportError,
    Facts,
    ImportRefusedError,
    describe_columns,
    export_columns,
    export_run,
    export_run_if_recorded,
)
from .formats import (
    MEDIA_TYPES,
    DataFormat,
    read_export,
    stream_export,
    write_export,
    write_file_whole,
    write_files_whole,
)
from .importer import ImportResult, require_matching_facts
from .mcap import TOPIC, foxglove_layout
from .writers import find_heading_problem, find_schema_problem

__all__ = [
    "MEDIA_TYPES",
    "ORDER",
    "TOPIC",
    "Batch",
    "DataFormat",
    "ExportError",
    "Facts",
    "ImportRefusedError",
    "ImportResult",
    "bundle",
    "describe_columns",
    "export_columns",
    "export_run",
    "export_run_if_recorded",
    "find_heading_problem",
    "find_schema_problem",
    "foxglove_layout",
    "importer",
    "mcap",
    "read_export",
    "require_matching_facts",
    "stream_export",
    "write_export",
    "write_file_whole",
    "write_files_whole",
    "writers",
]
