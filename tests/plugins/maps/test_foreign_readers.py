"""Files of control units, read by programs of others where these are installed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from commonrail.plugins.maps.file import write_map_file
from tests.plugins.maps.tables import table


@pytest.fixture
def dcm(tmp_path: Path) -> Path:
    """A map as DCM."""
    path = tmp_path / "map.dcm"
    write_map_file(path, [table()])
    return path


def test_dcmreader_reads_the_same_digits(dcm: Path) -> None:
    module = pytest.importorskip("dcmReader.dcm_reader", reason="dcmReader is not installed")
    own, reader = table(), module.DcmReader()
    reader.read(str(dcm))
    (found,) = reader.get_characteristic_maps()
    assert (found.name, found.x_dimension, found.y_dimension) == (own.label, 7, 3)
    assert (found.unit_x, found.unit_y, found.unit_values) == ("hPa", "mm^3/inj", "us")
    values = [[found.values[y][x] for x in own.x.values.tolist()] for y in own.y.values.tolist()]
    assert np.array_equal(np.array(values), own.values)


def test_pydcm_reads_the_same_digits(dcm: Path) -> None:
    module = pytest.importorskip("pydcm", reason="pydcm of zhyongquan is not installed")
    own, reader = table(), module.dcminfo()
    reader.read(str(dcm))
    found = reader.calibrations[own.label]
    assert (found.type, found.x.unit, found.y.unit, found.unit) == ("MAP", "hPa", "mm^3/inj", "us")
    assert (found.x.value, found.y.value) == (own.x.values.tolist(), own.y.values.tolist())
    assert np.array_equal(np.array(found.value), own.values)


@pytest.fixture
def cdfx(tmp_path: Path) -> Path:
    """A map as CDFX."""
    path = tmp_path / "map.cdfx"
    write_map_file(path, [table(note="a < b")])
    return path


def test_cdfx_is_valid_by_the_definition_of_the_format(cdfx: Path) -> None:
    etree = pytest.importorskip("lxml.etree", reason="lxml is not installed")
    asamint = pytest.importorskip("asamint", reason="asamint, which has the document type, is not installed")
    (folder,) = asamint.__path__
    kind = etree.DTD(f"{folder}/data/dtds/cdf_v2.0.0.sl.dtd")
    assert kind.validate(etree.parse(str(cdfx))), kind.error_log


def test_asamint_reads_the_same_digits_from_cdfx(cdfx: Path, tmp_path: Path) -> None:
    module = pytest.importorskip("asamint.calibration.msrsw_db", reason="asamint is not installed")
    own = table()
    module.Parser(str(cdfx), module.MSRSWDatabase(tmp_path / "read"))
    session = module.MSRSWDatabase(tmp_path / "read").session
    (instance,) = session.query(module.SwInstance).all()
    assert (instance.short_name.content, instance.category.content) == (own.label, "MAP")
    groups = instance.sw_value_cont.sw_values_phys.vgs
    values = [[float(v.content) for v in group.vs] for group in groups]
    assert np.array_equal(np.array(values), own.values)
    axes = instance.sw_axis_conts.sw_axis_cont
    places = [[float(v.content) for v in axis.sw_values_phys.vs] for axis in axes]
    assert places == [own.x.values.tolist(), own.y.values.tolist()]
    assert [axis.unit_display_name.content for axis in axes] == ["hPa", "mm^3/inj"]
