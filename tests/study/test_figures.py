"""A study's figures."""

import numpy as np
from support.study_rows import rows_of_two

from studies import harness


def test_a_figure_has_lines_crosses_and_slopes(tmp_path):
    with harness.figure(tmp_path, "errors", "time step [s]", "error [m]") as (figure, ax):
        harness.draw_lines(ax, rows_of_two(), x="dt", y="error", by="method")
        limits = ax.get_xlim(), ax.get_ylim()
        harness.draw_slope_triangle(ax, 2)
        assert (ax.get_xlim(), ax.get_ylim()) == limits
        _, right, top = np.log10(ax.patches[0].get_xy()[:3])
        left = np.log10(ax.patches[0].get_xy()[0])
        np.testing.assert_allclose((top - right)[1] / (right - left)[0], 2, rtol=1e-12)
        first, second, *crosses = ax.lines
        assert first.get_color() != second.get_color()
        assert first.get_marker() != second.get_marker()
        assert [list(cross.get_xdata()) for cross in crosses] == [[0.4]]
        figure.canvas.draw()
    assert (tmp_path / "errors.png").read_bytes()[1:4] == b"PNG"
    assert "<svg" in (tmp_path / "errors.svg").read_text()
