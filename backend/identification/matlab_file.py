"""A MATLAB file, version 7 or older, as columns by name; what is no column is named with the reason."""

import re
import struct
import warnings
import zlib
from collections import Counter
from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np

from backend.identification.errors import DataFileError, FileFault
from backend.identification.table import LARGEST_EXACT, MAX_SAMPLES, Columns

_HDF5 = b"\x89HDF\r\n\x1a\n"
_VERSION_7_3 = (
    "the file is of MATLAB version 7.3 (HDF5), which is not read: load it in MATLAB or Octave and save it again with "
    "save('new.mat', 'u', 'y', '-v7'), the names of its variables in place of u and y"
)
_SAVE = {
    "table": "u = {0}.u; y = {0}.y; save('new.mat', 'u', 'y', '-v7')",
    "timetable": "t = seconds({0}.Properties.RowTimes - {0}.Properties.RowTimes(1)); u = {0}.u; y = {0}.y;"
    " save('new.mat', 't', 'u', 'y', '-v7')",
    "timeseries": "t = {0}.Time; y = {0}.Data; save('new.mat', 't', 'y', '-v7')",
    "Simulink.SimulationOutput": "t = {0}.tout; y = {0}.yout.getElement(1).Values.Data;"
    " save('new.mat', 't', 'y', '-v7')",
    "Simulink.SimulationData.Dataset": "y = {0}.getElement(1).Values.Data; t = {0}.getElement(1).Values.Time;"
    " save('new.mat', 't', 'y', '-v7')",
    "datetime": "t = seconds({0} - {0}(1)); save('new.mat', 't', '-v7', '-append')",
    "duration": "t = seconds({0}); save('new.mat', 't', '-v7', '-append')",
}
_MATRIX, _COMPRESSED, _OPAQUE = 14, 15, 17
_MOST_NAMED = 64 * 1024
"""Bytes of an element in which the class of an object is looked for."""

Found = tuple[str, str, Any]
"""Where a value is, the name by which it is read where that is the only one, and the value."""


