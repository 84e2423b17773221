"""Format of a data file: recognised by its first bytes, else by the ending of its name."""

from __future__ import annotations

import sys
from pathlib import Path
from zipfile import BadZipFile, ZipFile

from commonrail.base.errors import InputError
from commonrail.base.input import LARGEST_FILE, open_plain

_FIRST = 4096  # bytes that are looked at

# First bytes of formats, by the ending under which a reader of them is registered.
_READABLE = {
    **dict.fromkeys((b"MDF ", b"UnFinMF"), "mf4"),
    **dict.fromkeys((b"MATLAB 5.0", b"MATLAB 7.3"), "mat"),
    b"LabVIEW Measurement": "lvm",
    b"PAR1": "parquet",
    b"TDSm": "tdms",
    b"KONSERVIERUNG_FORMAT": "dcm",
}
# Signatures of readable formats that follow comments or an XML header.
_READABLE_INSIDE = {b"\nKONSERVIERUNG_FORMAT": "dcm", b"<MSRSW": "cdfx", b"<tableData": "table"}
_HDF5, _ZIP = b"\x89HDF\r\n\x1a\n", b"PK\x03\x04"
# First bytes of formats without a reader, with their names.
_UNREAD = {
    _HDF5: "HDF5",
    **dict.fromkeys((b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", b"\x09\x08\x10\x00"), "old Excel"),
    **dict.fromkeys((b"CDF\x01", b"CDF\x02", b"CDF\x05"), "NetCDF"),
    **dict.fromkeys((b"DIAEXTENDED", b"DIADEM"), "DIAdem"),
    **dict.fromkeys((b"<html", b"<!DOCTYPE html"), "HTML"),
    **dict.fromkeys((b"\x1f\x8b", b"7z\xbc\xaf", b"Rar!"), "compressed"),
    b"\x93NUMPY": "NumPy",
    b"LOGG": "BLF",
    b"%PDF": "PDF",
}
# Signatures of formats without a reader that follow other bytes.
_INSIDE = {b"WAVEDESC": "LeCroy", b":WFM#": "Tektronix", b"<usi:tdm": "DIAdem", b"urn:schemas-microsoft-com": "XML"}
# Binary formats without a signature, by file ending.
_ENDINGS = {"nc": "NetCDF", "xls": "old Excel", "ifl": "IFL", "tdx": "DIAdem"}
_ALIASES = {"xlsm": "xlsx", "mdf": "mf4", "pq": "parquet"}
_CURES = {
    **dict.fromkeys(("ZIP", "compressed"), "unpack it, and name the file in it"),
    "old Excel": "save it as .xlsx, or export the columns to a CSV file",
    "NumPy": "write the array with numpy.savetxt, a header and units to a CSV file",
}


def find_format(path: Path) -> str:
    """Ending under which a reader of the file's format is registered.

    If the first bytes are not of a known format, or the file is missing, it is the file's own ending in lower case; the
    reader then reports the reason.
    """
    ending = path.suffix.lower().removeprefix(".")
    first = _first_bytes(path)
    recognised = next((name for start, name in _READABLE.items() if first.startswith(start)), "")
    recognised = recognised or next((name for inside, name in _READABLE_INSIDE.items() if inside in first), "")
    if recognised or (first.startswith(_ZIP) and "xl/workbook.xml" in _members(path)):
        return recognised or "xlsx"
    if first.startswith(_HDF5, 512) and ending == "mat":
        return "mat"
    return _ALIASES.get(ending, ending)


def unread_format(path: Path) -> str:
    """Name of the format of a file that has no reader; empty for a text or a missing file."""
    first, ending = _first_bytes(path), path.suffix.lower().removeprefix(".")
    if name := next((name for start, name in _UNREAD.items() if first.lstrip().startswith(start)), ""):
        return name
    if first.startswith(_ZIP):
        members = _members(path)
        if "xl/workbook.xml" in members:
            return ""
        kinds = {"OpenDocument": "mimetype", "NumPy": ".npy"}
        return next((kind for kind, end in kinds.items() if any(name.endswith(end) for name in members)), "ZIP")
    if name := next((name for inside, name in _INSIDE.items() if inside in first), ""):
        return name
    if first and not _is_binary(first):
        return ""
    return _ENDINGS.get(ending, "TDMS" if first.startswith(b"TDSm") else "binary" if first else "")


def refuse_unread(path: Path) -> None:
    """Raise `InputError` with a remedy if the format of a file has no reader."""
    if name := unread_format(path):
        cure = _CURES.get(name, "export the columns to a CSV file")
        which = "binary files of this format" if name == "binary" else f"{name} files"
        raise InputError(f"{path}: {which} are not read; {cure}.", code="unknown-format", file=path)


def _first_bytes(path: Path) -> bytes:
    """First bytes of a plain file; empty if it cannot be read."""
    try:
        with open_plain(path, sys.maxsize) as stream:
            return stream.read(_FIRST)
    except InputError:
        return b""


def _members(path: Path) -> list[str]:
    """Names of the files in a ZIP archive; empty if the archive is damaged or too large."""
    try:
        with open_plain(path, LARGEST_FILE) as stream, ZipFile(stream) as archive:
            return archive.namelist()
    except (InputError, BadZipFile, OSError, ValueError, NotImplementedError):
        return []


def _is_binary(first: bytes) -> bool:
    """Return whether bytes are not text: zeros that are not of UTF-16, or many control characters."""
    zeros = (first[1:200:2].count(0), first[0:200:2].count(0))
    if first.startswith((b"\xff\xfe", b"\xfe\xff")) or (max(zeros) > 20 and min(zeros) == 0):
        return False
    odd = sum(byte < 32 and byte not in b"\t\n\r\x0b\x0c\x1b\x1c" for byte in first)
    return b"\0" in first or odd > len(first) // 20
