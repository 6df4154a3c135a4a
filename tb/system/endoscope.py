"""Photographs of a dot board through a real fetoscope, brought to the sensor's form.

They come with the package ``endocal`` (BSD-3-Clause): 3 x 11 dark dots a frame, with the centres
that its authors' calibration found. The host inverts them, flattens them by a top-hat, and scales
them to CIF.
"""

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np

__all__ = ["NOISE", "Photograph", "photographs"]

WIDTH, HEIGHT = 352, 288
#: Fixed noise for the flattened photographs, in eighths of a grey value.
NOISE = 80
_TOP_HAT = 55  # px of the photograph; a dot has about 40
_FRAMES = 10
_FARTHEST = 3.0  # px between a dot and its reference, to be the same dot


@dataclass(frozen=True)
class Photograph:
    """A frame for the sensor, and where the references put its dots (33 x 2, pixels)."""

    image: np.ndarray
    centres: np.ndarray

    def errors(self, found):
        """Distance of each reference dot to the found centre that is nearest, if near at all."""
        distance = np.linalg.norm(self.centres[:, None] - np.asarray(found)[None], axis=-1)
        nearest = distance.min(axis=1)
        return nearest[nearest < _FARTHEST]


def photographs():
    """The ten photographs that have reference centres, in their order."""
    # The package itself does not import beside a recent OpenCV; its data are all that is wanted.
    folder = Path(find_spec("endocal").origin).parent / "data" / "sample_001"
    stored = cv2.FileStorage(str(folder / "calibration_001-010.xml"), cv2.FILE_STORAGE_READ)
    centres = stored.getNode("Image_points").mat().reshape(_FRAMES, -1, 2)
    stored.release()
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (_TOP_HAT, _TOP_HAT))
    result = []
    for number in range(1, _FRAMES + 1):
        grey = cv2.imread(str(folder / f"frame_{number:03}.jpg"), cv2.IMREAD_GRAYSCALE)
        flat = cv2.morphologyEx(255 - grey, cv2.MORPH_TOPHAT, kernel)
        scale = HEIGHT / grey.shape[0]
        shift = (WIDTH - grey.shape[1] * scale) / 2
        # Pixel centres lie at whole numbers in both images.
        matrix = np.array([[scale, 0, (scale - 1) / 2 + shift], [0, scale, (scale - 1) / 2]])
        inverse = cv2.invertAffineTransform(matrix)
        blurred = cv2.GaussianBlur(flat, (0, 0), 0.5 / scale)
        image = cv2.warpAffine(blurred, inverse, (WIDTH, HEIGHT),
                               flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
        place = centres[number - 1] @ matrix[:, :2].T + matrix[:, 2]
        result.append(Photograph(image, place))
    return result
