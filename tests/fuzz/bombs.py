"""Small files built to take memory or time without end; each must be read or refused as any other."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterable
from io import BytesIO
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np

from commonrail.readers.overview import survey
from commonrail.readers.toml import read_toml

__all__ = ["BOMBS", "blank_lines", "lvm", "mat5_names", "mat73_chunk", "mdf_loop", "read", "sheet", "thousands", "xlsx"]

_MAIN = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
_OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
_PACKAGE = "http://schemas.openxmlformats.org/package/2006"


def read(folder: Path) -> None:
    """Read the files of a folder as `commonrail inspect` does, or as TOML."""
    for path in sorted(folder.iterdir()):
        (read_toml if path.suffix == ".toml" else survey)(path)


def thousands(columns: int, rows: int) -> bytes:
    """A text with one long row above short ones: filled up, a rectangle."""
    return b";".join([b"1.200"] * columns) + b"\n" + b"1.200;\n" * rows


def blank_lines(count: int) -> bytes:
    """A text of empty lines and a table."""
    return b"\n" * count + b"a,b\n1,2\n"


def spaces(lines: int) -> bytes:
    """TOML of lines that a pattern could split at every space."""
    return b"format = 1\n" + (b" " * 9998 + b"#\n") * lines


def lvm(channels: int, tags: int = 0, blank: int = 0) -> bytes:
    """A LabVIEW measurement of one row, with tags that nobody reads and empty rows."""
    values = {"Samples": b"1", "X0": b"0", "Delta_X": b"1e-6"}
    segment = [f"Channels\t{channels}".encode()]
    segment += [b"\t".join([tag.encode(), *[value] * channels]) for tag, value in values.items()]
    segment += [b"t%d\tx" % i for i in range(tags)]
    titles = b"\t".join([b"X_Value", *(b"c%d" % i for i in range(channels)), b"Comment"])
    head = [b"LabVIEW Measurement", b"Separator\tTab", b"Decimal_Separator\t.", b"***End_of_Header***"]
    lines = [*head, *segment, b"***End_of_Header***", titles, b"\t".join([b"0", *[b"1"] * channels]), *[b""] * blank]
    return b"\n".join(lines) + b"\n"


def xlsx(cells: Iterable[bytes], shared: Iterable[bytes] = ()) -> bytes:
    """A workbook of one sheet, from pieces of the XML of its rows and of its shared texts."""
    relation = f'<Relationship Id="{{}}" Type="{_OFFICE}/{{}}" Target="{{}}"/>'.format
    relations = f'<Relationships xmlns="{_PACKAGE}/relationships">{{}}</Relationships>'.format
    kind = "application/vnd.openxmlformats-officedocument.spreadsheetml."
    types = "".join(
        f'<Override PartName="/xl/{part}" ContentType="{kind}{what}+xml"/>'
        for part, what in (("workbook.xml", "sheet.main"), ("s.xml", "worksheet"), ("t.xml", "sharedStrings"))
    )
    parts = {
        "[Content_Types].xml": f'<Types xmlns="{_PACKAGE}/content-types">{types}</Types>',
        "_rels/.rels": relations(relation("r1", "officeDocument", "xl/workbook.xml")),
        "xl/_rels/workbook.xml.rels": relations(
            relation("r1", "worksheet", "s.xml") + relation("r2", "sharedStrings", "t.xml")
        ),
        "xl/workbook.xml": f'<workbook xmlns="{_MAIN}" xmlns:r="{_OFFICE}"><sheets>'
        '<sheet name="S" sheetId="1" r:id="r1"/></sheets></workbook>',
    }
    stream = BytesIO()
    with ZipFile(stream, "w", ZIP_DEFLATED) as book:
        for name, text in parts.items():
            book.writestr(name, text)
        for name, root, pieces in (("s.xml", "worksheet", cells), ("t.xml", "sst", shared)):
            inner = b"sheetData" if root == "worksheet" else b""
            with book.open(f"xl/{name}", "w", force_zip64=True) as part:
                part.write(f'<{root} xmlns="{_MAIN}">'.encode() + (b"<%s>" % inner if inner else b""))
                part.writelines(pieces)
                part.write((b"</%s>" % inner if inner else b"") + f"</{root}>".encode())
    return stream.getvalue()


def sheet(rows: int) -> bytes:
    """An honest trace whose last column of the sheet, XFD, has a format and no values."""
    cells = [b'<row r="1"><c r="A1" t="inlineStr"><is><t>time [us]</t></is></c>']
    cells += [b'<c r="B1" t="inlineStr"><is><t>rate [mm3/ms]</t></is></c><c r="XFD1"/></row>']
    row = '<row r="{0}"><c r="A{0}"><v>{0}</v></c><c r="B{0}"><v>1.5</v></c><c r="XFD{0}"/></row>'.format
    return xlsx([*cells, *(row(i).encode() for i in range(2, rows + 2))])


def text_cell(size: int) -> bytes:
    """A workbook with one text of a million characters, again and again."""
    head, tail = b'<row r="1"><c r="A1" t="inlineStr"><is><t>', b"</t></is></c></row>"
    return xlsx([head, *[b"A" * 1_000_000] * (size // 1_000_000), tail])


def _element(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content + b"\0" * (-len(content) % 8)


def mat5_names(names: int) -> bytes:
    """MAT 5: a compressed structure with so many names of fields, and none in it."""
    head = b"MATLAB 5.0 MAT-file".ljust(116) + b"\0" * 8 + b"\x00\x01IM"
    shape = _element(6, struct.pack("<II", 2, 0)) + _element(5, struct.pack("<ii", 1, 1)) + _element(1, b"s")
    packed = zlib.compress(_element(14, shape + _element(5, struct.pack("<i", 2)) + _element(1, b"ab" * names)))
    return head + struct.pack("<II", 15, len(packed)) + packed


def mat73_chunk(numbers: int) -> bytes:
    """MAT 7.3: one number, stored in a chunk for many."""
    import h5py

    stream = BytesIO()
    with h5py.File(stream, "w") as file:
        data = file.create_dataset("x", (1,), "f8", maxshape=(None,), chunks=(numbers,), compression="gzip")
        pack, zeros = zlib.compressobj(), bytes(8_000_000)
        pieces = [pack.compress(zeros) for _ in range(8 * numbers // len(zeros))]
        data.id.write_direct_chunk((0,), b"".join([*pieces, pack.flush()]))
    return stream.getvalue()


def _mdf(change: Callable[[bytearray], None]) -> bytes:
    import asammdf

    times = np.arange(0.0, 1e-3, 1e-5)
    record = asammdf.MDF()
    record.append([asammdf.Signal(np.sin(times), times, "mm3/ms", "ROI")], acq_name="g")
    stream = BytesIO()
    record.save(stream)
    record.close()
    data = bytearray(stream.getvalue())
    change(data)
    return bytes(data)


def mdf_loop() -> bytes:
    """MDF: the block of a group whose successor is itself."""

    def change(data: bytearray) -> None:
        start = data.find(b"##CG")
        data[start + 24 : start + 32] = struct.pack("<Q", start)

    return _mdf(change)


def mdf_record() -> bytes:
    """MDF: records that are said to have 4 GB each."""

    def change(data: bytearray) -> None:
        start = data.find(b"##CG")
        links = struct.unpack("<Q", data[start + 16 : start + 24])[0]
        place = start + 24 + 8 * links + 24
        data[place : place + 4] = struct.pack("<I", 2**32 - 1)

    return _mdf(change)


def tdms_count(values: int) -> bytes:
    """TDMS: a channel that is said to have so many values."""
    from nptdms import ChannelObject, TdmsWriter

    stream = BytesIO()
    with TdmsWriter(stream) as writer:
        writer.write_segment([ChannelObject("g", "ROI", np.zeros(30), {"wf_increment": 1e-5})])
    index = struct.pack("<IIQ", 10, 1, 30)  # doubles, one dimension, number
    return stream.getvalue().replace(index, struct.pack("<IIQ", 10, 1, values))


BOMBS: dict[str, Callable[[], bytes]] = {
    "long_row.csv": lambda: thousands(16_000, 900_000),
    "rectangle.csv": lambda: thousands(900, 900_000),
    "blank.csv": lambda: blank_lines(4_000_000),
    "spaces.toml": lambda: spaces(99),
    "tags.lvm": lambda: lvm(12_000, tags=500_000),
    "blank.lvm": lambda: lvm(1000, blank=4_000_000),
    "formats.xlsx": lambda: xlsx([b'<row><c r="XFD1"/></row>' * 400_000]),
    "text.xlsx": lambda: text_cell(480_000_000),
    "texts.xlsx": lambda: xlsx([], [b"<si><t>ab</t></si>" * 10_000] * 2700),
    "depth.xlsx": lambda: xlsx([b"<a>" * 3_000_000 + b"</a>" * 3_000_000]),
    "attributes.xlsx": lambda: xlsx([b"<row " + b" ".join(b'a%d="1"' % i for i in range(500_000)) + b"/>"]),
    "names.mat": lambda: mat5_names(49_000_000),
    "chunk.mat": lambda: mat73_chunk(500_000_000),
    "depth.cdfx": lambda: b"<a>" * 6_000_000,
    "count.tdms": lambda: tdms_count(2**50),
    "loop.mf4": mdf_loop,
    "record.mf4": mdf_record,
}
