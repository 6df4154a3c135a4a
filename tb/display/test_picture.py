"""The picture of the documents can be made again, and its spots are in it."""

import numpy as np

from tb.display.picture import rendered_scene
from tb.system.conftest import prepared

__all__ = ["prepared"]


def test_rendered_scene(request, tmp_path):
    picture, good, others = rendered_scene(
        request, tmp_path, *request.getfixturevalue("prepared"))
    assert good >= 45
    red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
    assert np.count_nonzero((green == 255) & (red == 0) & (blue == 0)) > 15 * good
    assert others or not np.count_nonzero((red == 255) & (green == 0))
