"""Pictures of a simulation: millimetres and degrees, a colour an axis, a line style an interface."""

import numpy as np

from flexfmu.fmu import curves


def test_a_metre_is_drawn_as_a_thousand_millimetres_and_a_radian_as_its_degrees(tmp_path, monkeypatch):
    names = [f"{name}.{kind}.{axis}" for name in ("a", "b") for kind in ("displacement", "rotation") for axis in "xyz"]
    rows = ["time," + ",".join(names), "0" + ",0" * len(names), "1" + ",1" * len(names)]
    (tmp_path / "t.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    drawn = []
    monkeypatch.setattr(curves, "save", lambda figure, _: drawn.append(figure))
    curves.plot_result(tmp_path / "t.csv", tmp_path / "t.png")
    upper, lower = drawn[0].axes
    assert (upper.get_ylabel(), lower.get_ylabel()) == ("displacement / mm", "rotation / °")
    np.testing.assert_allclose([line.get_ydata()[-1] for line in upper.lines], 1e3)
    np.testing.assert_allclose([line.get_ydata()[-1] for line in lower.lines], np.degrees(1.0))
    for panel in (upper, lower):
        looks = [(line.get_color(), line.get_linestyle()) for line in panel.lines]
        assert len({colour for colour, _ in looks}) == 3
        assert [colour for colour, _ in looks[:3]] == [colour for colour, _ in looks[3:]]
        assert len(set(looks)) == 6
    (legend,) = drawn[0].legends
    assert [text.get_text() for text in legend.get_texts()] == ["a x", "a y", "a z", "b x", "b y", "b z"]
