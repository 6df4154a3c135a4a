"""What two-pass labelling with a limited number of labels must give, by OpenCV and by counting."""

import cv2
import numpy as np

__all__ = ["components_in_two_passes"]


def components_in_two_passes(lit, core, labels):
    """Spots of a frame as tuples (core, saturated, border, area, weight, sum_u, sum_v), and the
    labels missed.

    Arguments, limits and order are those of
    :func:`model.preprocessing.two_pass_labelling.label_in_two_passes`.
    """
    height, width = lit.shape
    _, of_pixel, stats, centres = cv2.connectedComponentsWithStats(
        lit.astype(np.uint8), connectivity=8)
    first, has_core, asked, dropped = {}, set(), 0, set()
    missed = 0
    for v, u in zip(*np.nonzero(lit), strict=True):
        component = of_pixel[v, u]
        first.setdefault(component, len(first))
        if core[v, u]:
            has_core.add(component)
        before = [(v, u - 1), (v - 1, u - 1), (v - 1, u), (v - 1, u + 1)]
        if not any(y >= 0 and 0 <= x < width and lit[y, x] for y, x in before):
            asked += 1
            if asked > labels:
                missed += 1
                dropped.add(component)
    spots = []
    for component in sorted(first, key=first.get):
        if component in dropped:
            continue
        area = int(stats[component, cv2.CC_STAT_AREA])
        u, v = np.rint(centres[component] * area).astype(int)
        core_bit = int(component in has_core)
        left, top, columns, rows = (int(stats[component, name]) for name in (
            cv2.CC_STAT_LEFT, cv2.CC_STAT_TOP, cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT))
        border = int(left == 0 or top == 0 or left + columns == width or top + rows == height)
        spots.append((core_bit, 0, border, area, area, int(u), int(v)) if area < 1024
                     else (core_bit, 0, border, 1024, 0, 0, 0))
    return spots, min(missed, 65535)