def read_mat(stream: BinaryIO) -> Columns:
    """Numeric vectors by name of a MATLAB file (version 7 or older). Raises DataFileError.

    Columns of a matrix x are x_1, x_2 ..; fields of a struct s are read as if they stood alone, or as s.field where
    that name is taken; those of the elements of a struct array are field_1, field_2 ..
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    content = stream.read()
    stream.seek(0)
    if content.startswith(_HDF5):
        raise DataFileError(_VERSION_7_3, FileFault.FORMAT)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            # SciPy warns of objects that it cannot name; what could not be read is said below.
            warnings.simplefilter("ignore")
            # The stubs know file names only; loadmat reads from open files as well.
            variables = loadmat(stream, squeeze_me=True)  # type: ignore[arg-type]  # the stubs know paths only
    except NotImplementedError:
        raise DataFileError(_VERSION_7_3, FileFault.FORMAT) from None
    except (
        ArithmeticError, AttributeError, AssertionError, EOFError, LookupError, MatReadError, MemoryError, OSError,
        TypeError, UnboundLocalError, ValueError, struct.error, zlib.error,
    ):  # fmt: skip
        raise DataFileError(
            "not a readable MATLAB file: it is damaged, or of another kind", FileFault.UNREADABLE
        ) from None
    objects = dict(_objects(content))
    columns = _gathered(variables, objects)
    columns.layout |= {"format": "MATLAB file"}
    if not columns:
        what = [f"{name} ({kind})" for name, kind in objects.items()]
        if what:
            raise DataFileError(
                f"the MATLAB file holds objects, {', '.join(what)}, and no numeric vectors: {_remedies(objects)}",
                FileFault.OBJECTS,
                column=next(iter(objects)),
            )
        others = "; it has " + ", ".join(columns.reasons) if columns.reasons else ""
        raise DataFileError(f"the MATLAB file holds no numeric vectors{others}", FileFault.NO_COLUMN)
    return columns


def _remedies(objects: dict[str, str]) -> str:
    name, kind = next(iter(objects.items()))
    return "save the columns as vectors in MATLAB, as in " + _save(name, kind)


def _save(name: str, kind: str) -> str:
    return _SAVE.get(kind, "u = {0}.u; y = {0}.y; save('new.mat', 'u', 'y', '-v7')").format(name)


def _gathered(variables: dict[str, Any], objects: dict[str, str]) -> Columns:
    columns = Columns()
    found = [
        one
        for name, values in variables.items()
        if not name.startswith("__") and not _is_object(values)
        for one in _parts(name, name, values)
    ]
    paths = {path for path, _, _ in found}
    shared = Counter(short for path, short, _ in found if short != path)
    places: dict[str, list[str]] = {}
    for path, short, values in found:
        is_alone = short not in paths and shared[short] == 1
        name = path if short == path or not is_alone else short
        if name in columns or name in columns.reasons:
            columns.leave_out(name, f"two values of the file are called '{name}'", FileFault.AMBIGUOUS_COLUMN)
            continue
        if short != path and not is_alone:
            places.setdefault(short, []).append(path)
        reason = _reason(values)
        if reason:
            columns.leave_out(name, f"'{name}' of the file is {reason}")
        else:
            columns[name] = np.asarray(values, dtype=np.float64)
            if np.issubdtype(values.dtype, np.integer) and np.any(np.abs(columns[name]) > LARGEST_EXACT):
                columns.whole[name] = values.astype(np.int64)
    for short, ways in places.items():
        if short not in columns and short not in columns.reasons:
            columns.leave_out(
                short, f"'{short}' of the file may be {' or '.join(ways)}: say which", FileFault.AMBIGUOUS_COLUMN
            )
    for name, kind in objects.items():
        reason = f"'{name}' is a MATLAB object ({kind}): save its columns as vectors, as in {_save(name, kind)}"
        columns.leave_out(name, reason, FileFault.OBJECTS)
        columns.notes.append(reason)
    return columns


def _parts(path: str, short: str, values: Any) -> Iterator[Found]:
    """Yield the vectors of a variable, those of structs and matrices one by one, and what is no vector."""
    if _is_object(values) or not isinstance(values, np.ndarray):
        yield path, short, values
    elif values.dtype.names is not None and values.ndim == 0:
        for field in values.dtype.names:
            yield from _parts(f"{path}.{field}", field, _element(values[field][()]))
    elif values.dtype.names is not None and values.ndim == 1:
        for at, element in enumerate(values, start=1):
            for field in values.dtype.names:
                yield from _parts(f"{path}({at}).{field}", f"{field}_{at}", _element(element[field]))
    elif values.ndim == 2 and values.dtype.kind in "biuf" and values.size:
        upright = values if values.shape[0] >= values.shape[1] else values.T
        for index in range(upright.shape[1]):
            yield f"{path}_{index + 1}", f"{short}_{index + 1}", upright[:, index]
    else:
        yield path, short, values


def _element(value: Any) -> Any:
    return value if isinstance(value, np.ndarray) or _is_object(value) else np.asarray(value)


def _reason(values: Any) -> str:
    """Why a value is no column; nothing where it is one."""
    if _is_object(values):
        return "a MATLAB object"
    if not isinstance(values, np.ndarray):
        return "a sparse matrix: save it as full(x)" if hasattr(values, "toarray") else "no array of numbers"
    if values.dtype.kind in "US":
        return "a text"
    if values.dtype.kind == "c":
        return "complex: save real and imaginary part as vectors"
    if values.dtype.kind not in "biuf":
        return "a cell array or struct array: save its columns as vectors"
    if values.ndim != 1 or not values.size:
        return "one number, not a column" if values.ndim == 0 else f"an array of {values.ndim} dimensions"
    if values.size > MAX_SAMPLES:
        return f"a vector of {values.size} values, of which at most {MAX_SAMPLES} are read: cut it"
    return ""


def _is_object(values: Any) -> bool:
    from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

    return isinstance(values, MatlabOpaque | MatlabObject | MatlabFunction)


def _objects(content: bytes) -> Iterator[tuple[str, str]]:
    """Yield name and class of the objects of a file of version 5, which SciPy mixes up where there are several."""
    order = "<" if content[126:128] == b"IM" else ">"
    at = 128
    while at + 8 <= len(content):
        kind, size = struct.unpack_from(order + "II", content, at)
        element = content[at + 8 : at + 8 + min(size, _MOST_NAMED)]
        if kind == _COMPRESSED:
            try:
                element = zlib.decompressobj().decompress(element, _MOST_NAMED)
            except zlib.error:
                return
            kind, element = (struct.unpack_from(order + "I", element)[0], element[8:]) if len(element) > 8 else (0, b"")
            at += 8 + size
        else:
            at += 8 + size + (-size % 8)
        if kind == _MATRIX and len(element) > 16 and element[8 if order == "<" else 11] == _OPAQUE:
            words = list(_words(element[16:], order))
            if len(words) == 3 and re.fullmatch(r"[A-Za-z]\w*", words[0]):
                yield words[0], words[2]


def _words(element: bytes, order: str) -> Iterator[str]:
    """Yield the first three texts of an object: its name, the kind of its class and the class."""
    at = 0
    for _ in range(3):
        if at + 8 > len(element):
            return
        kind, size = struct.unpack_from(order + "II", element, at)
        if kind >> 16:  # at most four bytes stand beside their number
            size = kind >> 16
            word, at = element[at + 4 : at + 4 + size], at + 8
        else:
            word, at = element[at + 8 : at + 8 + size], at + 8 + size + (-size % 8)
        yield word.decode("latin1")
