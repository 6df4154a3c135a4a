"""Spots of single images as the Verilated chip finds them, without a calibration."""

from dataclasses import replace

import numpy as np

from calibration.calibrate import with_lens
from calibration.lens import Lens
from hdl.config import PRESETS
from model.errors import UserError
from model.preprocessing.centre import lsb_px
from scripts.results.spot_rows import spot_settings, spots_of
from scripts.simulation.engine import RTLEngine

__all__ = ["SpotEngine"]



class SpotEngine:
    """A chip for images of one size, with a lens that distorts nothing and no beam.

    Parameters
    ----------
    width, height : :class:`int`
        Size of the images in pixels.

    Raises
    ------
    UserError
        If there is no chip of that size, or it cannot be built here.
    """

    def __init__(self, width, height):
        lens = Lens(width=width, height=height, focal=float(2 * max(width, height)),
                    principal_u=(width - 1) / 2, principal_v=(height - 1) / 2)
        settings = replace(with_lens(spot_settings(), lens), line=(0,), window=(0,), depth=(0,))
        try:
            config = replace(PRESETS["capsule"], width=width, height=height, beams=1, lanes=1,
                             mean_window=settings.mean_window)
        except ValueError as error:
            raise UserError(f"There is no chip for images of {width} x {height} pixels ({error}): "
                            "use --engine model.") from error
        self._engine = RTLEngine(settings, config)

    def __call__(self, image):
        """Spots of an image, and how many the chip dropped because its buffers were full.

        Weights and peaks are those of the model's spots: the chip does not send them. A spot that
        the model does not have lacks them, and so there is none: the two agree to the last bit.

        Raises
        ------
        RuntimeError
            If the chip reports a spot that the model does not find.
        """
        frame, = self._engine.frames([image], independent=True)
        model, lsb = spots_of(image), lsb_px(*image.shape[::-1])
        expected = {(round(spot["u"] / lsb), round(spot["v"] / lsb), int(spot["area"])):
                    index for index, spot in enumerate(model)}
        points = frame.points
        keys = list(zip(*(points[name].tolist() for name in ("u", "v", "area")), strict=True))
        if strange := [key for key in keys if key not in expected]:
            raise RuntimeError(f"the chip reports {len(strange)} spots that its model lacks")
        return model[np.array([expected[key] for key in keys], int)], frame.dropped
