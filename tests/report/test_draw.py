"""Drawing keeps the numbers, fits its room, and makes no markup of a name."""

from __future__ import annotations

import math
import re
from itertools import pairwise
from xml.etree import ElementTree

import pytest

from commonrail.base.chart import MARKERS, Band, Bars, Boxes, Figure, HeatMap, Panel, Series
from commonrail.data.records import LABELS
from commonrail.report.axis import SIZE, Axis, text_width
from commonrail.report.figure import _DARK, NARROW, RAMP, WIDE, colour_of, figure_html, figure_svg
from commonrail.report.fit.figures import figures_of
from commonrail.report.heat_map import SMALLEST, heat_map_svg
from tests.report.samples import map_record, rate_record, rate_traces

SVG = "{http://www.w3.org/2000/svg}"


def figure(*panels: Panel) -> Figure:
    """Figure without words."""
    return Figure("", "", "", panels)


def texts(svg: str) -> list[str]:
    """All texts of a picture."""
    return [node.text or "" for node in ElementTree.fromstring(svg).iter(f"{SVG}text")]


def places(svg: str) -> list[list[tuple[int, int]]]:
    """Points of each curve, in tenths of a pixel of its panel."""
    found = []
    for node in ElementTree.fromstring(svg).iter(f"{SVG}path"):
        if node.get("class") == "curve":
            first, _, steps = (node.get("d") or "")[1:].partition("l")
            x, y = map(int, first.split())
            own = [(x, y)]
            numbers = list(map(int, re.findall(r"-?\d+", steps)))
            for dx, dy in zip(numbers[::2], numbers[1::2], strict=True):
                x, y = x + dx, y + dy
                own.append((x, y))
            found.append(own)
    return found


def test_every_figure_can_be_drawn() -> None:
    record = rate_record()
    figures = [
        *figures_of(record["data"], LABELS, rate_traces(record)),
        *figures_of(map_record()["data"], LABELS, {}),
    ]
    for i, one in enumerate(figures):
        for width in (WIDE, NARROW):
            ElementTree.fromstring(figure_svg(one, width))
        assert figure_html(one, f"f{i}").count('<svg class="figure') == 2


def test_a_curve_goes_through_its_values() -> None:
    series = Series("a", "best", (0.0, 1.0, 4.0), (0.0, 10.0, 2.0))
    svg = figure_svg(figure(Panel("", (series,))))
    (own,) = places(svg)
    pane = next(node for node in ElementTree.fromstring(svg).iter(f"{SVG}svg") if node.get("class") == "pane")
    (x0, x1), (y0, y1) = (map(float, (pane.get(key) or "").split()) for key in ("data-x", "data-y"))
    width, height = (10.0 * float(pane.get(key) or 0) for key in ("width", "height"))
    back = [(x0 + i / width * (x1 - x0), y1 - j / height * (y1 - y0)) for i, j in own]
    assert [x for x, _ in back] == pytest.approx([0.0, 1.0, 4.0], abs=2e-3)  # a tenth of a pixel of 700
    assert [y for _, y in back] == pytest.approx([0.0, 10.0, 2.0], abs=1e-2)  # of 200


@pytest.mark.parametrize("height", [200, 290, 340, 420, 560, 900])
@pytest.mark.parametrize("width", [WIDE, NARROW])
def test_numbers_of_a_vertical_axis_are_whole_and_beside_its_title(height: int, width: int) -> None:
    boxes = Boxes("a", "best", ((0.1, 0.5, 0.8, 1.0, 3.0),))
    lines = (Series("b", "best", (0.0, 1.0), (12_000.0, 47_500.0)), Series("", "start", (0.0, 1.0), (-3.1e-5, 4e-6)))
    panels = [Panel("k", (), boxes=(boxes,), categories=("k1",)), *(Panel("y", (one,), 0.34) for one in lines)]
    for shown in (panels[:1], panels[1:2], panels[1:]):
        svg = figure_svg(figure(*shown), width, height)
        numbers = [
            node.text or ""
            for axis in ElementTree.fromstring(svg).iter(f"{SVG}g")
            if axis.get("class") == "ys"
            for node in axis
        ]
        assert len(numbers) >= 2
        assert not [text for text in numbers if "…" in text]
        left = min(float(x) for x in re.findall(r'class="panel" transform="translate\(([\d.]+)', svg))
        assert left >= max(map(text_width, numbers)) + 6.0 + SIZE  # their distance from the axis, the title's letters


