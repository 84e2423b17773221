"""Inputs that an FMU and a library of each variant declare or refuse: none is taken and ignored."""

from __future__ import annotations

from dataclasses import replace

import pytest

import commonrail as cr
from commonrail.base.choices import Actuation, Boundary, Drive
from commonrail.engine.status import check_inputs
from commonrail.physics.variants import DRIVE, RAIL, RETURN, Variant, unread_inputs, unread_parameters
from commonrail.plugins.export.description import AT_REST, terminals, variables
from commonrail.plugins.export.sources import define_inputs_read
from commonrail.plugins.export.verb import Form, _next

SERVO = [Variant("flexible", rail, drive) for rail in Boundary for drive in Drive]
DIRECT = [Variant(drive=drive, actuation=Actuation.DIRECT) for drive in Drive]
VARIANTS = pytest.mark.parametrize("variant", [*SERVO, *DIRECT], ids=lambda v: v.label)


def injector_of(variant: Variant) -> cr.Injector:
    name = "direct-acting-kr" if variant.actuation is Actuation.DIRECT else "cri2-16"
    return replace(cr.load_injector(name), variant=variant)


@VARIANTS
def test_an_fmu_declares_what_its_variant_reads_and_nothing_else(variant: Variant) -> None:
    listed = variables(injector_of(variant))
    inputs = {v.name.removeprefix("boundary.") for v in listed if v.kind.causality == "input"} - {"command"}
    unread = unread_inputs(variant)
    assert inputs == {RAIL, "cylinder_pressure", RETURN, DRIVE}.difference(unread)
    names = {v.name for v in listed}
    assert (AT_REST in names) == (RAIL in unread)  # a rail's volume has a pressure at rest
    assert not names & unread_parameters(variant)
    assert ("boundary.drive" in terminals(listed)) == (DRIVE not in unread)


@VARIANTS
def test_the_header_of_a_library_says_what_is_read(variant: Variant) -> None:
    unread = {name for name, read, _ in define_inputs_read(variant) if not read}
    assert unread == {f"READS_{name.upper()}" for name in unread_inputs(variant)}


@VARIANTS
def test_a_measured_course_that_is_not_read_is_refused(variant: Variant) -> None:
    injector, course = injector_of(variant), cr.Trace((0.0, 1e-3), (1e5, 2e5))
    for name, point in (
        (DRIVE, cr.OperatingPoint("20 MPa", "400 us", 0.1e6, 0.1e6, drive=course)),
        (RETURN, cr.OperatingPoint("20 MPa", "400 us", 0.1e6, course)),
    ):
        if name in unread_inputs(variant):
            with pytest.raises(cr.errors.ConfigurationError, match=f"measured {name.replace('_', ' ')}"):
                check_inputs(injector, point)
        else:
            check_inputs(injector, point)


def test_an_export_says_which_courses_other_variants_read() -> None:
    said = _next(Form.FMU, injector_of(Variant()._replace(boundary=Boundary.VOLUME)))
    assert "over time" in said
    assert "@ideal" in said
    assert "@current-trace" in said
    assert "other variants" not in _next(Form.FMU, injector_of(Variant("rigid", "ideal", "current trace")))
