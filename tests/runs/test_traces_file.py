"""traces.csv: nothing is lost on the way there and back, and what is broken is named with its line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commonrail.base.errors import InputError
from commonrail.calibration.study_file import MOST_SAMPLES
from commonrail.readers.table_sheet import LARGEST_PLAIN, WrittenTable
from commonrail.runs.traces import Curve, read_traces, write_traces
from tests.refused import refused

HEAD = "data,time [us],measured [mm3/ms],best [mm3/ms]"
LABELS = ("measured", 'a,"b"', "none")


def curve(name: str, seed: int) -> Curve:
    """Random rates in two columns [m³/s]; one sample of the model is missing."""
    rng = np.random.default_rng(seed)
    rates = {"measured": rng.normal(0.0, 5e-5, 4), 'a,"b"': rng.normal(0.0, 5e-5, 4)}
    rates['a,"b"'][1] = np.nan
    return Curve(name, 3e-6 * np.arange(5), rates)


def test_rates_come_back_to_the_last_digits(tmp_path: Path) -> None:
    path = tmp_path / "traces.csv"
    curves = [curve("160 MPa", 1), curve("#2, main", 2)]
    write_traces(path, ["two\nlines", "synthetic"], LABELS, curves)
    traces = read_traces(path)
    assert list(traces) == ["160 MPa", "#2, main"]
    for written in curves:
        trace = traces[written.data]
        assert set(trace) == {"time_s", "measured", 'a,"b"'}  # a label without any number is not there
        # times to 1e-6 us; rates pass through a factor of 1e6 and back, two roundings
        np.testing.assert_allclose(trace["time_s"], [1.5e-6, 4.5e-6, 7.5e-6, 10.5e-6], rtol=0.0, atol=1e-12)
        for label in ("measured", 'a,"b"'):
            np.testing.assert_allclose(trace[label], written.rates[label], rtol=1e-15)


def test_as_many_samples_are_read_as_a_study_may_have(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = {}

    class Watched(WrittenTable):
        def __init__(self, path: Path, **how: Any) -> None:
            asked.update(how)
            super().__init__(path, **how)

    monkeypatch.setattr("commonrail.runs.traces.WrittenTable", Watched)
    write_traces(tmp_path / "traces.csv", [], LABELS, [curve("160 MPa", 1)])
    read_traces(tmp_path / "traces.csv")
    row = (tmp_path / "traces.csv").stat().st_size / 4
    assert asked["most"] >= MOST_SAMPLES
    assert row * MOST_SAMPLES <= LARGEST_PLAIN


def test_comments_stand_on_lines_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "traces.csv"
    write_traces(path, ["two\nlines"], LABELS, [])
    assert path.read_text(encoding="utf-8").splitlines()[0] == "# two lines"


def test_what_is_not_finite_stays_empty(tmp_path: Path) -> None:
    path = tmp_path / "traces.csv"
    write_traces(path, [], LABELS, [curve("a", 1)])
    assert path.read_text(encoding="utf-8").splitlines()[2].endswith(",,")


@pytest.mark.parametrize("empty", ["", "nan"])
def test_a_model_without_a_number_leaves_a_gap(tmp_path: Path, empty: str) -> None:
    path = tmp_path / "traces.csv"
    path.write_text(f"# x\n{HEAD}\na,1.5,2.0,{empty}\na,4.5,2.0,3.0\n", encoding="utf-8")
    assert np.isnan(read_traces(path)["a"]["best"]).tolist() == [True, False]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            f"# x\n{HEAD}\na,1.5,2.0,3.0\n\na,4.5,2.0,oops\n",
            r'line 5, column "best \[mm3/ms\]": "oops"',
        ),
        (f"{HEAD}\na,1.5,2.0,inf\n", "line 2, .*inf"),
        (f"{HEAD}\na,1.5,nan,3.0\n", r'line 2, column "measured \[mm3/ms\]": "nan"'),
        (f"{HEAD}\na,1.5,,3.0\n", "line 2, .*measured"),
        (f"{HEAD}\na,,2.0,3.0\n", r'line 2, column "time \[us\]"'),
        (f"{HEAD}\na,1.5,2.0\n", "line 2: .*3 cells, .*4"),
        (f"{HEAD}\na,1.5,2.0,3.0,4.0\n", "line 2: .*5 cells, .*4"),
        (f'{HEAD}\n"a,1.5,2.0,3.0\n', "line 2: the row"),
        (f"{HEAD}\n{'a' * 200_000},1.5,2.0,3.0\n", "line 2: .*200012"),
        ("", "no rows"),
        ("# only a comment\n", "no rows"),
        ("time [us],data,measured [mm3/ms]\n", "the header"),
        ("data,time [us],best [mm3/ms]\n", "the header"),
        ("data,time [us],measured [mm3/ms],best\n", "the header"),
        ("data,time [us],measured [mm3/ms],b [mm3/ms],b [mm3/ms]\n", "the header"),
        (b"\xff\xfe", "UTF-16"),
    ],
)
def test_a_broken_file_is_one_sentence_with_the_line(tmp_path: Path, text: str | bytes, words: str) -> None:
    path = tmp_path / "traces.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError, match=words) as caught:
        read_traces(path)
    assert str(path) in str(caught.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with refused(InputError, "missing-file", "traces.csv"):
        read_traces(tmp_path / "traces.csv")