def test_a_gap_stays_a_gap() -> None:
    series = Series("a", "best", (0.0, 1.0, 2.0, 3.0, 4.0), (0.0, 1.0, None, 1.0, 0.0))
    assert figure_svg(figure(Panel("", (series,)))).count(" l") == 0
    (path,) = re.findall(r'class="curve"[^>]* d="([^"]*)"', figure_svg(figure(Panel("", (series,)))))
    assert path.count("M") == 2


def test_a_long_straight_line_needs_two_points_and_a_peak_is_kept() -> None:
    x = tuple(float(i) for i in range(2001))
    straight = Series("a", "best", x, x)
    peak = Series("b", "start", x, tuple(2000.0 if i == 1001 else 0.0 for i in range(2001)))
    first, second = places(figure_svg(figure(Panel("", (straight, peak)))))
    assert len(first) < 100
    assert min(j for _, j in second) == min(j for _, j in first)  # both reach 2000


@pytest.mark.parametrize("looks", [("measured", "rigid", "start", "best")])
def test_curves_differ_in_more_than_colour(looks: tuple[str, ...]) -> None:
    series = tuple(Series(look, look, (0.0, 1.0), (0.0, 1.0)) for look in looks)
    curves = re.findall(r'<path class="curve"[^>]*>', figure_svg(figure(Panel("", series))))
    styles = [re.findall(r'stroke-(?:width|dasharray)="[^"]*"', curve) for curve in curves]
    assert len({tuple(style) for style in styles}) == len(looks)


