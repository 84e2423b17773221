"""Reader of MAT files for `guarded`: version 5 to 7 by SciPy, version 7.3, which is HDF5, by h5py.

Numbers, texts and structures; all else (cells, objects, sparse and complex numbers) is named with the reason.
"""

from __future__ import annotations

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

from commonrail.base.errors import InputError
from commonrail.readers.guarded import Save
from commonrail.readers.location import MOST_VALUES

WHAT = "MAT file"

MOST_VARIABLES = 10_000
DEEPEST = 4  # nested structures
LARGEST_CHUNK = 100_000_000  # [bytes] of HDF5; to read any part of a chunk unpacks all of it

_HDF5 = b"\x89HDF\r\n\x1a\n"
_MAT5 = (b"\x00\x01IM", b"\x01\x00MI")  # version and byte order at the end of the head

_TABLE = 'an object, which no other program reads; write S = table2struct(T, "ToScalar", true) and save S in MATLAB'
_REFUSED = {
    "table": f"it is a table, {_TABLE}",
    "timetable": f"it is a timetable, {_TABLE.replace('(T', '(timetable2table(T)')}",
    "string": "it is a string, an object, which no other program reads; save char(S) in MATLAB",
    "cell": "it is a cell array; write a matrix of numbers, as cell2mat does",
}
_COMPLEX = "its numbers are complex; save their real parts"
_SPARSE = "it is a sparse matrix; save full(S)"


class _Refused(str):
    """Reason why a variable is not read."""


Variables = Iterator[tuple[str, NDArray[Any] | str | _Refused]]


def read(path: Path, data: bytes, save: Save) -> dict[str, Any]:
    """Names of numeric variables in the order of their arrays "0", "1" …; by name, texts and reasons for a refusal."""
    if not (is_hdf5 := _HDF5 in (data[:8], data[512:520])) and data[124:128] not in _MAT5:
        raise InputError(f"{path}: this is no MAT file of version 5 or later; save it with -v7 in MATLAB.")
    names: dict[str, None] = {}
    texts: dict[str, str] = {}
    unread: dict[str, str] = {}
    for count, (name, value) in enumerate((_of_hdf5 if is_hdf5 else _of_mat5)(path, data)):
        if count >= MOST_VARIABLES:
            raise InputError(f"{path}: there are more than the {MOST_VARIABLES} variables that are read.")
        if isinstance(value, _Refused):
            unread[name] = value
        elif isinstance(value, str):
            texts[name] = value
        elif value.size and name not in names:
            save(str(len(names)), np.squeeze(value) if value.size > 1 else value.reshape(-1))
            names[name] = None
    return {"names": list(names), "texts": texts, "unread": unread}


def _check_count(path: Path, name: str, count: int) -> None:
    if count > MOST_VALUES:
        raise InputError(f'{path}: "{name}" has {count} numbers, and at most {MOST_VALUES} are read.')


def _of_mat5(path: Path, data: bytes) -> Variables:
    for name, value in loadmat(BytesIO(data)).items():
        if not name.startswith("__"):  # the head of the file
            yield from _flat(path, name, value, 0)


def _flat(path: Path, name: str, value: Any, depth: int) -> Variables:
    """The variable, or the fields of a structure or of each element of a structure array."""
    if type(value) is not np.ndarray:  # subclasses are objects and functions of MATLAB
        yield name, _refusal(str(getattr(value, "classname", "")) or type(value).__name__)
    elif value.dtype.names:
        for i, each in enumerate(value.ravel(order="F") if depth < DEEPEST else ()):
            here = name if value.size == 1 else f"{name}({i + 1})"
            for field in value.dtype.names:
                yield from _flat(path, f"{here}.{field}", each[field], depth + 1)
    elif value.dtype.kind == "U" and value.size == 1:
        yield name, str(value.item())
    elif value.dtype.kind in "biuf":
        _check_count(path, name, value.size)
        yield name, value
    elif value.size:
        yield name, {"c": _Refused(_COMPLEX), "U": _Refused("it holds texts")}.get(value.dtype.kind, _refusal("cell"))


def _refusal(kind: str) -> _Refused:
    """Reason why a variable of a class of MATLAB is not read."""
    kind = kind.removesuffix("_matrix").removesuffix("_array")
    sparse = kind in ("csc", "csr", "coo")
    return _Refused(
        _SPARSE if sparse else _REFUSED.get(kind, f"it is of the class {kind[:40]}; save its numbers alone")
    )


def _of_hdf5(path: Path, data: bytes) -> Variables:
    import h5py

    with h5py.File(BytesIO(data), "r") as file:
        for name, item in _in_hdf5(file, "", 0):
            kind = bytes(item.attrs.get("MATLAB_class", b"")).decode("ascii", "replace")
            if isinstance(item, h5py.Group):
                # a group counts as a variable, to end circular links
                yield name, _Refused(_SPARSE) if "MATLAB_sparse" in item.attrs else np.empty(0)
                continue
            if "MATLAB_object_decode" in item.attrs or kind in _REFUSED:
                yield name, _refusal(kind)
                continue
            if "MATLAB_empty" in item.attrs:
                continue  # it holds the sizes of an empty array
            if item.dtype.names:
                yield name, _Refused(_COMPLEX)
                continue
            if item.size is None or item.external or item.is_virtual or not item.size or item.dtype.kind not in "biuf":
                continue
            _check_count(path, name, item.size)
            chunk = int(np.prod(item.chunks or (0,), dtype=object)) * item.dtype.itemsize
            if chunk > LARGEST_CHUNK:
                raise InputError(
                    f'{path}: "{name}" is stored in chunks of {chunk / 1e6:.0f} MB, and at most '
                    f'{LARGEST_CHUNK / 1e6:.0f} MB are read; save it with "-v7" in MATLAB.'
                )
            array = np.asarray(item[()]).T  # MATLAB keeps columns together
            yield name, "".join(map(chr, array.reshape(-1, order="F").tolist())) if kind == "char" else array


def _in_hdf5(group: Any, inside: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Names and items of data sets and groups; circular links repeat items."""
    import h5py

    for name in group:
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue  # MATLAB's internal groups, and links, which may lead to other files
        item = group[name]
        yield f"{inside}{name}", item
        if isinstance(item, h5py.Group) and depth < DEEPEST and "MATLAB_sparse" not in item.attrs:
            yield from _in_hdf5(item, f"{inside}{name}.", depth + 1)
