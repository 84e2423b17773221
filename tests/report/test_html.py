"""Names in a page."""

from commonrail.report.html import breakable


def test_a_long_name_may_be_broken_at_its_joints_and_stays_escaped() -> None:
    assert breakable("seat.cone_angle") == "seat.<wbr>cone_<wbr>angle"
    assert breakable("<b>.x") == "&lt;b&gt;.<wbr>x"