def lightness(colour: str) -> float:
    """L* of CIE 1976 from the relative luminance of sRGB."""
    parts = [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
    red, green, blue = (v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in parts)
    return 116.0 * math.cbrt(0.2126 * red + 0.7152 * green + 0.0722 * blue) - 16.0


@pytest.mark.parametrize("colours", [RAMP, tuple(_DARK[colour] for colour in RAMP)])
def test_an_ordered_quantity_rises_in_lightness_which_nobody_is_blind_to(colours: tuple[str, ...]) -> None:
    found = [lightness(colour) for colour in colours]
    assert all(after - before > 3.0 for before, after in pairwise(found))  # of 100; 1 is just seen


def test_rail_pressures_have_the_ends_of_the_ramp_however_many_they_are() -> None:
    for count in (2, 4, 9):
        colours = [colour_of("best", family, count) for family in range(count)]
        assert (colours[0], colours[-1]) == (RAMP[0], RAMP[-1])
        assert [RAMP.index(colour) for colour in colours] == sorted({RAMP.index(colour) for colour in colours})


def test_a_name_cannot_become_markup_in_a_legend() -> None:
    series = Series('<a href="https://example.org">x</a>', "best", (0.0, 1.0), (0.0, 1.0))
    svg = figure_svg(figure(Panel("", (series,))))
    assert "<a" not in svg
    assert any(text.startswith("<a href=") for text in texts(svg))


def test_a_logarithmic_axis_writes_its_numbers_in_full() -> None:
    series = Series("", "best", (0.0, 1.0), (2000.0, 170.0))
    assert {"200", "500", "1000", "2000"} <= set(texts(figure_svg(figure(Panel("", (series,), logarithmic=True)))))


def test_a_constant_line_has_an_axis_that_is_wider_than_its_rounding() -> None:
    constant = Series("", "best", (0.0, 1.0), (10830.5, 10830.5 * (1.0 + 1e-15)))
    (ends,) = re.findall(r'data-y="([^"]*)"', figure_svg(figure(Panel("", (constant,)))))
    low, high = map(float, ends.split())
    assert low < 10300.0
    assert high > 11300.0


def test_what_many_entries_need_is_added_above_the_panels() -> None:
    series = tuple(
        Series(f"a rather long name, number {i}", "solid", (0.0, 1.0), (0.0, 1.0), family=i) for i in range(9)
    )
    few, many = (figure_svg(figure(Panel("", series[:n])), NARROW) for n in (1, 9))
    assert sum(text.startswith("a rather") for text in texts(many)) == 9
    heights = [float(re.findall(r'viewBox="0 0 \d+ (\d+)"', svg)[0]) for svg in (few, many)]
    assert heights[1] > heights[0] + 60.0


def test_boxes_bars_bands_and_markers_are_drawn() -> None:
    boxes = Panel("", (), boxes=(Boxes("b", "best", ((0.0, 1.0, 2.0, 3.0, 4.0),)),), categories=("one",))
    bars = Panel("", (), bars=(Bars("c", "start", (0.0,), (2.0,), (1.0,), (3.0,)),), rows=("a long name of a row",))
    band = Panel(
        "",
        (Series("d", "best", (0.0, 1.0), (1.0, 2.0), MARKERS),),
        bands=(Band("best", (0.0, 1.0), (0.0, 1.0), (2.0, 3.0)),),
    )
    assert {"one", "b"} <= set(texts(figure_svg(figure(boxes))))
    assert {"a long name of a row", "c"} <= set(texts(figure_svg(figure(bars))))
    assert figure_svg(figure(band)).count('h1"') == 1


def test_a_heat_map_writes_its_numbers_and_leaves_empty_cells_out() -> None:
    heat = HeatMap(
        "t", "", "x", "y", ("1", "2"), ("a", "b"), ((1.0, None), (-2.0, 3.0)), (("+1", ""), ("−2", "+3")), "%", True
    )
    drawn = texts(heat_map_svg(heat))
    assert {"+1", "−2", "+3", "1", "2", "a", "b", "x", "y"} <= set(drawn)
    svg = heat_map_svg(heat)
    assert svg.count("<title>") == 3
    assert "y b; x 1: −2 %" in svg


@pytest.mark.parametrize("columns", [4, 9, 60])
def test_a_heat_map_on_a_telephone_is_whole(columns: int) -> None:
    """Nothing beyond its edge, and its numbers as small as they must be; of very many columns the colours alone."""
    x = tuple(str(10 * j) for j in range(1, columns + 1))
    row = tuple(float(1000 + j) for j in range(columns))
    heat = HeatMap("t", "", "x", "y", x, ("a",), (row,), (tuple(f"{v:.0f}" for v in row),), "us")
    svg = heat_map_svg(heat, width=NARROW)
    assert 'class="figure map narrow"' in svg
    assert f'viewBox="0 0 {NARROW} ' in svg
    rows = re.findall(r'<path d="M(\S+) \S+h([\d.]+)v', svg)
    assert max(float(x) + float(width) for x, width in rows) <= NARROW
    (size,) = (float(size) for size in re.findall(r'class="cells" font-size="([^"]*)"', svg))
    numbers = re.findall(r">10\d\d<", svg.partition("</g>")[0])
    assert len(numbers) == (0 if columns == 60 else columns)
    cell = float(rows[1][0]) - float(rows[0][0])
    assert columns == 60 or (size >= SMALLEST and size * text_width("1000") / SIZE < cell)


@pytest.mark.parametrize("width", [NARROW, WIDE])
def test_names_of_categories_are_whole_and_stand_upright_where_they_do_not_fit(width: int) -> None:
    names = tuple(f"a_long_name_of_part_{i}" for i in range(4))
    boxes = Boxes("b", "best", ((0.0, 1.0, 2.0, 3.0, 4.0),) * 4)
    svg = figure_svg(figure(Panel("", (), boxes=(boxes,), categories=names)), width)
    assert set(names) <= set(texts(svg))
    assert svg.count("rotate(-90)") == (5 if width == NARROW else 1)  # and the vertical title
    whole, plain = (
        re.findall(r'viewBox="0 0 \d+ (\d+)"', one)[0] for one in (svg, figure_svg(figure(Panel("", ())), width))
    )
    assert int(whole) - int(plain) > (0.9 * text_width(names[0]) if width == NARROW else -1)


@pytest.mark.parametrize("width", [NARROW, WIDE])
def test_words_below_narrow_columns_stand_upright_and_whole(width: int) -> None:
    names = ("z_hole_diameter", "a_hole_diameter", "discharge_maximum", "spring_preload", "J")
    table = tuple((0.5,) * 5 for _ in names)
    heat = HeatMap("t", "", "", "", names, names, table, tuple(("+0.5",) * 5 for _ in names), "", True)
    drawn = texts(heat_map_svg(heat, width=width))
    assert all(drawn.count(name) == 2 for name in names)


@pytest.mark.parametrize(
    ("low", "high", "texts"),
    [
        (-0.095, 0.09, ["−0.05", "0", "0.05"]),  # a step of 0.1 would leave zero alone
        (0.0, 150.0, ["0", "50", "100", "150"]),
        (0.51, 0.59, ["0.52", "0.54", "0.56", "0.58"]),
    ],
)
def test_an_axis_has_more_than_one_tick(low: float, high: float, texts: list[str]) -> None:
    """One number alone is no scale."""
    assert [text for _, text in Axis(low, high, 0.0, 100.0).ticks(3)] == texts
