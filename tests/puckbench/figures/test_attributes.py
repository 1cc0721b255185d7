"""The table and the figure of bits of attributes, on rows made by hand."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from pointkit.errors import InputError
from puckbench.figures.plot_styles import codec_style
from puckbench.figures.registry import figure_entry
from puckbench.figures.style import FigureStyle
from puckbench.tables.attribute_bits import attribute_bits


def _rows() -> pd.DataFrame:
    """Three turns by an exact codec, one with loss at two rates, and one without attributes."""
    exact = {"bpp_reflectance": 4.0, "reflectance_lossless": True, "reflectance_max_error": 0.0}
    lossy = {"reflectance_lossless": False, "reflectance_max_error": 9.0}
    streams = [
        ("puck", "1mm", exact),
        ("gpcc", "qp40", {**lossy, "bpp_reflectance": 0.5, "reflectance_psnr": 30.0}),
        ("gpcc", "qp22", {**lossy, "bpp_reflectance": 2.0, "reflectance_psnr": 40.0}),
        ("draco", "1mm", {}),
    ]
    rows = pd.DataFrame(
        {"codec": codec, "rate": rate, "cloud": cloud, "bpp_geometry": 6.0 + number, **values}
        for codec, rate, values in streams
        for number, cloud in enumerate("abc")
    )
    bits = rows["bpp_geometry"] + rows["bpp_reflectance"].fillna(0)
    return rows.assign(dataset="turns", frame="metric", bpp=bits)


def test_bits_are_medians_over_clouds_of_the_codecs_that_code_attributes() -> None:
    table = attribute_bits(_rows()).set_index(["codec", "rate"])
    assert list(table.index) == [("puck", "1mm"), ("gpcc", "qp40"), ("gpcc", "qp22")]
    puck, coarse = table.loc[("puck", "1mm")], table.loc[("gpcc", "qp40")]
    assert (puck["bpp_geometry"], puck["bpp_reflectance"], puck["bpp"]) == (7, 4, 11)
    assert puck["reflectance_lossless"]
    assert not coarse["reflectance_lossless"]
    assert np.isnan(puck["reflectance_psnr"])
    assert (coarse["reflectance_psnr"], coarse["clouds"]) == (30, 3)
    one_lost = _rows()
    of_b = one_lost["codec"].eq("puck") & one_lost["cloud"].eq("b")
    one_lost.loc[of_b, "reflectance_lossless"] = False
    assert not attribute_bits(one_lost)["reflectance_lossless"].any()
    for bare in (_rows().query("codec == 'draco'"), _rows()[["dataset", "codec", "rate", "cloud"]]):
        with pytest.raises(InputError, match="no codec has coded a reflectance or a colour"):
            attribute_bits(bare)


def test_bars_are_lossless_bits_and_lines_psnr_over_bits_of_the_attribute() -> None:
    style = FigureStyle()
    with style.context():
        figure: Figure = figure_entry("attributes").draw(metrics=_rows(), style=style)
    above, below = figure.axes
    spans = [(bar.get_x(), bar.get_width()) for bar in above.patches]
    assert spans == [(0, 7), (7, 4)]
    assert [text.get_text().strip() for text in above.texts] == ["4.00"]
    (line,) = below.get_lines()
    np.testing.assert_array_equal(line.get_xydata(), [[0.5, 30], [2, 40]])
    assert line.get_color() == codec_style("gpcc").colour
    (tick,) = below.collections
    assert tick.get_segments()[0][:, 0].tolist() == [4, 4]
