"""That a figure is whole."""

from __future__ import annotations

from expertaug import plotting


def assert_nothing_is_cut(figure):
    """All texts and legends lie inside the page, and the legend touches no panel."""
    with plotting.use_style():
        figure.draw_without_rendering()
        renderer = figure.canvas.get_renderer()
        page = figure.bbox
        inside = [axis.get_tightbbox(renderer) for axis in figure.axes if axis.axison]
        parts = [*figure.legends, *figure.texts]
        boxes = [*inside, *(part.get_window_extent(renderer) for part in parts)]
    for box in boxes:
        assert box.x0 >= page.x0 - 1
        assert box.x1 <= page.x1 + 1
        assert box.y0 >= page.y0 - 1
        assert box.y1 <= page.y1 + 1
    for legend in figure.legends:
        assert not any(legend.get_window_extent(renderer).overlaps(box) for box in inside)
